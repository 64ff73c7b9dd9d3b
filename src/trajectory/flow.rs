//! Speed in physical terms: how fast the picture moves.
//!
//! The median optical flow of a frame is measured at places evenly spread over the path, per unit of the path's mixed
//! length. Between them its logarithm is a C2 cubic spline: positive, however far the values are apart. The integral is
//! the path's length in pixels, which says how long the trajectory takes and where each pose lies.

use super::TrajectoryError;
use super::curve::{Measured, PoseCurve};
use crate::se3::arc_length::{ArcLength, Pace};
use crate::se3::spline::{CubicSpline, Place};
use crate::se3::{Se3, Twist};
use glam::DVec3;

/// Places at which the flow is measured.
const PLACES: u32 = 65;
/// How near to an end of the path, as a share of it.
const END: f64 = 1e-6;

/// What measures how fast the picture moves.
pub trait FlowMeter {
    /// The median over a frame's pixels of the optical flow, px per unit of the parameter that `twist` is by, for a
    /// camera at this pose; `None` where no pixel has a depth.
    ///
    /// # Errors
    /// Where the frame cannot be rendered, with the reason.
    fn median_px(&mut self, world_from_camera: &Se3, twist: &Twist) -> Result<Option<f64>, String>;
}

/// The length of a path in pixels of median flow.
#[derive(Debug)]
pub(super) struct FlowLength {
    arc: ArcLength<Exponential>,
    /// Mixed length between two measured places.
    unit: f64,
}

/// The flow per place between measured places, from the spline of its logarithm.
#[derive(Debug)]
struct Exponential(CubicSpline);

impl Pace for Exponential {
    fn pace(&self, at: Place) -> f64 {
        libm::exp(self.0.segment(at.segment).value(at.x).x)
    }
}

impl FlowLength {
    /// Measures the flow along a curve; `placed` turns its poses into the world's.
    pub(super) fn measure(
        arc: &ArcLength<Measured<'_>>,
        curve: &dyn PoseCurve,
        placed: impl Fn(Se3) -> Se3,
        meter: &mut dyn FlowMeter,
    ) -> Result<Self, TrajectoryError> {
        let segments = PLACES - 1;
        let unit = arc.total() / f64::from(segments);
        let mut walk = arc.walk();
        let mut logarithms = Vec::with_capacity(PLACES as usize);
        for k in 0..PLACES {
            let share = f64::from(k) / f64::from(segments);
            // The ends themselves may be at rest in the curve's parameter.
            let at = walk.to(share.clamp(END, 1.0 - END) * arc.total());
            let Twist { linear, angular } = curve.twist(at);
            // By measured places instead of by the parameter: the flow's own spline counts those.
            let scale = unit / arc.pace(at);
            let twist = Twist { linear: linear * scale, angular: angular * scale };
            let found = meter.median_px(&placed(curve.pose(at)), &twist);
            let median = found.map_err(|because| TrajectoryError::Flow { share, because })?;
            match median {
                Some(px) if px > 0.0 && px.is_finite() => logarithms.push(DVec3::X * libm::log(px)),
                Some(px) => return Err(TrajectoryError::Flow { share, because: format!("it is {px} px") }),
                None => {
                    let because = "no pixel has a depth".to_owned();
                    return Err(TrajectoryError::Flow { share, because });
                }
            }
        }
        let steps = vec![1.0; segments as usize];
        let spline = CubicSpline::not_a_knot(&steps, &logarithms);
        Ok(Self { arc: ArcLength::measure(&steps, Exponential(spline)), unit })
    }

    /// px.
    pub(super) fn total(&self) -> f64 {
        self.arc.total()
    }

    /// The mixed lengths at the given shares of the flow's length, which do not fall.
    pub(super) fn mixed_lengths(&self, shares: &[f64]) -> Vec<f64> {
        let mut walk = self.arc.walk();
        let mixed = |share: &f64| {
            let at = walk.to(share * self.arc.total());
            (at.segment as f64 + at.x) * self.unit
        };
        shares.iter().map(mixed).collect()
    }
}
