//! The curve `cubic`: a C2 cubic spline on centres and a C2 rotation spline, on one set of knots.
//!
//! The parameter is the paper's `s`, the mixed length of the chords between knots, divided by the
//! unit of the steps.

use super::PoseCurve;
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation_spline::{RotationSpline, SplineDiverged};
use gs2e_num::se3::spline::{CubicSpline, CurvePlace};
use gs2e_num::se3::{Se3, Twist};

/// A pair of C2 splines through every knot.
#[derive(Debug, Clone, PartialEq)]
pub struct CubicPair {
    steps: Vec<f64>,
    centres: CubicSpline,
    rotations: RotationSpline,
}

impl CubicPair {
    /// The splines through `knots`, with `steps[i] > 0` as the length of the parameter from knot i
    /// to knot i+1.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// There are fewer than two knots, or their number is not one more than that of steps.
    pub fn through_knots(steps: Vec<f64>, knots: &[Se3]) -> Result<Self, SplineDiverged> {
        Self::with(steps, knots, RotationSpline::new)
    }

    /// As [`CubicPair::through_knots`], with these body rates at the first and at the last knot.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// As [`CubicPair::through_knots`].
    pub fn with_end_rates(steps: Vec<f64>, knots: &[Se3], ends: [DVec3; 2]) -> Result<Self, SplineDiverged> {
        Self::with(steps, knots, |steps, rotations| RotationSpline::with_end_rates(steps, rotations, ends))
    }

    fn with(
        steps: Vec<f64>,
        knots: &[Se3],
        turning: impl FnOnce(&[f64], &[DQuat]) -> Result<RotationSpline, SplineDiverged>,
    ) -> Result<Self, SplineDiverged> {
        let centres: Vec<DVec3> = knots.iter().map(|k| k.translation).collect();
        let rotations: Vec<DQuat> = knots.iter().map(|k| k.rotation).collect();
        Ok(Self {
            centres: CubicSpline::not_a_knot(&steps, &centres),
            rotations: turning(&steps, &rotations)?,
            steps,
        })
    }
}

impl PoseCurve for CubicPair {
    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn pose(&self, at: CurvePlace) -> Se3 {
        let translation = self.centres.segment(at.segment).value(at.x);
        Se3 { rotation: self.rotations.rotation(at), translation }
    }

    fn twist(&self, at: CurvePlace) -> Twist {
        let linear = self.centres.segment(at.segment).slope(at.x);
        Twist { linear, angular: self.rotations.rate(at) }
    }

    fn acceleration(&self, at: CurvePlace) -> Twist {
        let linear = self.centres.segment(at.segment).bend(at.x);
        Twist { linear, angular: self.rotations.acceleration(at) }
    }
}
