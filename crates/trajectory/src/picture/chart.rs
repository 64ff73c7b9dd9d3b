//! Asked and achieved speed over time, each relative to its mean. If the curves coincide, the path
//! follows its law.

use super::{PicturePanel, SvgText, round_down, short_number, spread_indices};
use crate::report::SpeedReport;

/// Maximum number of steps drawn.
const STEPS: usize = 1200;
/// Space for the labels of the axes, px.
const LEFT: f64 = 56.0;
const BOTTOM: f64 = 40.0;
const TOP: f64 = 34.0;

/// A curve of the chart.
struct ChartCurve {
    name: &'static str,
    colour: &'static str,
    width: f64,
    values: Vec<f64>,
}

/// Draws the chart of a trajectory with a duration of `seconds`.
pub(super) fn draw_chart(out: &mut SvgText, panel: PicturePanel, seconds: f64, report: &SpeedReport) {
    out.frame(panel);
    let curves = speed_curves(report);
    let inner = PicturePanel {
        left: panel.left + LEFT,
        top: panel.top + TOP,
        width: panel.width - LEFT - 16.0,
        height: panel.height - TOP - BOTTOM,
    };
    let shown = curves.iter().flat_map(|c| c.values.iter().copied()).filter(|v| v.is_finite());
    // The mean is 1. It is always shown, so the scale is positive even if no value is finite.
    let highest = shown.fold(1.0, f64::max) * 1.08;
    let top = inner.top + inner.height;
    let point =
        |share: f64, value: f64| [inner.left + inner.width * share, top - inner.height * value / highest];
    draw_grid(out, inner, highest, seconds);
    let middles = step_middles(report);
    for curve in &curves {
        out.polyline(
            spread_indices(curve.values.len(), STEPS).map(|j| point(middles[j], curve.values[j])),
            curve.colour,
            curve.width,
        );
    }
    draw_legend(out, panel, &curves);
}

fn speed_curves(report: &SpeedReport) -> Vec<ChartCurve> {
    let mixed: Vec<f64> = report
        .angular_rad_s
        .iter()
        .zip(&report.linear_unit_s)
        .map(|(a, l)| report.alpha * a + report.beta * l / report.scale_distance)
        .collect();
    let asked: Vec<f64> =
        report.asked_shares().zip(report.durations()).map(|(share, time)| share / time).collect();
    let asked = ChartCurve { name: "asked", colour: "#bbbbbb", width: 5.0, values: relative_to_mean(&asked) };
    let achieved = [
        ("linear", "#2a7fb8", 1.2, &report.linear_unit_s, report.linear_ratio.is_some()),
        ("angular", "#d1495b", 1.2, &report.angular_rad_s, report.angular_ratio.is_some()),
        ("mixed", "#111111", 1.4, &mixed, report.mixed_chord_ratio.is_some()),
    ];
    // A part of the motion that is only rounding has no ratio, and its curve would be noise.
    let drawn = achieved.into_iter().filter(|(.., moves)| *moves);
    std::iter::once(asked)
        .chain(drawn.map(|(name, colour, width, values, _)| ChartCurve {
            name,
            colour,
            width,
            values: relative_to_mean(values),
        }))
        .collect()
}

/// The middle of every step, as a share of the duration.
fn step_middles(report: &SpeedReport) -> Vec<f64> {
    let mut end = 0.0;
    let middle = |duration: f64| {
        end += duration;
        end - duration / 2.0
    };
    let mut middles: Vec<f64> = report.durations().map(middle).collect();
    middles.iter_mut().for_each(|t| *t /= end);
    middles
}

fn relative_to_mean(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| v / mean).collect()
}

fn draw_grid(out: &mut SvgText, inner: PicturePanel, highest: f64, seconds: f64) {
    let bottom = inner.top + inner.height;
    let step = round_down(highest / 3.0);
    for k in 0..=(0..).take_while(|k| f64::from(*k) * step <= highest).last().unwrap_or(0) {
        let value = f64::from(k) * step;
        let y = bottom - inner.height * value / highest;
        out.polyline([[inner.left, y], [inner.left + inner.width, y]], "#e6e6e6", 1.0);
        out.text([inner.left - 8.0, y + 4.0], "end", "#333333", &short_number(value));
    }
    let (scale, unit) = if seconds < 1.0 { (1e3, "ms") } else { (1.0, "s") };
    for k in 0..=4 {
        let share = f64::from(k) / 4.0;
        let x = inner.left + inner.width * share;
        let words = format!("{} {unit}", short_number(seconds * scale * share));
        // The last label ends at the edge, because a centred one would leave the panel.
        out.text([x, bottom + 18.0], if k == 4 { "end" } else { "middle" }, "#333333", &words);
    }
}

fn draw_legend(out: &mut SvgText, panel: PicturePanel, curves: &[ChartCurve]) {
    out.text([panel.left + 10.0, panel.top + 20.0], "start", "#333333", "speed over its mean");
    let mut x = panel.left + panel.width - 16.0;
    for curve in curves.iter().rev() {
        out.text([x, panel.top + 20.0], "end", "#333333", curve.name);
        // A character of 12 px sans-serif is about 7 px wide.
        x -= 10.0 + 7.0 * curve.name.len() as f64;
        out.polyline([[x - 22.0, panel.top + 16.0], [x, panel.top + 16.0]], curve.colour, curve.width);
        x -= 38.0;
    }
}
