//! Curves of poses through (or near) the knots.
//!
//! One file per family. All but [`BezierCurve`] are piecewise. A place is a segment and the
//! parameter since its start, so a long path loses no digits. Translations are relative to the
//! origin of the course.

mod bezier;
mod circle;
mod cubic;
mod cumulative;
mod slerp_lerp;

pub use bezier::{BezierCurve, MAX_DEGREE};
pub use circle::CirclePath;
pub use cubic::CubicPair;
pub use cumulative::CumulativeSpline;
pub use slerp_lerp::SlerpLerp;

use super::TrajectoryWarning;
use super::metric::MixedMetric;
use gs2e_num::se3::arc_length::CurveSpeed;
use gs2e_num::se3::rotation_spline::SplineDiverged;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A curve of poses over a parameter, smooth inside each segment.
pub trait PoseCurve: fmt::Debug + Send + Sync {
    /// Length of each segment in the parameter. At least one, all positive.
    fn steps(&self) -> &[f64];

    /// The pose at a place. The quaternion has unit length and either sign.
    fn pose(&self, at: CurvePlace) -> Se3;

    /// Derivative of the pose by the parameter.
    fn twist(&self, at: CurvePlace) -> Twist;

    /// Derivative of the twist by the parameter.
    fn acceleration(&self, at: CurvePlace) -> Twist;

    /// The place of a knot: the start of its segment, or the end of the last segment.
    fn knot(&self, number: usize) -> CurvePlace {
        let steps = self.steps();
        match steps.get(number) {
            Some(_) => CurvePlace { segment: number, x: 0.0 },
            None => CurvePlace { segment: steps.len() - 1, x: steps[steps.len() - 1] },
        }
    }

    /// The degree of a Bezier curve, which may be lower than requested.
    fn degree(&self) -> Option<u32> {
        None
    }

    /// The deviation of the curve from the requested kind, if there is one.
    fn warning(&self) -> Option<TrajectoryWarning> {
        None
    }
}

/// The kind of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CurveKind {
    /// C2 cubic spline on centres, C2 rotation spline; through every knot.
    Cubic,
    /// Uniform cumulative cubic B-spline on R^3 x SO(3) with threefold end knots. It passes near
    /// the knots, and is C2.
    Cumulative,
    /// Straight lines and slerps through every knot. Rates jump at the knots.
    SlerpLerp,
    /// One Bezier curve of this degree, by least squares, through both ends.
    Bezier {
        /// Degree, 1 to [`MAX_DEGREE`].
        degree: u32,
    },
}

impl CurveKind {
    /// The curve through `knots`, with `steps[i] > 0` as the length of the parameter from knot i to
    /// knot i+1.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// There are fewer than two knots, or their number is not one more than that of steps.
    pub fn through(self, steps: Vec<f64>, knots: &[Se3]) -> Result<Box<dyn PoseCurve>, SplineDiverged> {
        Ok(match self {
            Self::Cubic => Box::new(CubicPair::through_knots(steps, knots)?),
            // A uniform spline has the index of the knot as its parameter, so chord lengths play no
            // part.
            Self::Cumulative => Box::new(CumulativeSpline::near_knots(knots)),
            Self::SlerpLerp => Box::new(SlerpLerp::through_knots(steps, knots)),
            Self::Bezier { degree } => Box::new(BezierCurve::fit_knots(degree, &steps, knots)?),
        })
    }
}

/// A curve with a metric. Its pace is the mixed speed `alpha |omega| + beta / D |C'|`.
#[derive(Debug, Clone, Copy)]
pub struct MeasuredCurve<'a> {
    /// The curve.
    pub curve: &'a dyn PoseCurve,
    /// The metric.
    pub metric: MixedMetric,
}

impl CurveSpeed for MeasuredCurve<'_> {
    fn pace(&self, at: CurvePlace) -> f64 {
        let Twist { linear, angular } = self.curve.twist(at);
        self.metric.mix(angular.length(), linear.length())
    }
}
