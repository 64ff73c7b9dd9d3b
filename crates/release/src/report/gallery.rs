//! The pictures of a trajectory in three rows: what the camera sees; the events of each sensor and
//! the path; event rates and speeds.
//!
//! Sensors keep their column in every row, and share the window of time and the scales, so that they
//! can be compared at a glance.

use super::ReportPage;
use super::curve::{self, PlotAxes, ReportCurve};
use super::path_views::{self, VIEW};
use super::previews::{self, PictureRequest, Preview, PreviewStream};
use super::section::{ReportTrajectory, write_image};
use crate::products;
use crate::published::PublishedTrajectory;
use crate::scene::{QuantityExtent, TrajectoryStatistics};
use gs2e_files::html::HtmlFragment;
use gs2e_trajectory::picture::{short_number, sketch};
use std::fmt::Write as _;

/// Maximum number of sensors that are shown of a trajectory.
const MAX_STREAMS: usize = 4;

/// Writes the pictures and plots of a trajectory.
pub(super) fn write_gallery(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    // A withheld scene has no such files here.
    let mut streams = previews::preview_streams(track, page.places);
    let all = streams.len();
    streams.truncate(MAX_STREAMS);
    let pictured = has_pictures(page, track);
    if pictured {
        write_row(html, "row", |html| write_camera(html, page, track));
    }
    write_row(html, "row", |html| {
        if pictured {
            write_events(html, page, track, &streams);
        }
        write_path(html, page, track.published);
    });
    write_row(html, "row plots", |html| {
        write_rates(html, page, track, &streams);
        write_speeds(html, page, track);
    });
    if all > streams.len() {
        html.leaf(
            "p",
            &[("class", "caption")],
            &format!("The first {MAX_STREAMS} of {all} sensors are shown."),
        );
    }
}

/// Returns true if the page shows pixels of the trajectory.
fn has_pictures(page: &ReportPage<'_>, track: ReportTrajectory<'_>) -> bool {
    let trajectories = &track.entry.scene.file.trajectories;
    let is_first = trajectories.first().is_some_and(|first| first.name == track.part.name);
    !track.entry.is_withheld() && (page.detail.full || is_first)
}

/// Writes a row of figures; nothing if it is empty.
fn write_row(html: &mut HtmlFragment, class: &str, inside: impl FnOnce(&mut HtmlFragment)) {
    let mut row = HtmlFragment::default();
    inside(&mut row);
    if row != HtmlFragment::default() {
        html.within("div", &[("class", class)], |html| html.append(&row));
    }
}

fn write_figure(html: &mut HtmlFragment, class: &str, caption: &str, inside: impl FnOnce(&mut HtmlFragment)) {
    html.within("figure", &[("class", class)], |html| {
        inside(html);
        html.leaf("figcaption", &[], caption);
    });
}

fn write_preview(html: &mut HtmlFragment, preview: Option<Preview>) {
    match preview {
        None => {}
        Some(Preview { picture, words, wheel: false }) => {
            write_figure(html, "", &words, |html| write_image(html, &picture, "", &words));
        }
        Some(Preview { picture, words, wheel: true }) => html.within("figure", &[], |html| {
            write_image(html, &picture, "", &words);
            html.within("figcaption", &[], |html| {
                // The style sheet draws the colours of all directions.
                html.leaf("span", &[("class", "wheel"), ("aria-hidden", "true")], "");
                html.text(&words);
            });
        }),
    }
}

/// Writes what the camera sees at one moment: a picture of each product that has one.
fn write_camera(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let (places, width) = (page.places, page.detail.picture);
    if !page.detail.full {
        return;
    }
    for product in products::products() {
        if let Some(picture_of) = product.picture {
            write_preview(html, picture_of(PictureRequest { product, track, places, width }));
        }
    }
}

/// Writes the events of each sensor in one window of time.
fn write_events(
    html: &mut HtmlFragment,
    page: &ReportPage<'_>,
    track: ReportTrajectory<'_>,
    streams: &[PreviewStream<'_>],
) {
    let Some(window) = previews::shared_window(&track, streams) else { return };
    let most = if page.detail.full { MAX_STREAMS } else { 1 };
    for stream in streams.iter().take(most) {
        write_preview(html, previews::events_picture(track, stream, &window, page.detail.picture));
    }
}

/// Writes the event rate of each sensor over time, on one scale.
fn write_rates(
    html: &mut HtmlFragment,
    page: &ReportPage<'_>,
    track: ReportTrajectory<'_>,
    streams: &[PreviewStream<'_>],
) {
    let pixels = previews::sensor_size(&track).pixels() as f64;
    let rate = |stream: &PreviewStream<'_>| stream.rate(track.part.duration_us, page.detail.points, pixels);
    let rates: Vec<ReportCurve> = streams.iter().map(rate).collect();
    let axes = PlotAxes {
        highest: rates.iter().map(ReportCurve::highest).fold(0.0, f64::max),
        unit: "events/px/s",
        duration_ms: duration_ms(track),
        labelled: page.detail.full,
    };
    for (stream, rate) in streams.iter().zip(&rates) {
        let of = stream.name.map_or(String::new(), |name| format!("{name}: "));
        let words = format!("{of}event rate, at most {} events/px/s", short_number(rate.highest()));
        write_figure(html, "", &words, |html| curve::draw_curves(html, axes, &[("a", rate)]));
    }
}

fn duration_ms(track: ReportTrajectory<'_>) -> f64 {
    track.part.duration_us as f64 * 1e-3
}

/// Writes the speeds of the camera over time.
fn write_speeds(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let report = &track.published.motion.report;
    let durations: Vec<f64> = report.durations().collect();
    // The two speeds have different units, and only over their means do they share a scale.
    let curve = |values: &[f64]| ReportCurve::new(values, &durations, page.detail.points).over_mean();
    let (linear, angular) = (curve(&report.linear_unit_s), curve(&report.angular_rad_s));
    let drawn: Vec<(&'static str, &ReportCurve)> =
        [("a", &linear, report.linear_ratio.is_some()), ("b", &angular, report.angular_ratio.is_some())]
            .into_iter()
            .filter(|(.., moves)| *moves)
            .map(|(class, curve, _)| (class, curve))
            .collect();
    if drawn.is_empty() {
        return;
    }
    let axes = PlotAxes {
        highest: drawn.iter().map(|(_, curve)| curve.highest()).fold(0.0, f64::max),
        unit: "times the mean speed",
        duration_ms: duration_ms(track),
        labelled: page.detail.full,
    };
    let words = format!("camera speed: {}", speed_words(&track.part.statistics));
    write_figure(html, "", &words, |html| curve::draw_curves(html, axes, &drawn));
}

fn speed_words(counted: &TrajectoryStatistics) -> String {
    let of = |range: Option<QuantityExtent>, name: &str, unit: &str| {
        range.map(|QuantityExtent { min, max, .. }| {
            format!("{name} {} to {} {unit}", short_number(min), short_number(max))
        })
    };
    let linear = of(counted.linear_unit_s, "linear (blue)", "units/s");
    let angular = of(counted.angular_rad_s, "angular (red)", "rad/s");
    [linear, angular].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Writes the path as seen from above and from the side.
fn write_path(html: &mut HtmlFragment, page: &ReportPage<'_>, published: &PublishedTrajectory) {
    let motion = &published.motion;
    let counts = [page.detail.points, page.detail.cameras];
    let views = sketch(&motion.trajectory.world_from_camera, &motion.report.linear_unit_s, VIEW, counts);
    let Some(views) = views else { return };
    let [from_above, from_the_side] = [0, 1].map(|i: usize| views[i].name);
    let mut caption = format!("path {from_above}, and {from_the_side}");
    let speeds = QuantityExtent::from_values(&motion.report.linear_unit_s);
    if let Some(QuantityExtent { min, max, .. }) = speeds {
        let _ = write!(
            caption,
            "; cameras from {} units/s (dark) to {} (yellow)",
            short_number(min),
            short_number(max)
        );
    }
    write_figure(html, "wide", &caption, |html| path_views::draw_views(html, &views));
}
