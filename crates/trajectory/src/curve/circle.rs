//! The curve of an orbit: a circle about an axis, along which the camera turns.
//!
//! In closed form: centre and rotation turn about the axis by the same angle, so both speeds are
//! constant.

use super::PoseCurve;
use glam::DVec3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};

/// A turn of a pose about an axis, one segment of length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CirclePath {
    /// A point of the axis.
    centre: DVec3,
    /// Direction of the axis. Its length is the whole turn in radians.
    turn: DVec3,
    start: Se3,
}

impl CirclePath {
    /// The turn of `start` about the axis through `centre` along `turn`, by `|turn|` radians.
    #[must_use]
    pub fn new(centre: DVec3, turn: DVec3, start: Se3) -> Self {
        Self { centre, turn, start }
    }

    /// The vector from the axis point to the camera at a place.
    fn arm(&self, at: CurvePlace) -> DVec3 {
        exp_vector(self.turn * at.x) * (self.start.translation - self.centre)
    }
}

impl PoseCurve for CirclePath {
    fn steps(&self) -> &[f64] {
        &[1.0]
    }

    fn pose(&self, at: CurvePlace) -> Se3 {
        let rotation = (exp_vector(self.turn * at.x) * self.start.rotation).normalize();
        Se3 { rotation, translation: self.centre + self.arm(at) }
    }

    fn twist(&self, at: CurvePlace) -> Twist {
        // The turn leaves its own axis in place, so the axis is the same in the camera at every
        // place.
        let angular = self.start.rotation.conjugate() * self.turn;
        Twist { linear: self.turn.cross(self.arm(at)), angular }
    }

    fn acceleration(&self, at: CurvePlace) -> Twist {
        Twist { linear: self.turn.cross(self.turn.cross(self.arm(at))), angular: DVec3::ZERO }
    }
}
