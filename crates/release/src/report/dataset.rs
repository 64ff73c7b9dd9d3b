//! The page about a dataset that another program or a camera made.

use super::curve::{PlotAxes, ReportCurve, draw_curves, stroke_path};
use super::embed::EmbeddedPicture;
use super::findings::{VerdictCount, write_table};
use gs2e_check::Finding;
use gs2e_dataset::{AlignmentCurve, DatasetReport};
use gs2e_files::html::{HtmlFragment, write_page_head};
use gs2e_image::Image;
use gs2e_trajectory::picture::short_number;

/// Width of a picture, px.
const WIDTH: u32 = 640;
/// Size of the plot of the correlation, px.
const PLOT: [f64; 2] = [320.0, 150.0];

/// A picture with its caption.
#[derive(Debug, Clone)]
pub struct CaptionedPicture {
    /// The picture.
    pub image: Image<[u8; 3]>,
    /// The caption.
    pub caption: String,
}

/// Composes the page. `name` is the dataset's name in its findings.
#[must_use]
pub fn compose_dataset_page(name: &str, report: &DatasetReport, pictures: &[CaptionedPicture]) -> String {
    HtmlFragment::whole_page(|html| {
        html.within("head", &[], |html| write_page_head(html, name));
        html.within("body", &[], |html| {
            html.within("header", &[], |html| {
                html.leaf("h1", &[], name);
                html.leaf("p", &[("class", "verdict")], &report.verdict());
                write_figures(html, report);
                let count = VerdictCount::from_findings(&report.findings);
                html.within("div", &[("class", "verdict-line")], |html| {
                    count.bar(html);
                    html.within("p", &[], |html| {
                        html.text("Verdicts of checks: ");
                        count.badges(html);
                    });
                });
            });
            html.within("main", &[], |html| {
                write_pictures(html, pictures);
                write_plots(html, report);
                html.within("section", &[], |html| {
                    html.leaf("h2", &[], "Checks and estimates");
                    html.leaf(
                        "p",
                        &[],
                        "The sensor is unknown. Thresholds and the dead time are estimates, and have no limit. Limits of the \
                         clock and of the noise include the error of their estimate.",
                    );
                    write_table(html, name, &report.findings);
                });
            });
        });
    })
}

fn write_figures(html: &mut HtmlFragment, report: &DatasetReport) {
    let survey = &report.survey;
    let seconds = survey.span.map_or(0.0, |(first, last)| (last.0 - first.0) as f64 * 1e-9);
    let measured = |check: &str, part: &str| {
        let is_it = |finding: &&Finding| finding.check == check && finding.subject.statement == part;
        report.findings.iter().find(is_it).and_then(|finding| finding.measured)
    };
    let mut figures = vec![
        (short_number(survey.events as f64), "events"),
        (short_number(seconds), "s"),
        (short_number(survey.events as f64 / seconds.max(1e-6)), "events/s"),
        (short_number(survey.on as f64 / survey.events.max(1) as f64), "share of ON events"),
    ];
    let estimates = [
        (measured("time_offset", ""), "us later than the frames"),
        (measured("event_frame", "threshold-on"), "threshold of ON events"),
        (measured("event_frame", "threshold-off"), "threshold of OFF events"),
        (measured("noise_floor", "share"), "share of noise"),
    ];
    figures.extend(estimates.into_iter().filter_map(|(value, what)| Some((short_number(value?), what))));
    html.figures(figures);
}

fn write_pictures(html: &mut HtmlFragment, pictures: &[CaptionedPicture]) {
    html.within("section", &[("class", "row")], |html| {
        for picture in pictures {
            let Some(small) = EmbeddedPicture::from_image(&picture.image, WIDTH) else { continue };
            let [width, height] = [small.width, small.height].map(|side| side.to_string());
            html.within("figure", &[("class", "wide")], |html| {
                html.empty(
                    "img",
                    &[
                        ("src", &small.address),
                        ("width", &width),
                        ("height", &height),
                        ("alt", &picture.caption),
                    ],
                );
                html.leaf("figcaption", &[], &picture.caption);
            });
        }
    });
}

fn write_plots(html: &mut HtmlFragment, report: &DatasetReport) {
    html.within("section", &[("class", "row")], |html| {
        let rate = &report.rate;
        let ms = rate.bin_us as f64 * 1e-3;
        let values: Vec<f64> = rate.events.iter().map(|count| *count as f64 / ms).collect();
        let curve = ReportCurve::new(&values, &vec![ms; values.len()], values.len());
        let axes = PlotAxes {
            highest: curve.highest(),
            unit: "events/ms",
            duration_ms: ms * values.len() as f64,
            labelled: true,
        };
        html.within("figure", &[], |html| {
            draw_curves(html, axes, &[("a", &curve)]);
            html.leaf("figcaption", &[], "Event rate over time");
        });
        if let Some(curve) = &report.alignment {
            html.within("figure", &[], |html| {
                draw_alignment(html, curve);
                html.leaf("figcaption", &[], "Correlation of events and frames over the time offset");
            });
        }
    });
}

/// The correlation from the lowest shift to the highest, with a line at 0.
fn draw_alignment(html: &mut HtmlFragment, curve: &AlignmentCurve) {
    let [width, height] = PLOT;
    let (Some(first), Some(last)) = (curve.points.first(), curve.points.last()) else { return };
    let span = (last.0 - first.0).max(1.0);
    // The correlation is between -1 and 1.
    let place = |(shift, value): &(f64, f64)| {
        [8.0 + (shift - first.0) / span * (width - 16.0), height / 2.0 - value * (height / 2.0 - 22.0)]
    };
    let view = format!("0 0 {width:.0} {height:.0}");
    html.within("svg", &[("class", "curve"), ("viewBox", &view), ("aria-hidden", "true")], |html| {
        let axis = [[8.0, height / 2.0], [width - 8.0, height / 2.0]];
        html.empty("path", &[("class", "grid"), ("d", &stroke_path(axis))]);
        html.empty("path", &[("class", "a"), ("d", &stroke_path(curve.points.iter().map(place)))]);
        let labels = [
            (8.0, "start", format!("{} ms", short_number(first.0 * 1e-3))),
            (width - 8.0, "end", format!("{} ms", short_number(last.0 * 1e-3))),
        ];
        for (x, anchor, words) in &labels {
            let (x, y) = (format!("{x:.0}"), format!("{:.0}", height - 4.0));
            html.leaf("text", &[("x", &x), ("y", &y), ("text-anchor", anchor)], words);
        }
    });
}
