//! The curve `bezier`: one Bezier curve near all knots, from the first to the last.
//!
//! Control points at the ends are fixed to the knots. Those between are the least-squares fit at
//! the parameters `x_k = s_k / s_(K-1)`. Rotations are fitted in the same way, as rotation vectors
//! `log(mean^-1 R_k)` about the mean of all knots. The parameter of the curve is `s`, as for the
//! other curves. Its segments are those between knots; the polynomial is the same on all of them.

mod least_squares;
mod pinned;

use super::PoseCurve;
use crate::TrajectoryWarning;
use crate::metric::running_sums;
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::{exp_vector, log_vector, settled_mean};
use gs2e_num::se3::rotation_spline::{RotationSpline, SplineDiverged, quadratic_part, rate_from_slope_times};
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};
use pinned::PinnedBulge;
use std::f64::consts::PI;

/// Maximum degree. The condition of its basis, 1e6, leaves ten digits.
pub const MAX_DEGREE: u32 = 20;
/// Largest angle from the mean for which rotations are fitted. Beyond a half turn, their vectors
/// would jump.
const WIDEST: f64 = 170.0 / 180.0 * PI;

/// A Bezier curve near its knots.
#[derive(Debug, Clone, PartialEq)]
pub struct BezierCurve {
    steps: Vec<f64>,
    /// The parameter at each knot.
    before: Vec<f64>,
    degree: u32,
    centres: PinnedBulge,
    rotations: RotationControl,
}

#[derive(Debug, Clone, PartialEq)]
enum RotationControl {
    /// Rotation vectors about a mean.
    AboutMean(DQuat, PinnedBulge),
    /// A spline through the knots; for two knots, their slerp.
    Spline(RotationSpline),
}

impl BezierCurve {
    /// The curve near `knots`, with `steps[i] > 0` as the length of the parameter from knot i to
    /// knot i+1. K knots determine a degree of K-1. A higher degree is reduced to that, since its
    /// elevated form is the same curve. A degree out of range is replaced by the nearest in range.
    ///
    /// Rotations follow the C2 rotation spline if one is more than 170 degrees from the mean of
    /// all, if there is no mean, or if the vectors of neighbours lie more than a half turn apart
    /// (the fit would then take the long way round).
    ///
    /// # Errors
    /// That rotation spline does not converge.
    ///
    /// # Panics
    /// There are fewer than two knots, or their number is not one more than that of steps.
    pub(crate) fn fit_knots(degree: u32, steps: &[f64], knots: &[Se3]) -> Result<Self, SplineDiverged> {
        assert!(knots.len() >= 2 && steps.len() + 1 == knots.len(), "a step lies between any two knots");
        let determined = u32::try_from(steps.len()).unwrap_or(u32::MAX).min(MAX_DEGREE);
        let degree = degree.clamp(1, determined);
        let before = running_sums(steps.iter().copied());
        // Bernstein polynomials are over 0 to 1, so the parameter enters as a share of the whole.
        let x: Vec<f64> = before.iter().map(|s| s / before[steps.len()]).collect();
        let fit = |points: &[DVec3]| PinnedBulge::fit_points(degree as usize, &x, points);
        let rotations: Vec<DQuat> = knots.iter().map(|k| k.rotation).collect();
        Ok(Self {
            degree,
            centres: fit(&knots.iter().map(|k| k.translation).collect::<Vec<_>>()),
            rotations: match about_mean(&rotations) {
                Some((mean, vectors)) => RotationControl::AboutMean(mean, fit(&vectors)),
                None => RotationControl::Spline(RotationSpline::new(steps, &rotations)?),
            },
            steps: steps.to_vec(),
            before,
        })
    }

    /// Length of the parameter.
    fn whole(&self) -> f64 {
        self.before[self.steps.len()]
    }

    /// The share of the parameter before a place.
    fn share(&self, at: CurvePlace) -> f64 {
        // The sum may round above the whole at the end of the last segment.
        ((self.before[at.segment] + at.x) / self.whole()).min(1.0)
    }
}

/// The mean of more than two rotations and their vectors from it, if a curve can be fitted to
/// these.
fn about_mean(rotations: &[DQuat]) -> Option<(DQuat, Vec<DVec3>)> {
    // Two knots determine degree 1, whose curve is their slerp. The spline is that slerp, without a
    // limit on the angle.
    if rotations.len() == 2 {
        return None;
    }
    // On a path that turns one way the middle rotation lies nearest to the mean, so few rounds are needed.
    let mean = settled_mean(rotations, rotations[rotations.len() / 2]).ok()?;
    let vectors: Vec<DVec3> = rotations.iter().map(|r| log_vector(mean.conjugate() * *r)).collect();
    let near = vectors.iter().all(|r| r.length() <= WIDEST);
    let no_leap = vectors.windows(2).all(|w| (w[1] - w[0]).length() <= PI);
    (near && no_leap).then_some((mean, vectors))
}

impl PoseCurve for BezierCurve {
    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn pose(&self, at: CurvePlace) -> Se3 {
        let x = self.share(at);
        let rotation = match &self.rotations {
            RotationControl::AboutMean(mean, vectors) => (*mean * exp_vector(vectors.value(x))).normalize(),
            RotationControl::Spline(spline) => spline.rotation(at),
        };
        Se3 { rotation, translation: self.centres.value(x) }
    }

    fn twist(&self, at: CurvePlace) -> Twist {
        // The polynomials are over the share of the parameter, rates are per unit of the parameter.
        let (x, whole) = (self.share(at), self.whole());
        let angular = match &self.rotations {
            RotationControl::AboutMean(_, vectors) => {
                rate_from_slope_times(vectors.value(x), vectors.slope(x) / whole)
            }
            RotationControl::Spline(spline) => spline.rate(at),
        };
        Twist { linear: self.centres.slope(x) / whole, angular }
    }

    fn acceleration(&self, at: CurvePlace) -> Twist {
        let (x, whole) = (self.share(at), self.whole());
        let angular = match &self.rotations {
            RotationControl::AboutMean(_, vectors) => {
                let (r, slope) = (vectors.value(x), vectors.slope(x) / whole);
                rate_from_slope_times(r, vectors.bend(x) / whole / whole) + quadratic_part(r, slope)
            }
            RotationControl::Spline(spline) => spline.acceleration(at),
        };
        Twist { linear: self.centres.bend(x) / whole / whole, angular }
    }

    fn degree(&self) -> Option<u32> {
        Some(self.degree)
    }

    fn warning(&self) -> Option<TrajectoryWarning> {
        // For two knots the spline is the curve that was asked for, so there is no warning.
        let instead = matches!(self.rotations, RotationControl::Spline(_)) && self.steps.len() > 1;
        instead.then_some(TrajectoryWarning::Spread)
    }
}
