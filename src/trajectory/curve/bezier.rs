//! The curve `bezier`.
use super::PoseCurve;
use crate::se3::rotation_spline::Unsettled;
use crate::se3::spline::Place;
use crate::se3::{Se3, Twist};

/// A Bezier curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Bezier;

impl Bezier {
    /// Fits.
    ///
    /// # Errors
    /// Where the rotation spline does not settle.
    pub fn fit(_degree: u32, _steps: &[f64], _knots: &[Se3]) -> Result<Self, Unsettled> {
        unimplemented!()
    }
}

impl PoseCurve for Bezier {
    fn steps(&self) -> &[f64] {
        unimplemented!()
    }
    fn pose(&self, _: Place) -> Se3 {
        unimplemented!()
    }
    fn twist(&self, _: Place) -> Twist {
        unimplemented!()
    }
    fn acceleration(&self, _: Place) -> Twist {
        unimplemented!()
    }
}
