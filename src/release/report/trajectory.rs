//! One trajectory in the section of its scene: counts, pictures, curves, files and findings.

use super::ReportPage;
use super::curve::{self, ReportCurve, stroke_path};
use super::findings::is_fault;
use super::html::HtmlFragment;
use super::section::{self, ReportTrajectory, file_link, on_share, thousands_number, write_image};
use super::seen::{self, ShownPicture};
use crate::release::published::PublishedTrajectory;
use crate::release::scene::{QuantityExtent, TrajectoryPart, TrajectoryStatistics};
use crate::trajectory::picture::{PathSketch, short_number, sketch};
use crate::units::format_amount;
use std::fmt::Write as _;

/// Size of a view of the path, px.
const VIEW: [f64; 2] = [240.0, 160.0];

/// Writes a trajectory.
pub(super) fn write_trajectory(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let ReportTrajectory { entry, part, published } = track;
    html.within("article", &[], |html| {
        html.within("h4", &[], |html| {
            html.text(&part.name);
            html.leaf("span", &[("class", "kind")], &format!(" {}", part.kind));
        });
        html.leaf("p", &[("class", "counted")], &count_words(part));
        html.within("div", &[("class", "figures")], |html| {
            if !entry.is_withheld() {
                write_pictures(html, page, track);
            }
            write_path(html, page, published);
            write_curves(html, page, track);
            if !entry.is_withheld() {
                pictures_of_checks(html, page, track);
            }
        });
        write_files(html, page, track);
        let prefix = format!("{}/{}", entry.id(), part.name);
        section::write_findings(html, page, "Checks", &prefix, &published.findings);
    });
}

/// The counts of a trajectory, in words.
fn count_words(part: &TrajectoryPart) -> String {
    let mut words =
        format!("{} poses, {:.1} ms", thousands_number(part.poses as u64), part.duration_us as f64 * 1e-3);
    let stream = |words: &mut String, name: Option<&str>, counted: &TrajectoryStatistics| {
        let Some(events) = counted.events else { return };
        let _ = write!(
            words,
            "; {}{} events",
            name.map_or(String::new(), |n| format!("{n}: ")),
            thousands_number(events)
        );
        if let Some(rate) = counted.rate_ev_px_s {
            let _ = write!(words, ", {} ev/px/s", short_number(rate));
        }
        if let Some(share) = on_share(counted) {
            let _ = write!(words, ", ON share {share:.3}");
        }
        if let Some(peak) = counted.peak_ev_per_ms {
            let _ = write!(words, ", peak {} ev/ms", thousands_number(peak));
        }
    };
    stream(&mut words, None, &part.statistics);
    part.sensors.iter().for_each(|(name, sensor)| stream(&mut words, Some(name), &sensor.statistics));
    if let Some(step) = part.statistics.max_step_px {
        let _ = write!(words, "; largest step {} px", short_number(f64::from(step)));
    }
    words
}

fn write_figure(html: &mut HtmlFragment, class: &str, caption: &str, inside: impl FnOnce(&mut HtmlFragment)) {
    html.within("figure", &[("class", class)], |html| {
        inside(html);
        html.leaf("figcaption", &[], caption);
    });
}

/// Writes the sharp and the blurred frame of the middle, and the events around it.
fn write_pictures(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let (depth, places) = (page.depth, page.places);
    let trajectories = &track.entry.scene.file.trajectories;
    let first = trajectories.first().is_some_and(|first| first.name == track.part.name);
    if !depth.every && !first {
        return;
    }
    let mut show = |shown: Option<ShownPicture>| {
        if let Some(ShownPicture { picture, words }) = shown {
            write_figure(html, "", &words, |html| write_image(html, &picture, "", &words));
        }
    };
    if depth.sharp {
        show(seen::sharp_picture(track, places, depth.picture));
        show(seen::blurred_picture(track, places, depth.picture));
    }
    let most = if depth.every { MAX_STREAMS } else { 1 };
    for (name, file) in seen::stream_outputs(track, places).into_iter().take(most) {
        let shown = seen::events_picture(track, &file, depth.picture);
        let named = |shown: ShownPicture| match name {
            Some(name) => ShownPicture { words: format!("{name}: {}", shown.words), ..shown },
            None => shown,
        };
        show(shown.map(named));
    }
}

/// Maximum number of streams that are shown of a trajectory.
const MAX_STREAMS: usize = 4;

/// Writes the path as seen from above and from the side.
fn write_path(html: &mut HtmlFragment, page: &ReportPage<'_>, published: &PublishedTrajectory) {
    let motion = &published.motion;
    let counts = [page.depth.points, page.depth.cameras];
    let views = sketch(&motion.trajectory.world_from_camera, &motion.report.linear_unit_s, VIEW, counts);
    let Some(views) = views else { return };
    let speeds = QuantityExtent::from_values(&motion.report.linear_unit_s);
    let [from_above, from_the_side] = [0, 1].map(|i: usize| views[i].name);
    let mut caption = format!("path {from_above}, and {from_the_side}");
    if let Some(QuantityExtent { min, max, .. }) = speeds {
        let _ = write!(
            caption,
            "; cameras from {} units/s (dark) to {} (yellow)",
            short_number(min),
            short_number(max)
        );
    }
    write_figure(html, "wide", &caption, |html| {
        let [width, height] = VIEW;
        let view = format!("0 0 {} {height}", 2.0 * width);
        let attributes = [("class", "path"), ("viewBox", view.as_str()), ("aria-hidden", "true")];
        html.within("svg", &attributes, |html| draw_views(html, &views));
    });
}

/// Draws both views next to each other. Lines that look alike make one stroke, since a page has
/// thousands of them.
fn draw_views(html: &mut HtmlFragment, views: &[PathSketch; 2]) {
    let [width, height] = VIEW;
    let both = |of: &dyn Fn(&PathSketch) -> Vec<[f64; 2]>| -> String {
        let at = |(view, left): (&PathSketch, f64)| stroke_path(of(view).iter().map(|[x, y]| [x + left, *y]));
        views.iter().zip([0.0, width]).map(at).collect()
    };
    let bar = |view: &PathSketch| vec![[8.0, height - 8.0], [8.0 + view.bar, height - 8.0]];
    html.empty("path", &[("class", "way"), ("d", &(both(&|view| view.path.clone()) + &both(&bar)))]);
    for (number, (_, colour)) in views[0].frusta.iter().enumerate() {
        html.empty("path", &[("stroke", colour), ("d", &both(&|view| view.frusta[number].0.to_vec()))]);
    }
    for (view, left) in views.iter().zip([0.0, width]) {
        if let Some([x, y]) = view.path.first() {
            let [x, y] = [x + left, *y].map(|v| format!("{v:.0}"));
            html.empty("circle", &[("cx", &x), ("cy", &y), ("r", "3")]);
        }
    }
    // The views have one scale only if their paths are equally long, so each has a bar of its own.
    for (view, left) in views.iter().zip([8.0, width + 8.0]) {
        let [x, y] = [left, height - 13.0].map(|v| format!("{v:.0}"));
        html.leaf("text", &[("x", &x), ("y", &y)], &view.bar_words);
    }
}

/// Writes event rates and speeds over time.
fn write_curves(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let ReportTrajectory { part, published, .. } = track;
    let points = page.depth.points;
    // A withheld scene has no event files here.
    for (name, file) in seen::stream_outputs(track, page.places).into_iter().take(MAX_STREAMS) {
        let Some(rate) = seen::stream_rate(&file, part.duration_us, points) else { continue };
        let of = name.map_or(String::new(), |name| format!("{name}: "));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count times 1000")]
        let highest = format_amount(rate.highest() as u64, "ev/s");
        let words = format!("{of}event rate over time, from 0 to {highest}");
        write_figure(html, "", &words, |html| curve::draw_curves(html, &[("a", &rate)]));
    }
    let report = &published.motion.report;
    let durations: Vec<f64> = report.durations().collect();
    // The two speeds have different units, and only over their means do they share a scale.
    let curve = |values: &[f64]| ReportCurve::new(values, &durations, points).over_mean();
    let (linear, angular) = (curve(&report.linear_unit_s), curve(&report.angular_rad_s));
    let words = format!("speed over time, from 0, each over its mean: {}", speed_words(&part.statistics));
    let drawn: Vec<(&'static str, &ReportCurve)> =
        [("a", &linear, report.linear_ratio.is_some()), ("b", &angular, report.angular_ratio.is_some())]
            .into_iter()
            .filter(|(.., moves)| *moves)
            .map(|(class, curve, _)| (class, curve))
            .collect();
    if !drawn.is_empty() {
        write_figure(html, "", &words, |html| curve::draw_curves(html, &drawn));
    }
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

/// Writes the pictures that checks made.
fn pictures_of_checks(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    for of in seen::of_checks(track, page.depth) {
        let Some(picture) = of.read(page.places, page.depth.picture) else { continue };
        let own = track.published.findings.iter().filter(|finding| of.concerns(finding));
        let fault = super::findings::worst_verdict(own).filter(|verdict| is_fault(*verdict));
        let mut words = format!("check {}", of.check);
        if let Some(sensor) = of.sensor {
            let _ = write!(words, ", {sensor}");
        }
        if let Some(verdict) = fault {
            let _ = write!(words, ": {}", verdict.name());
        }
        write_figure(html, "", &words, |html| write_image(html, &picture, "", &words));
    }
}

/// Writes links to the trajectory's files. Of a folder of many files only the first is linked. A
/// brief page links to the most wanted files.
fn write_files(html: &mut HtmlFragment, page: &ReportPage<'_>, track: ReportTrajectory<'_>) {
    let folder = format!("{}/", track.part.name);
    let prefix = track.path_of("");
    let paths: Vec<&str> = track.entry.below(&folder).filter_map(|path| path.strip_prefix(&prefix)).collect();
    // Paths are sorted, so the frames of one folder are neighbours.
    let same = |a: &&str, b: &&str| of_many(a).is_some() && of_many(a) == of_many(b);
    let groups = paths.chunk_by(same).filter(|group| page.depth.every || is_most_wanted(group[0]));
    html.within("p", &[("class", "files")], |html| {
        html.text("Files: ");
        for (number, group) in groups.enumerate() {
            html.text(if number > 0 { ", " } else { "" });
            file_link(html, &format!("{prefix}{}", group[0]), group[0]);
            if group.len() > 1 {
                html.text(&format!(" and {} more", group.len() - 1));
            }
        }
        html.text(if page.depth.every { "" } else { ", and others beside them" });
    });
}

/// Returns true for the files that a brief page links to: the events, the findings, and the path in
/// full.
fn is_most_wanted(path: &str) -> bool {
    path.starts_with("events") || ["checks.json", "trajectory.svg", "trajectory.png"].contains(&path)
}

/// The folder of a file that is one of many numbered frames.
fn of_many(path: &str) -> Option<&str> {
    let (folder, name) = path.split_once('/')?;
    name.starts_with(|c: char| c.is_ascii_digit()).then_some(folder)
}
