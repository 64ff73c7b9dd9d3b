//! Error over cost on logarithmic axes: one curve per method, with the sensor's own jitter and the
//! error from jumps.

use super::grid::StepRule;
use super::pick::ErrorMeasure;
use super::{SettingRow, StudyResult};
use gs2e_sensor::voltmeter::BetweenFrames;
use gs2e_trajectory::picture::{PicturePanel, SvgText};
use std::ops::RangeInclusive;

const SIZE: [f64; 2] = [960.0, 560.0];
const INNER: PicturePanel = PicturePanel { left: 80.0, top: 46.0, width: 590.0, height: 450.0 };
/// Colours of the rule sets, in order.
const COLOURS: [&str; 5] = ["#d1495b", "#2a7fb8", "#3a8f4f", "#8a5fb0", "#c98a1b"];
const GREY: &str = "#333333";
/// Margin at both ends of an axis, as a factor.
const ROOM: f64 = 1.25;
/// Position of the legend, and the distance of its lines, px.
const LEGEND: [f64; 2] = [690.0, 60.0];
const LINE: f64 = 18.0;

/// A logarithmic axis.
#[derive(Debug, Clone, Copy)]
struct LogAxis {
    low: f64,
    high: f64,
}

impl LogAxis {
    fn covering_values(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        // A logarithmic axis has no place for 0, and no values leave `low` infinite.
        (low > 0.0 && low.is_finite()).then(|| Self { low: low / ROOM, high: high * ROOM })
    }

    fn share(self, value: f64) -> f64 {
        libm::log(value / self.low) / libm::log(self.high / self.low)
    }

    /// 1, 2 and 5 times the powers of ten on the axis; the powers alone on a long axis.
    fn marks(self) -> Vec<f64> {
        let decades = libm::log10(self.high / self.low);
        let digits: &[f64] = if decades > 3.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        #[expect(clippy::cast_possible_truncation, reason = "exponents of floats are small")]
        let powers: RangeInclusive<i32> =
            libm::floor(libm::log10(self.low)) as i32..=libm::ceil(libm::log10(self.high)) as i32;
        let all = powers.flat_map(|power| digits.iter().map(move |digit| digit * libm::exp10(power.into())));
        all.filter(|mark| (self.low..=self.high).contains(mark)).collect()
    }
}

/// The chart of one measure as SVG; `None` if no setting has an error in it.
#[must_use]
pub fn chart_svg(study: &StudyResult, measure: ErrorMeasure) -> Option<String> {
    let drawn: Vec<(&SettingRow, f64)> =
        study.rows.iter().filter_map(|row| Some((row, measure.of(row).filter(|e| *e > 0.0)?))).collect();
    let lines = error_lines(study, measure);
    let cost = LogAxis::covering_values(drawn.iter().map(|(row, _)| row.core_s()))?;
    let lowest = drawn.iter().map(|(_, error)| *error).fold(f64::INFINITY, f64::min);
    // Lines far below everything would only compress the curves.
    let within = lines.iter().map(|line| line.error).filter(|error| *error > 0.2 * lowest);
    let error = LogAxis::covering_values(drawn.iter().map(|(_, error)| *error).chain(within))?;
    let mut out = SvgText::new(SIZE);
    let title = format!("{}: {}", study.scene, measure.title());
    out.text([INNER.left, 28.0], "start", GREY, &title);
    draw_axes(&mut out, cost, error, &study.machine());
    let at = |row: &SettingRow, value: f64| INNER.point([cost.share(row.core_s()), error.share(value)]);
    let mut entries: Vec<(String, MethodStyle)> = Vec::new();
    for (row, _) in &drawn {
        let method = row.method();
        if entries.iter().any(|(name, _)| *name == method) {
            continue;
        }
        let mut curve: Vec<&(&SettingRow, f64)> =
            drawn.iter().filter(|(row, _)| row.method() == method).collect();
        curve.sort_by_key(|(row, _)| row.rate);
        let look = MethodStyle::for_row(study, row);
        look.curve(&mut out, &curve.iter().map(|(row, value)| at(row, *value)).collect::<Vec<_>>());
        entries.push((method, look));
    }
    let mut named: Vec<f64> = Vec::new();
    for line in lines.iter().filter(|line| (error.low..=error.high).contains(&line.error)) {
        let ends = [0.0, 1.0].map(|x| INNER.point([x, error.share(line.error)]));
        draw_dashed(&mut out, &ends, line.colour, "2 4");
        // Lines may overlap, their labels may not.
        let mut y = ends[1][1] + 4.0;
        while named.iter().any(|other| (other - y).abs() < LINE) {
            y -= LINE;
        }
        out.text([ends[1][0] + 4.0, y], "start", line.colour, &line.words);
        named.push(y);
    }
    draw_legend(&mut out, &entries, error, &lines);
    Some(out.finish())
}

fn draw_axes(out: &mut SvgText, cost: LogAxis, error: LogAxis, machine: &str) {
    out.frame(INNER);
    let bottom = INNER.bottom();
    for mark in cost.marks() {
        let [x, _] = INNER.point([cost.share(mark), 0.0]);
        out.polyline([[x, INNER.top], [x, bottom]], "#eeeeee", 1.0);
        out.text([x, bottom + 18.0], "middle", GREY, &plain_number(mark));
    }
    for mark in error.marks() {
        let [_, y] = INNER.point([0.0, error.share(mark)]);
        out.polyline([[INNER.left, y], [INNER.left + INNER.width, y]], "#eeeeee", 1.0);
        out.text([INNER.left - 8.0, y + 4.0], "end", GREY, &plain_number(mark));
    }
    let below = [INNER.left + INNER.width / 2.0, bottom + 42.0];
    out.text(below, "middle", GREY, &format!("core-seconds ({machine})"));
}

/// A tick label: one digit and zeros.
fn plain_number(mark: f64) -> String {
    // Rounding to six decimals hides the error of a product like 2 * 1e-3.
    if (1e-4..1e5).contains(&mark) { format!("{}", (mark * 1e6).round() / 1e6) } else { format!("{mark:e}") }
}

/// Drawing style of a method: rules by colour, interpolation by dashes, steps by marks.
#[derive(Debug, Clone, Copy)]
struct MethodStyle {
    colour: &'static str,
    dashes: &'static str,
    filled: bool,
}

impl MethodStyle {
    fn for_row(study: &StudyResult, row: &SettingRow) -> Self {
        let rules = study.rules.iter().position(|of| of.rules == row.rules).unwrap_or(0);
        let dashes = match row.between {
            BetweenFrames::Hermite => "none",
            BetweenFrames::Catmull => "8 4",
            BetweenFrames::Linear => "2 3",
        };
        Self { colour: COLOURS[rules % COLOURS.len()], dashes, filled: row.steps == StepRule::Uniform }
    }

    fn curve(self, out: &mut SvgText, points: &[[f64; 2]]) {
        draw_dashed(out, points, self.colour, self.dashes);
        let fill = if self.filled { self.colour } else { "#ffffff" };
        for [x, y] in points {
            out.line(&format!(
                "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"3\" fill=\"{fill}\" stroke=\"{}\"/>",
                self.colour
            ));
        }
    }
}

fn draw_dashed(out: &mut SvgText, points: &[[f64; 2]], colour: &str, dashes: &str) {
    out.line(&format!("<g stroke-dasharray=\"{dashes}\">"));
    out.polyline(points.iter().copied(), colour, 1.4);
    out.line("</g>");
}

/// A horizontal line for an error that does not belong to a setting.
struct ErrorLine {
    error: f64,
    colour: &'static str,
    words: String,
}

/// The error from jumps for each rule set, and the sensor's jitter, if the measure has them.
fn error_lines(study: &StudyResult, measure: ErrorMeasure) -> Vec<ErrorLine> {
    let mut lines = Vec::new();
    for (of, colour) in study.rules.iter().zip(COLOURS) {
        let jumps = of.left_by_jumps().filter(|error| measure == ErrorMeasure::Rms && *error > 0.0);
        lines.extend(jumps.map(|error| ErrorLine { error, colour, words: format!("jumps of {}", of.rules) }));
    }
    let jitter = study.rules.first().and_then(|of| of.jitter);
    let jitter = jitter.and_then(|jitter| match measure {
        ErrorMeasure::Rms => Some(jitter.rms_th),
        ErrorMeasure::Median => Some(jitter.us),
        ErrorMeasure::Count | ErrorMeasure::Miscount | ErrorMeasure::P99 | ErrorMeasure::F1 => None,
    });
    let jitter = jitter.filter(|error| *error > 0.0);
    lines.extend(jitter.map(|error| ErrorLine {
        error,
        colour: GREY,
        words: "sensor's own jitter".to_owned(),
    }));
    lines
}

fn draw_legend(out: &mut SvgText, entries: &[(String, MethodStyle)], error: LogAxis, lines: &[ErrorLine]) {
    let [x, mut y] = LEGEND;
    // Labels of the lines stand at their right ends; the legend avoids them.
    let taken: Vec<f64> = lines.iter().map(|line| INNER.point([1.0, error.share(line.error)])[1]).collect();
    for (method, look) in entries {
        while taken.iter().any(|at| (at - y).abs() < LINE) {
            y += LINE;
        }
        look.curve(out, &[[x, y], [x + 34.0, y]]);
        out.text([x + 44.0, y + 4.0], "start", GREY, method);
        y += LINE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_marked_at_round_numbers() {
        let t = |low, high, wanted: &[f64]| {
            let found = LogAxis { low, high }.marks();
            assert_eq!(found.len(), wanted.len(), "{found:?}");
            assert!(found.iter().zip(wanted).all(|(a, b)| (a / b - 1.0).abs() < 1e-12), "{found:?}");
        };
        t(0.7, 6.0, &[1.0, 2.0, 5.0]);
        t(0.03, 0.2, &[0.05, 0.1, 0.2]);
        t(1e-4, 2.0, &[1e-4, 1e-3, 1e-2, 0.1, 1.0]);
        assert_eq!(plain_number(0.05), "0.05");
        assert_eq!(plain_number(2e-5), "2e-5");
        let axis = LogAxis::covering_values([1.0, 100.0].into_iter()).unwrap();
        assert!((axis.share(10.0) - 0.5).abs() < 1e-12);
    }
}
