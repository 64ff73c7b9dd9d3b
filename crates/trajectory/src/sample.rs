//! Time and place of each pose: the speed law's shares of time and of the path.

use super::TrajectoryError;
use super::curve::PoseCurve;
use super::metric::running_sums;
use crate::speed::{SpeedChoice, SpeedLaw, SpeedMeaning};
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::units::Hertz;
use serde::{Deserialize, Serialize};

/// Summation of a speed law over a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SummationRule {
    /// A sum over the poses, as in the paper.
    Sum,
    /// The integral of the law.
    Integral,
}

/// A speed law sampled at the poses (the paper's equations 10 and 14 to 16).
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSchedule {
    /// `u_j = v(j / (M-1))` of every step, M-1 values.
    pub speeds: Vec<f64>,
    /// The share of the whole path before each pose: M values, from 0, never falling, to exactly 1.
    pub shares: Vec<f64>,
    /// Summation of the law.
    pub law: SummationRule,
    meaning: SpeedMeaning,
}

/// Duration of a step, s. `speeds` are the law's values, one per step.
pub(super) fn step_seconds(meaning: SpeedMeaning, rate: Hertz, speeds: &[f64], step: usize) -> f64 {
    match meaning {
        SpeedMeaning::Speed => 1.0 / rate.to_f64(),
        SpeedMeaning::FrameRate => 1.0 / (rate.to_f64() * speeds[step]),
    }
}

impl PoseSchedule {
    /// The schedule of `speed` over `count >= 1` poses. Under [`SpeedMeaning::FrameRate`], steps
    /// are the inverse of the law's values, which has no closed integral here, so the left sum is
    /// used.
    ///
    /// # Errors
    /// The law is not positive and finite at a pose, which its proof excludes.
    pub fn new(speed: &SpeedChoice, count: usize, summation: SummationRule) -> Result<Self, TrajectoryError> {
        let (law, steps) = (speed.as_law(), count.saturating_sub(1));
        let meaning = speed.meaning();
        let speeds = law_speeds(law, steps)?;
        let shares = match (meaning, summation) {
            (SpeedMeaning::Speed, SummationRule::Sum) => left_sums(speeds.iter().copied()),
            (SpeedMeaning::Speed, SummationRule::Integral) => {
                // A single pose has no step, but the law divides by the number of steps.
                ends_at_one(law.distances(steps.max(1))[..=steps].to_vec())
            }
            (SpeedMeaning::FrameRate, _) => left_sums(speeds.iter().map(|v| 1.0 / v)),
        };
        let law = if meaning == SpeedMeaning::FrameRate { SummationRule::Sum } else { summation };
        Ok(Self { speeds, shares, law, meaning })
    }

    /// Duration of a step, s.
    pub(super) fn seconds(&self, rate: Hertz, step: usize) -> f64 {
        step_seconds(self.meaning, rate, &self.speeds, step)
    }

    /// The stamp of every pose, microseconds: see [`stamps_us`].
    pub(super) fn stamps_us(&self, rate: Hertz) -> Result<Vec<i64>, TrajectoryError> {
        let stamps = stamps_us(rate, self.meaning, &self.speeds);
        // Steps of less than a microsecond may round to equal stamps, which readers refuse.
        match stamps.array_windows().position(|[a, b]| a >= b) {
            None => Ok(stamps),
            Some(step) => Err(TrajectoryError::Stamps { step, value: self.speeds[step] }),
        }
    }
}

/// Stamps of all poses for the speeds of all steps, microseconds: `round(j / rate)`, or for frame
/// rates the rounded sums of `1 / (rate v_j)`.
#[must_use]
pub fn stamps_us(rate: Hertz, meaning: SpeedMeaning, speeds: &[f64]) -> Vec<i64> {
    match meaning {
        SpeedMeaning::Speed => (0..=speeds.len() as u64).map(|j| rate.stamp_us(j)).collect(),
        SpeedMeaning::FrameRate => {
            let steps = speeds.iter().map(|v| 1e6 / (rate.to_f64() * v));
            running_sums(steps).into_iter().map(whole_micros).collect()
        }
    }
}

/// Rounded half up, like the stamps of a constant rate.
#[expect(clippy::cast_possible_truncation, reason = "casts saturate; equal stamps are refused")]
fn whole_micros(us: f64) -> i64 {
    (us + 0.5).floor() as i64
}

fn law_speeds(law: &dyn SpeedLaw, steps: usize) -> Result<Vec<f64>, TrajectoryError> {
    // The speed of a step is the law's value at its start, as in a left sum: `v(1)` is never used.
    let speeds: Vec<f64> = (0..steps).map(|j| law.speed(j as f64 / steps as f64)).collect();
    match speeds.iter().position(|v| !(*v > 0.0 && v.is_finite())) {
        None => Ok(speeds),
        Some(j) => Err(TrajectoryError::Speed { t: j as f64 / steps as f64, value: speeds[j] }),
    }
}

/// The share of all steps before each step, and 1.
fn left_sums(steps: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
    // Division by the largest value first keeps the sum finite for every law.
    let largest = steps.clone().fold(0.0, f64::max);
    ends_at_one(running_sums(steps.map(|v| v / largest)))
}

/// Ascending lengths as shares of the last: exactly 1 there, and nowhere more.
fn ends_at_one(mut lengths: Vec<f64>) -> Vec<f64> {
    let last = lengths.len() - 1;
    if last > 0 {
        let total = lengths[last];
        // Rounding may lift an inner length above the last one. A share above 1 would leave the
        // curve.
        lengths.iter_mut().for_each(|s| *s = (*s / total).min(1.0));
        lengths[last] = 1.0;
    }
    lengths
}

/// Places at the given shares of the curve's parameter. This is the paper's literal reading; the
/// parameter is the length of the chords between knots, which is not a length of the curve.
pub(super) fn places_by_chord(curve: &dyn PoseCurve, shares: &[f64]) -> Vec<CurvePlace> {
    let steps = curve.steps();
    let before = running_sums(steps.iter().copied());
    let total = before[steps.len()];
    let place = |share: &f64| {
        let s = share * total;
        // The last boundary is left out of the search, so that a share of 1 falls into the last
        // segment.
        let segment = before[1..steps.len()].partition_point(|b| *b <= s);
        CurvePlace { segment, x: (s - before[segment]).clamp(0.0, steps[segment]) }
    };
    shares.iter().map(place).collect()
}
