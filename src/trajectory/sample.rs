//! Where on the curve each pose lies: the speed law's shares of the path, and the places that keep them.

use super::TrajectoryError;
use super::curve::{Measured, PoseCurve};
use super::metric::running_sums;
use crate::se3::arc_length::ArcLength;
use crate::se3::spline::Place;
use crate::se3::sum::Sum;
use crate::speed::Law;

/// A speed law sampled at the poses (the paper's equations 10 and 14 to 16).
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    /// `u_j = v(j / (M-1))` of every step, M-1 values.
    pub speeds: Vec<f64>,
    /// The share of the whole path that lies before each pose: M values, 0 first, never falling, exactly 1 last.
    pub shares: Vec<f64>,
}

impl Schedule {
    /// The left sum of `law` over `count >= 1` poses.
    ///
    /// # Errors
    /// Where the law is not positive and finite at a pose, which its proof excludes.
    pub fn left_sum(law: &dyn Law, count: usize) -> Result<Self, TrajectoryError> {
        let steps = count.saturating_sub(1);
        let speeds: Vec<f64> = (0..steps).map(|j| law.speed(j as f64 / steps as f64)).collect();
        if let Some((j, value)) =
            speeds.iter().copied().enumerate().find(|(_, v)| !(*v > 0.0 && v.is_finite()))
        {
            return Err(TrajectoryError::Speed { t: j as f64 / steps as f64, value });
        }
        // Dividing by the largest first keeps the sum finite for every law.
        let largest = speeds.iter().copied().fold(0.0, f64::max);
        let relative: Vec<f64> = speeds.iter().map(|v| v / largest).collect();
        let total = Sum::of(relative.iter().copied());
        let mut shares = running_sums(&relative);
        if steps > 0 {
            shares.iter_mut().for_each(|s| *s = (*s / total).min(1.0));
            shares[steps] = 1.0;
        }
        Ok(Self { speeds, shares })
    }
}

/// Places at the given shares of the knots' chord length: the paper's literal reading, whose parameter is no length
/// of the curve.
pub(super) fn places_by_chord(curve: &PoseCurve, shares: &[f64]) -> Vec<Place> {
    let steps = curve.steps();
    let before = running_sums(steps);
    let total = before[steps.len()];
    let place = |share: &f64| {
        let s = share * total;
        let segment = before[1..steps.len()].partition_point(|b| *b <= s);
        Place { segment, x: (s - before[segment]).clamp(0.0, steps[segment]) }
    };
    shares.iter().map(place).collect()
}

/// Places at the given shares of the curve's own length.
pub(super) fn places_by_length(arc: &ArcLength<Measured<'_>>, shares: &[f64]) -> Vec<Place> {
    shares.iter().map(|share| arc.invert(share * arc.total())).collect()
}
