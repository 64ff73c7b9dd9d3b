//! The curve of poses through the knots.

use super::metric::Metric;
use crate::se3::Se3;
use crate::se3::arc_length::Pace;
use crate::se3::rotation::canonical;
use crate::se3::rotation_spline::{RotationSpline, Unsettled};
use crate::se3::spline::{CubicSpline, Place};
use glam::{DQuat, DVec3};

/// A fitted curve: `cubic` of the recipe, a C2 cubic spline on centres and a C2 rotation spline on one set of knots.
///
/// Its parameter is the paper's `s`, the mixed length of the chords between knots, divided by the mean chord, so that
/// no capture's scale can overflow or underflow it.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseCurve {
    /// Length of each segment in the parameter.
    steps: Vec<f64>,
    /// The world coordinates that centres are relative to.
    origin: DVec3,
    centres: CubicSpline,
    rotations: RotationSpline,
}

impl PoseCurve {
    /// The curve through `knots`, whose centres are relative to `origin`, with `steps[i] > 0` in the parameter from
    /// knot i to knot i+1.
    ///
    /// # Errors
    /// Where the rotation spline does not settle.
    ///
    /// # Panics
    /// Unless there are at least two knots and one step fewer than knots.
    pub fn cubic(steps: Vec<f64>, knots: &[Se3], origin: DVec3) -> Result<Self, Unsettled> {
        let centres: Vec<DVec3> = knots.iter().map(|k| k.translation).collect();
        let rotations: Vec<DQuat> = knots.iter().map(|k| k.rotation).collect();
        Ok(Self {
            centres: CubicSpline::not_a_knot(&steps, &centres),
            rotations: RotationSpline::new(&steps, &rotations)?,
            steps,
            origin,
        })
    }

    /// Length of each segment in the parameter.
    #[must_use]
    pub fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// The pose at a place, camera to world, its quaternion with `w >= 0`.
    #[must_use]
    pub fn pose(&self, at: Place) -> Se3 {
        let centre = self.centres.segment(at.segment).value(at.x);
        Se3 { rotation: canonical(self.rotations.rotation(at)), translation: self.origin + centre }
    }

    /// Derivative of the centre by the parameter, world axes.
    #[must_use]
    pub fn velocity(&self, at: Place) -> DVec3 {
        self.centres.segment(at.segment).slope(at.x)
    }

    /// Body rate by the parameter, camera axes, rad.
    #[must_use]
    pub fn body_rate(&self, at: Place) -> DVec3 {
        self.rotations.rate(at)
    }
}

/// A curve seen through a metric: its pace is the mixed speed `alpha |omega| + beta / D |C'|`.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// The curve.
    pub curve: &'a PoseCurve,
    /// The metric.
    pub metric: Metric,
}

impl Pace for Measured<'_> {
    fn pace(&self, at: Place) -> f64 {
        self.metric.mix(self.curve.body_rate(at).length(), self.curve.velocity(at).length())
    }
}
