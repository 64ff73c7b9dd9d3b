//! Rigid motions.
//!
//! Names give both ends: `world_from_camera` maps camera coordinates to world coordinates, so
//! spaces cancel by eye. The world is the source's own right-handed frame and scale. Camera axes
//! are OpenCV's (x right, y down, z forward). OpenGL's axes (nerfstudio, Blender) differ by
//! [`OPENCV_FROM_OPENGL`] on the camera's side only.
//!
//! Angles are in radians. Everything here is `f64`, and every transcendental function comes from
//! `libm`, so that a path has the same bits on every machine.
//!
//! # Examples
//!
//! ```
//! use glam::DVec3;
//! use gs2e_num::se3::{Se3, look_at};
//!
//! // A camera that looks along x, with the top of its image towards z.
//! let rotation = look_at(DVec3::X, DVec3::Z).ok_or("both directions are parallel")?;
//! let world_from_camera = Se3 { rotation, translation: DVec3::new(2.0, 0.0, 0.0) };
//! // Its own z axis points forward, and its y axis points down.
//! assert!((rotation * DVec3::Z).distance(DVec3::X) < 1e-12);
//! assert!((rotation * DVec3::Y).distance(-DVec3::Z) < 1e-12);
//! // A motion after its inverse is no motion.
//! let camera_from_camera = world_from_camera.inverse().compose(&world_from_camera);
//! assert!(camera_from_camera.translation.length() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod arc_length;
pub mod rotation;
pub mod rotation_spline;
pub mod screen;
mod series;
pub mod spline;
pub mod sum;

use glam::{DMat3, DQuat, DVec3};
pub use screen::{RotationError, ScreenedRotation, rotation_from_matrix, rotation_from_quaternion};

/// Diagonal of the matrix that turns OpenGL camera axes (x right, y up, z back) into OpenCV's and
/// back.
pub const OPENCV_FROM_OPENGL: DVec3 = DVec3::new(1.0, -1.0, -1.0);

/// A rotation followed by a translation: `x_a = rotation * x_b + translation` for a motion
/// `a_from_b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Se3 {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Translation, in units of the target space. For `world_from_camera` this is the camera's
    /// centre.
    pub translation: DVec3,
}

impl Se3 {
    /// No motion.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The inverse: `b_from_a` for this `a_from_b`.
    #[must_use]
    #[inline]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// This motion after another: `a_from_c` for this `a_from_b` and a `b_from_c`. Nothing is renormalised,
    /// so that a motion without a rotation leaves the bits of the other rotation.
    #[must_use]
    #[inline]
    pub fn compose(&self, b_from_c: &Self) -> Self {
        Self {
            rotation: self.rotation * b_from_c.rotation,
            translation: self.rotation * b_from_c.translation + self.translation,
        }
    }

    /// The rotation as a matrix.
    #[must_use]
    pub fn rotation_matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Rows of the 4x4 matrix that maps homogeneous points.
    #[must_use]
    pub fn matrix_rows(&self) -> [[f64; 4]; 4] {
        let columns = self.rotation_matrix().to_cols_array_2d();
        let t = self.translation.to_array();
        let row = |i: usize| [columns[0][i], columns[1][i], columns[2][i], t[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// Returns true if every component is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

/// Derivative of a pose `world_from_body` by a parameter, or the derivative of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Derivative of the translation, in world axes, units.
    pub linear: DVec3,
    /// Body rate, in the body's own axes, radians.
    pub angular: DVec3,
}

/// The rotation, world from camera, of a camera that looks along `forward` with the top of its
/// image towards `up`. `None` if they are parallel, zero or not finite.
#[must_use]
pub fn look_at(forward: DVec3, up: DVec3) -> Option<DQuat> {
    /// Sine of the angle between both directions below which the top of the image is undefined.
    const MIN_NORM: f64 = 1e-9;
    let (forward, up) = (forward.try_normalize()?, up.try_normalize()?);
    let right = forward.cross(up);
    let sine = right.length();
    (sine > MIN_NORM).then(|| {
        let right = right / sine;
        // The columns are orthonormal up to rounding only.
        DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward)).normalize()
    })
}
