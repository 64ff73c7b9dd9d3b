//! A camera at a place and a time.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! use gs2e_scene::camera::{Camera, view::{CameraVelocity, CameraView}};
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! let still = CameraView::at_rest(camera, Se3::IDENTITY);
//! assert_eq!((still.velocity, still.seconds), (CameraVelocity::default(), 0.0));
//! // The same view half a second later, of a camera that goes forward.
//! let velocity = CameraVelocity { linear: DVec3::Z, angular: DVec3::ZERO };
//! let moving = CameraView { velocity, ..still.at_time(0.5) };
//! assert_eq!((moving.world_from_camera, moving.seconds), (still.world_from_camera, 0.5));
//! ```

use super::Camera;
use glam::DVec3;
use gs2e_num::se3::Se3;

/// A camera, its pose and its velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraView {
    /// Intrinsics and image size.
    pub camera: Camera,
    /// Pose, with OpenCV camera axes.
    pub world_from_camera: Se3,
    /// Velocity, for channels that are rates.
    pub velocity: CameraVelocity,
    /// Time from the first pose of the trajectory, s: moving objects of the scene are where they are then.
    pub seconds: f64,
}

/// Velocity of a camera, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraVelocity {
    /// Linear velocity, scene units per second.
    pub linear: DVec3,
    /// Angular velocity, radians per second.
    pub angular: DVec3,
}

impl CameraView {
    /// This view at another time, s.
    #[must_use]
    pub fn at_time(self, seconds: f64) -> Self {
        Self { seconds, ..self }
    }

    /// A view of a camera at rest.
    #[must_use]
    pub fn at_rest(camera: Camera, world_from_camera: Se3) -> Self {
        Self { camera, world_from_camera, velocity: CameraVelocity::default(), seconds: 0.0 }
    }
}
