//! The picture of a sensor study: the answers to steps, and the noise against light.

use super::SensorStudy;
use super::contrast::ContrastRow;
use super::noise_curve::NoiseRow;
use gs2e_sensor::SensorChoice;
use gs2e_trajectory::picture::{PicturePanel, SvgText, short_number};

const SIZE: [f64; 2] = [1040.0, 440.0];
const STEPS: PicturePanel = PicturePanel { left: 70.0, top: 46.0, width: 410.0, height: 330.0 };
const NOISE: PicturePanel = PicturePanel { left: 570.0, top: 46.0, width: 440.0, height: 330.0 };
/// Colours of ON and OFF.
const COLOURS: [&str; 2] = ["#d1495b", "#2a7fb8"];
const GREY: &str = "#333333";
const LIGHT: &str = "#eeeeee";

/// Number of lights at which the predicted rates are drawn.
const CURVE: u32 = 80;

/// The picture as SVG. `name` is that of the sensor.
#[must_use]
pub fn study_svg(name: &str, sensor: &SensorChoice, study: &SensorStudy) -> String {
    let mut out = SvgText::new(SIZE);
    out.text([STEPS.left, 28.0], "start", GREY, &format!("{name}: share of pixels that answer to a step"));
    draw_steps(&mut out, &study.contrast);
    out.text([NOISE.left, 28.0], "start", GREY, "noise at constant light, Hz");
    draw_noise(&mut out, sensor, &study.noise.rows);
    out.finish()
}

/// Round numbers within a range, four to ten of them.
fn round_marks([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    let decade = libm::exp10(libm::floor(libm::log10((high - low) / 4.0)));
    let step =
        [5.0, 2.0].map(|n| n * decade).into_iter().find(|step| 4.0 * step <= high - low).unwrap_or(decade);
    let first = (low / step).ceil();
    (0..).map(move |i| (first + f64::from(i)) * step).take_while(move |mark| *mark <= high)
}

fn draw_steps(out: &mut SvgText, rows: &[ContrastRow]) {
    out.frame(STEPS);
    let heights = || rows.iter().flat_map(|row| &row.answers).map(|[height, _]| *height);
    let [low, high] = [heights().fold(f64::INFINITY, f64::min), heights().fold(1e-9, f64::max)];
    // At the left edge no pixel answers, and at the right edge all do.
    let x = |height: f64| (height - low) / (high - low);
    for share in [0.0, 0.5, 1.0] {
        out.polyline([STEPS.point([0.0, share]), STEPS.point([1.0, share])], LIGHT, 1.0);
        let [x, y] = STEPS.point([0.0, share]);
        out.text([x - 8.0, y + 4.0], "end", GREY, &share.to_string());
    }
    for mark in round_marks([low, high]) {
        out.polyline([STEPS.point([x(mark), 0.0]), STEPS.point([x(mark), 1.0])], LIGHT, 1.0);
        let [left, _] = STEPS.point([x(mark), 0.0]);
        out.text([left, STEPS.bottom() + 18.0], "middle", GREY, &short_number(mark));
    }
    for row in rows {
        let colour = COLOURS[usize::from(!row.on)];
        out.polyline(row.answers.iter().map(|[h, share]| STEPS.point([x(*h), *share])), colour, 1.2);
        let stated = x(row.stated);
        out.line("<g stroke-dasharray=\"2 4\">");
        out.polyline([STEPS.point([stated, 0.0]), STEPS.point([stated, 1.0])], colour, 1.0);
        out.line("</g>");
    }
    let middle = STEPS.left + STEPS.width / 2.0;
    let words = "height of the step (contrast) at three lights; red ON, blue OFF, dotted: stated";
    out.text([middle, STEPS.bottom() + 42.0], "middle", GREY, words);
}

/// A logarithmic axis: its ends.
#[derive(Debug, Clone, Copy)]
struct DecadeAxis {
    low: f64,
    high: f64,
}

impl DecadeAxis {
    /// Whole decades around positive values.
    fn covering(values: impl Iterator<Item = f64>) -> Self {
        let values = values.filter(|value| *value > 0.0 && value.is_finite());
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return Self { low: 0.1, high: 1.0 };
        }
        let low = libm::exp10(libm::floor(libm::log10(low)));
        Self { low, high: libm::exp10(libm::ceil(libm::log10(high))).max(10.0 * low) }
    }

    fn share(self, value: f64) -> f64 {
        libm::log(value / self.low) / libm::log(self.high / self.low)
    }

    fn marks(self) -> impl Iterator<Item = f64> {
        std::iter::successors(Some(self.low), |mark| Some(10.0 * mark))
            .take_while(move |mark| *mark <= 1.001 * self.high)
    }
}

fn draw_noise(out: &mut SvgText, sensor: &SensorChoice, rows: &[NoiseRow]) {
    out.frame(NOISE);
    let light = |row: &NoiseRow| row.lux.unwrap_or(row.grey);
    let x = DecadeAxis::covering(rows.iter().map(light));
    let rates =
        |row: &NoiseRow| row.predicted.into_iter().chain(row.found).chain(row.anchor.into_iter().flatten());
    let y = DecadeAxis::covering(rows.iter().flat_map(rates).filter(|rate| *rate > 1e-4));
    for mark in x.marks() {
        let share = x.share(mark);
        out.polyline([NOISE.point([share, 0.0]), NOISE.point([share, 1.0])], LIGHT, 1.0);
        out.text([NOISE.point([share, 0.0])[0], NOISE.bottom() + 18.0], "middle", GREY, &short_number(mark));
    }
    for mark in y.marks() {
        let share = y.share(mark);
        out.polyline([NOISE.point([0.0, share]), NOISE.point([1.0, share])], LIGHT, 1.0);
        let [left, up] = NOISE.point([0.0, share]);
        out.text([left - 8.0, up + 4.0], "end", GREY, &short_number(mark));
    }
    let at = |light: f64, rate: f64| NOISE.point([x.share(light), y.share(rate.max(y.low))]);
    for (side, colour) in COLOURS.into_iter().enumerate() {
        out.polyline(
            predicted(sensor, rows, side).into_iter().map(|[light, rate]| at(light, rate)),
            colour,
            1.4,
        );
        for row in rows {
            if let Some(published) = row.anchor {
                draw_cross(out, at(light(row), published[side]), published[side] <= 0.0);
            }
            let [cx, cy] = at(light(row), row.found[side]);
            out.line(&format!("<circle cx=\"{cx:.2}\" cy=\"{cy:.2}\" r=\"3\" fill=\"{colour}\"/>"));
        }
    }
    let unit = if rows.iter().any(|row| row.lux.is_some()) { "lux" } else { "grey" };
    let words = format!("{unit}; red ON, blue OFF; lines: predicted, dots: simulated, crosses: published");
    out.text([NOISE.left + NOISE.width / 2.0, NOISE.bottom() + 42.0], "middle", GREY, &words);
}

/// A published rate. A rate of 0 has no place on the axis, and stands at its lower end with a word.
fn draw_cross(out: &mut SvgText, [left, up]: [f64; 2], is_zero: bool) {
    out.polyline([[left - 6.0, up], [left + 6.0, up]], GREY, 1.6);
    out.polyline([[left, up - 6.0], [left, up + 6.0]], GREY, 1.6);
    if is_zero {
        out.text([left - 10.0, up - 5.0], "end", GREY, "0 Hz");
    }
}

/// Light and predicted rate from the darkest to the brightest row, evenly spaced on the axis.
fn predicted(sensor: &SensorChoice, rows: &[NoiseRow], side: usize) -> Vec<[f64; 2]> {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Vec::new() };
    let model = sensor.as_model();
    (0..=CURVE)
        .map(|i| {
            let grey = first.grey * libm::pow(last.grey / first.grey, f64::from(i) / f64::from(CURVE));
            let noise = model.array_noise(grey);
            let on = noise.total_hz * noise.on_share.unwrap_or(0.0);
            [grey * first.lux.unwrap_or(first.grey) / first.grey, [on, noise.total_hz - on][side]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_within_the_range() {
        let t = |range, wanted: &[f64]| {
            let found: Vec<f64> = round_marks(range).collect();
            assert!(found.len() == wanted.len(), "{found:?}");
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-12), "{found:?}");
        };
        t([0.124, 0.176], &[0.13, 0.14, 0.15, 0.16, 0.17]);
        t([0.05, 0.338], &[0.05, 0.1, 0.15, 0.2, 0.25, 0.3]);
        t([1.0, 9.0], &[2.0, 4.0, 6.0, 8.0]);
    }
}
