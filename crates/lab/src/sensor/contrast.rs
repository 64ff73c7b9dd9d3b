//! Check `contrast`: pixels at constant light are shown one step each. The share of pixels that
//! answer, as a function of the height of the step, is the distribution of their thresholds.
//!
//! Mean and spread are sums over the columns of the picture, each of a height of its own
//! (Spearman and Kaerber): with the share `p` of answers, the mean is the first height plus the sum
//! of `1 - p`, and no form of the distribution is assumed. The mean of a symmetric distribution is
//! the height to which half of the pixels answer.

use super::show;
use gs2e_event::Polarity;
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::{SensorChoice, SensorError};
use serde::Serialize;

/// Greys before the step.
pub const GREYS: [f64; 3] = [10.0, 60.0, 200.0];
/// Columns and rows of pixels: 100 heights, 100 pixels each.
const SIZE: Size = Size { width: 100, height: 100 };
/// Length of the step, ns.
const STEP_NS: i64 = 1000;
/// Shortest time for answers, ns. The noise of the voltage must be small over it.
const ANSWER_NS: i64 = 100_000;
/// Time constants of a filter that the answer waits for.
const SETTLED: f64 = 10.0;
/// Range of heights around the stated contrast: in stated spreads, and as a share of the contrast.
const RANGE: [f64; 2] = [4.0, 0.15];
/// Largest deviation of the 50 % point from the stated contrast.
const WITHIN: f64 = 0.03;
/// Largest deviation of the spread from the stated one.
const SPREAD_WITHIN: f64 = 0.1;

/// The answers to steps of one polarity at one light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContrastRow {
    /// Grey before the step.
    pub grey: f64,
    /// True for rising steps, which ask for ON events.
    pub on: bool,
    /// Stated contrast, in the quantity that the sensor compares.
    pub stated: f64,
    /// Height to which half of the pixels answer; `None` if no or all heights are answered.
    pub found: Option<f64>,
    /// Stated standard deviation over the pixels.
    pub stated_spread: f64,
    /// Standard deviation over the pixels.
    pub found_spread: f64,
    /// Height and share of answers, for each column.
    pub answers: Vec<[f64; 2]>,
    /// The verdict.
    pub passes: bool,
}

/// Measures `measured_sensor` against the statement of `stated`; the same sensor, unless a mistake is
/// planted. `unit` is a factor on the greys, and 1 for a sensor that reads its frames as stated.
///
/// # Errors
/// The sensor cannot be simulated.
pub fn measure_contrast(
    stated: &SensorChoice,
    measured_sensor: &SensorChoice,
    unit: f64,
) -> Result<Vec<ContrastRow>, SensorError> {
    let cases = GREYS.into_iter().flat_map(|grey| [(grey, true), (grey, false)]);
    cases.map(|(grey, on)| measure_step(stated, measured_sensor, unit, grey, on)).collect()
}

#[expect(clippy::cast_possible_truncation, reason = "greys are f32, and times are below a minute")]
fn measure_step(
    stated: &SensorChoice,
    measured_sensor: &SensorChoice,
    unit: f64,
    grey: f64,
    on: bool,
) -> Result<ContrastRow, SensorError> {
    let model = stated.as_model();
    let (up, down) = model.contrast();
    let contrast = if on { up } else { down };
    let stated_spread = model.contrast_spread();
    // Below 0.98 of the contrast no step reaches zero, at which a column would see no change at
    // all.
    let reach = (RANGE[0] * stated_spread).max(RANGE[1] * contrast).min(0.98 * contrast);
    let columns = SIZE.width as usize;
    let spacing = 2.0 * reach / columns as f64;
    let height = |column: usize| contrast - reach + spacing * (column as f64 + 0.5);
    let after: Vec<f64> = (0..columns)
        .map(|column| {
            let height = if on { height(column) } else { -height(column) };
            grey_at(|grey| model.brightness(grey), model.brightness(grey) + height)
        })
        .collect();
    let settling = SETTLED * model.settling_seconds(grey.min(after[columns - 1]));
    // A slow filter needs so long that shot noise would answer in place of the step. The noise of the
    // photoreceptor is in the voltage before the step.
    let returns = measured_sensor.as_voltmeter().is_some_and(|found| !found.photoreceptor_noise.is_absent());
    let quiet = (settling > 1e-3 || returns).then(|| measured_sensor.without_noise());
    let until = STEP_NS + ANSWER_NS.max((settling * 1e9) as i64);
    let picture = |greys: &dyn Fn(usize) -> f64| -> Vec<f32> {
        (0..SIZE.pixels()).map(|pixel| (unit * greys(pixel % columns)) as f32).collect()
    };
    let (before, after) = (picture(&|_| grey), picture(&|column| after[column]));
    let frames = [(0, before), (STEP_NS, after.clone()), (until, after)];
    let events = show(quiet.as_ref().unwrap_or(measured_sensor), SIZE, &frames, Seed(1))?;
    let mut answered = vec![false; SIZE.pixels()];
    let wanted = if on { Polarity::On } else { Polarity::Off };
    for event in events.iter().filter(|event| event.polarity == wanted) {
        answered[usize::from(event.y) * columns + usize::from(event.x)] = true;
    }
    let share = |column: usize| {
        let rows = answered.iter().skip(column).step_by(columns);
        rows.filter(|answered| **answered).count() as f64 / f64::from(SIZE.height)
    };
    let answers: Vec<[f64; 2]> = (0..columns).map(|column| [height(column), share(column)]).collect();
    Ok(judge(ContrastRow {
        grey,
        on,
        stated: contrast,
        found: None,
        stated_spread,
        found_spread: 0.0,
        answers,
        passes: false,
    }))
}

/// Fills in mean, spread and verdict of a row with answers.
fn judge(row: ContrastRow) -> ContrastRow {
    let [first, last] = [&row.answers[0], &row.answers[row.answers.len() - 1]];
    // Without both ends the distribution is cut off, and its mean is unknown.
    if first[1] > 0.5 || last[1] < 0.5 {
        return row;
    }
    let spacing = (last[0] - first[0]) / (row.answers.len() - 1) as f64;
    let start = first[0] - 0.5 * spacing;
    let [mut mean, mut square] = [0.0; 2];
    for [height, share] in &row.answers {
        // Sums of the survival function: `E x` and `E x^2` of a quantity above `start`.
        mean += (1.0 - share) * spacing;
        square += 2.0 * (height - start) * (1.0 - share) * spacing;
    }
    let (found, found_spread) = (start + mean, (square - mean * mean).max(0.0).sqrt());
    // Below a fiftieth of the contrast a spread is lost in the noise of the voltage.
    let has_spread = row.stated_spread > 0.02 * row.stated;
    let spread_holds = !has_spread || (found_spread / row.stated_spread - 1.0).abs() <= SPREAD_WITHIN;
    let passes = spread_holds && (found / row.stated - 1.0).abs() <= WITHIN;
    ContrastRow { found: Some(found), found_spread, passes, ..row }
}

/// The grey of this brightness, by bisection: brightness rises with grey.
fn grey_at(brightness: impl Fn(f64) -> f64, wanted: f64) -> f64 {
    // Bisection: brightness grows with grey in every model, and the inverse of a front end is not
    // stated anywhere.
    let (mut low, mut high) = (0.0, 1e6);
    // A hundred halvings of 1e6 end at 1e-24, below any grey that matters.
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if brightness(middle) < wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_sensor::v2e::{V2eModel, V2ePreset};
    use gs2e_sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};

    fn passes(stated: &SensorChoice, measured_sensor: &SensorChoice, unit: f64) -> bool {
        let rows = measure_contrast(stated, measured_sensor, unit).unwrap();
        for row in &rows {
            let ContrastRow { grey, on, stated, found, stated_spread, found_spread, passes, .. } = row;
            println!(
                "grey {grey} on {on}: {found:.4?} of {stated:.4}, spread {found_spread:.4} of {stated_spread:.4}: {passes}"
            );
        }
        rows.iter().all(|row| row.passes)
    }

    #[test]
    fn half_of_the_pixels_answer_to_the_stated_contrast() {
        for preset in VoltmeterPreset::ALL {
            let sensor = preset.model().into();
            println!("{preset:?}");
            assert!(passes(&sensor, &sensor, 1.0));
        }
        let esim = gs2e_sensor::esim::EsimModel::default().into();
        assert!(passes(&esim, &esim, 1.0));
        for preset in V2ePreset::ALL {
            let v2e = V2eModel::from(preset).into();
            assert!(passes(&v2e, &v2e, 1.0), "{preset:?}");
        }
    }

    #[test]
    fn planted_mistakes_of_units_are_found() {
        let stated = VoltmeterPreset::Davis346.model();
        let [k1, k2, k3, k4, k5, k6] = stated.k;
        let with = |k| SensorChoice::from(VoltmeterModel { k, ..stated.clone() });
        let sensor = with(stated.k);
        // Rates per millisecond that were meant per second: the noise grows with the root.
        let root = 1000f64.sqrt();
        assert!(!passes(&sensor, &with([k1, k2, k3 * root, k4 * 1e3, k5 * 1e3, k6 * root]), 1.0));
        // Frames from 0 to 1 to a sensor that reads 0 to 255.
        assert!(!passes(&sensor, &sensor, 1.0 / 255.0));
        // A gain per decade to a sensor with natural logarithms, and the reverse.
        assert!(!passes(&sensor, &with([k1 / std::f64::consts::LN_10, k2, k3, k4, k5, k6]), 1.0));
        assert!(!passes(&sensor, &with([k1 * std::f64::consts::LN_10, k2, k3, k4, k5, k6]), 1.0));
    }

    #[test]
    fn a_planted_spread_is_given_back_within_a_tenth() {
        let spread = |threshold_spread| {
            SensorChoice::from(VoltmeterModel { threshold_spread, ..VoltmeterPreset::Evk4.model() })
        };
        assert!(!passes(&spread(0.0434), &spread(0.0434 * 1.2), 1.0));
        assert!(!passes(&spread(0.0434), &spread(0.0434 * 0.8), 1.0));
    }
}
