//! Rigid motions.
//!
//! Names say both ends: `world_from_camera` turns camera coordinates into world coordinates, so spaces cancel by
//! eye. The world is the source's own right-handed frame and scale. Camera axes are OpenCV's (x right, y down, z
//! forward); OpenGL's (nerfstudio, Blender) differ by [`OPENCV_FROM_OPENGL`] on the camera's side only.
//!
//! Angles are radians. Everything here is `f64`, and every transcendental comes from `libm`, so that a path has the
//! same bits on every machine.

pub mod arc_length;
pub mod rotation;
pub mod rotation_spline;
pub mod screen;
mod series;
pub mod spline;
pub mod sum;

use glam::{DMat3, DQuat, DVec3};
pub use screen::{RotationError, Screened, rotation_from_matrix, rotation_from_quaternion};

/// Diagonal of the matrix that turns OpenGL camera axes (x right, y up, z back) into OpenCV's and back.
pub const OPENCV_FROM_OPENGL: DVec3 = DVec3::new(1.0, -1.0, -1.0);

/// A rotation followed by a translation: `x_a = rotation * x_b + translation` for a motion `a_from_b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Se3 {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// In units of the target space; for `world_from_camera` this is the camera's centre.
    pub translation: DVec3,
}

impl Se3 {
    /// No motion.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The motion `b_from_a` of this `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The rotation as a matrix.
    #[must_use]
    pub fn rotation_matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Whether every number of it is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

/// How fast a pose `world_from_body` changes with a parameter; or how fast that changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Derivative of the translation: world axes, units.
    pub linear: DVec3,
    /// Body rate, in the body's own axes, radians.
    pub angular: DVec3,
}

/// The rotation, world from camera, of a camera that looks along `forward` with the top of its image towards `up`;
/// `None` where they are parallel, zero or not finite.
#[must_use]
pub fn look_at(forward: DVec3, up: DVec3) -> Option<DQuat> {
    /// Sine of the angle between the two below which the image has no top.
    const LEAST: f64 = 1e-9;
    let (forward, up) = (forward.try_normalize()?, up.try_normalize()?);
    let right = forward.cross(up);
    let sine = right.length();
    (sine > LEAST).then(|| {
        let right = right / sine;
        DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward)).normalize()
    })
}
