//! Curves of poses through (or near) the knots.
//!
//! One file per family. All but [`Bezier`] are piecewise. A place is a segment and the parameter
//! since its start, so a long path loses no digits. Translations are relative to the origin of the
//! course.

mod bezier;
mod circle;
mod cubic;
mod cumulative;
mod slerp_lerp;

pub use bezier::{Bezier, MOST_DEGREE};
pub use circle::Circle;
pub use cubic::Cubic;
pub use cumulative::Cumulative;
pub use slerp_lerp::SlerpLerp;

use super::Warning;
use super::metric::Metric;
use crate::se3::arc_length::Pace;
use crate::se3::rotation_spline::Unsettled;
use crate::se3::spline::Place;
use crate::se3::{Se3, Twist};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A curve of poses over a parameter, smooth inside each segment.
pub trait PoseCurve: fmt::Debug + Send + Sync {
    /// Length of each segment in the parameter. At least one, all positive.
    fn steps(&self) -> &[f64];

    /// The pose at a place. The quaternion has unit length and either sign.
    fn pose(&self, at: Place) -> Se3;

    /// Derivative of the pose by the parameter.
    fn twist(&self, at: Place) -> Twist;

    /// Derivative of the twist by the parameter.
    fn acceleration(&self, at: Place) -> Twist;

    /// The place of a knot: the start of its segment, or the end of the last segment.
    fn knot(&self, number: usize) -> Place {
        let steps = self.steps();
        match steps.get(number) {
            Some(_) => Place { segment: number, x: 0.0 },
            None => Place { segment: steps.len() - 1, x: steps[steps.len() - 1] },
        }
    }

    /// The degree of a Bezier curve, which may be lower than requested.
    fn degree(&self) -> Option<u32> {
        None
    }

    /// The deviation of the curve from the requested kind, if there is one.
    fn warning(&self) -> Option<Warning> {
        None
    }
}

/// The kind of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// C2 cubic spline on centres, C2 rotation spline; through every knot.
    Cubic,
    /// Uniform cumulative cubic B-spline on R^3 x SO(3) with threefold end knots. It passes near
    /// the knots, and is C2.
    Cumulative,
    /// Straight lines and slerps through every knot. Rates jump at the knots.
    SlerpLerp,
    /// One Bezier curve of this degree, by least squares, through both ends.
    Bezier {
        /// Degree, 1 to [`MOST_DEGREE`].
        degree: u32,
    },
}

impl Curve {
    /// The curve through `knots`, with `steps[i] > 0` as the length of the parameter from knot i to
    /// knot i+1.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// There are fewer than two knots, or their number is not one more than that of steps.
    pub fn through(self, steps: Vec<f64>, knots: &[Se3]) -> Result<Box<dyn PoseCurve>, Unsettled> {
        Ok(match self {
            Self::Cubic => Box::new(Cubic::through_knots(steps, knots)?),
            Self::Cumulative => Box::new(Cumulative::near_knots(knots)),
            Self::SlerpLerp => Box::new(SlerpLerp::through_knots(steps, knots)),
            Self::Bezier { degree } => Box::new(Bezier::fit_knots(degree, &steps, knots)?),
        })
    }
}

/// A curve with a metric. Its pace is the mixed speed `alpha |omega| + beta / D |C'|`.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// The curve.
    pub curve: &'a dyn PoseCurve,
    /// The metric.
    pub metric: Metric,
}

impl Pace for Measured<'_> {
    fn pace(&self, at: Place) -> f64 {
        let Twist { linear, angular } = self.curve.twist(at);
        self.metric.mix(angular.length(), linear.length())
    }
}
