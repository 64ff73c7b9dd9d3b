//! The curve `slerp-lerp`: straight lines between centres, slerps between rotations. It is an
//! ablation: both rates jump at the knots.

use super::PoseCurve;
use glam::DVec3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::se3::rotation_spline::turn_between;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};

/// Lines and slerps through every knot.
#[derive(Debug, Clone, PartialEq)]
pub struct SlerpLerp {
    steps: Vec<f64>,
    starts: Vec<Se3>,
    /// Constant rates of each segment.
    twists: Vec<Twist>,
}

impl SlerpLerp {
    /// The curve through `knots`, with `steps[i] > 0` as the length of the parameter from knot i to
    /// knot i+1.
    ///
    /// # Panics
    /// There are fewer than two knots, or their number is not one more than that of steps.
    #[must_use]
    pub fn through_knots(steps: Vec<f64>, knots: &[Se3]) -> Self {
        assert!(knots.len() >= 2 && steps.len() + 1 == knots.len(), "a step lies between any two knots");
        let rates = |(w, h): (&[Se3], &f64)| Twist {
            linear: (w[1].translation - w[0].translation) / *h,
            angular: turn_between(w[0].rotation, w[1].rotation).0 / *h,
        };
        let twists = knots.windows(2).zip(&steps).map(rates).collect();
        Self { starts: knots[..steps.len()].to_vec(), steps, twists }
    }
}

impl PoseCurve for SlerpLerp {
    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn pose(&self, at: CurvePlace) -> Se3 {
        let (start, rates) = (&self.starts[at.segment], &self.twists[at.segment]);
        let rotation = (start.rotation * exp_vector(rates.angular * at.x)).normalize();
        Se3 { rotation, translation: start.translation + rates.linear * at.x }
    }

    fn twist(&self, at: CurvePlace) -> Twist {
        self.twists[at.segment]
    }

    fn acceleration(&self, _: CurvePlace) -> Twist {
        Twist { linear: DVec3::ZERO, angular: DVec3::ZERO }
    }
}
