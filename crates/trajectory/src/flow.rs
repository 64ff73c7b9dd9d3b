//! Speed in physical terms: image motion.
//!
//! The median optical flow of a frame is measured at places spread evenly over the path, per unit
//! of the path's mixed length. Between them, its logarithm is a C2 cubic spline, so the flow is
//! positive for any ratio of the values. The integral is the path's length in pixels, which
//! determines the duration and the place of each pose.

use super::TrajectoryError;
use super::curve::{MeasuredCurve, PoseCurve};
use glam::DVec3;
use gs2e_num::se3::arc_length::{ArcLength, CurveSpeed};
use gs2e_num::se3::spline::{CubicSpline, CurvePlace};
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::stats::nearest_ranks;
use serde::{Deserialize, Serialize};

/// Number of places at which the flow is measured.
const PLACES: u32 = 65;
/// Distance of the first and last place from the ends of the path, as a share of it.
const END: f64 = 1e-6;

/// Quantiles of a set of values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlowQuantiles {
    /// The median: half of the values are at most this.
    pub median: f32,
    /// 95 % of the values are at most this.
    pub p95: f32,
    /// The largest value.
    pub max: f32,
}

impl FlowQuantiles {
    /// Quantiles of the values that are not NaN, by [`nearest_ranks`]. `None` if no value is left.
    #[must_use]
    pub fn from_values(values: Vec<f32>) -> Option<Self> {
        nearest_ranks(values, [50, 95, 100]).map(|[median, p95, max]| Self { median, p95, max })
    }
}

/// Measures the image motion of a moving camera.
pub trait FlowMeter {
    /// The median optical flow over the pixels of a frame, px per unit of the parameter of `twist`,
    /// for a camera at this pose. `None` if no pixel has a depth.
    ///
    /// # Errors
    /// The frame cannot be rendered; the text is the reason.
    fn median_px(&mut self, world_from_camera: &Se3, twist: &Twist) -> Result<Option<f64>, String>;
}

/// The length of a path in pixels of median flow.
#[derive(Debug)]
pub(super) struct FlowLength {
    arc: ArcLength<FlowSpline>,
    /// Mixed length between two measured places.
    unit: f64,
}

/// The flow per unit of place index, from the spline of its logarithm.
#[derive(Debug)]
struct FlowSpline(CubicSpline);

impl CurveSpeed for FlowSpline {
    fn pace(&self, at: CurvePlace) -> f64 {
        libm::exp(self.0.segment(at.segment).value(at.x).x)
    }
}

impl FlowLength {
    /// Measures the flow along a curve. `placed` turns its poses into world poses.
    pub(super) fn measure_flow(
        arc: &ArcLength<MeasuredCurve<'_>>,
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
            // The curve may be at rest in its parameter at the ends.
            let at = walk.to(share.clamp(END, 1.0 - END) * arc.total());
            let Twist { linear, angular } = curve.twist(at);
            // In units of the place index, not of the parameter: the spline of the flow uses the
            // same unit.
            let scale = unit / arc.pace(at);
            let twist = Twist { linear: linear * scale, angular: angular * scale };
            let found = meter.median_px(&placed(curve.pose(at)), &twist);
            let median = found.map_err(|because| TrajectoryError::Flow { share, because })?;
            match median {
                Some(px) if px > 0.0 && px.is_finite() => logarithms.push(DVec3::X * libm::log(px)),
                Some(px) => {
                    return Err(TrajectoryError::Flow {
                        share,
                        because: format!("the median flow is {px} px"),
                    });
                }
                None => {
                    let because = "no pixel has a depth".to_owned();
                    return Err(TrajectoryError::Flow { share, because });
                }
            }
        }
        let steps = vec![1.0; segments as usize];
        // The spline is one of vectors, so each logarithm lies on the x-axis.
        let spline = CubicSpline::not_a_knot(&steps, &logarithms);
        Ok(Self { arc: ArcLength::measure_curve(&steps, FlowSpline(spline)), unit })
    }

    /// Total length, px.
    pub(super) fn total(&self) -> f64 {
        self.arc.total()
    }

    /// The mixed lengths at ascending shares of the flow's length.
    pub(super) fn mixed_lengths(&self, shares: &[f64]) -> Vec<f64> {
        let mut walk = self.arc.walk();
        let mixed = |share: &f64| {
            let at = walk.to(share * self.arc.total());
            (at.segment as f64 + at.x) * self.unit
        };
        shares.iter().map(mixed).collect()
    }
}
