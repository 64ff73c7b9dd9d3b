//! Cameras on a rigid body: their paths, from the path of the body.
//!
//! A camera at the place `t` in the axes of a body at `world_from_body = (R, p)` has its centre at `p + R t`
//! and the velocity `v + R (w x t)`, with the velocity `v` of the body's origin in world axes and its body
//! rate `w`.

use super::Trajectory;
use super::course::CourseKind;
use super::flow::FlowMeter;
use super::report::SpeedReport;
use glam::{DQuat, DVec3};
use gs2e_num::se3::{Se3, Twist};
use serde::Serialize;

/// Place of a camera on a body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraMount {
    /// Centre of the camera in the axes of the body, scene units.
    pub position: DVec3,
    /// Rotation from the axes of the camera to those of the body, as the recipe writes it: a quaternion whose
    /// length is 1 to its own rounding.
    pub rotation: DQuat,
}

impl CameraMount {
    /// The motion `body_from_camera`.
    #[must_use]
    pub fn body_from_camera(&self) -> Se3 {
        Se3 { rotation: self.rotation.normalize(), translation: self.position }
    }

    /// Pose of the camera for a pose of the body.
    #[must_use]
    pub fn pose(&self, world_from_body: &Se3) -> Se3 {
        world_from_body.compose(&self.body_from_camera())
    }

    /// Twist of the camera for a pose and a twist of the body.
    #[must_use]
    pub fn twist(&self, world_from_body: &Se3, twist: &Twist) -> Twist {
        Twist {
            linear: twist.linear + world_from_body.rotation * twist.angular.cross(self.position),
            angular: self.body_from_camera().rotation.conjugate() * twist.angular,
        }
    }
}

impl Trajectory {
    /// The path of a camera on a body that follows this path.
    #[must_use]
    pub fn of_mounted(&self, mount: &CameraMount) -> Self {
        Self {
            world_from_camera: self.world_from_camera.iter().map(|pose| mount.pose(pose)).collect(),
            stamps_us: self.stamps_us.clone(),
        }
    }
}

impl SpeedReport {
    /// The report on a camera with these poses, from that of its body. The asked speeds remain those of the
    /// body; nothing is asked of the camera, so there are no ratios. `None` if the numbers of poses differ.
    #[must_use]
    pub fn of_mounted(&self, poses: &[Se3]) -> Option<Self> {
        Some(Self {
            kind: CourseKind::Mounted,
            length_ratio: None,
            knot_distance: None,
            knot_jumps: None,
            flow: None,
            merged: Vec::new(),
            gaps: Vec::new(),
            mixed_ratio: None,
            mixed_chord_ratio: None,
            linear_ratio: None,
            angular_ratio: None,
            warnings: Vec::new(),
            ..self.remeasured(poses, None)?
        })
    }
}

/// Measures the image motion of a camera on a body.
pub struct MountedMeter<'m> {
    /// The meter of the camera.
    pub meter: &'m mut dyn FlowMeter,
    /// Its place on the body.
    pub mount: CameraMount,
}

impl std::fmt::Debug for MountedMeter<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MountedMeter").field("mount", &self.mount).finish_non_exhaustive()
    }
}

impl FlowMeter for MountedMeter<'_> {
    fn median_px(&mut self, world_from_body: &Se3, twist: &Twist) -> Result<Option<f64>, String> {
        self.meter.median_px(&self.mount.pose(world_from_body), &self.mount.twist(world_from_body, twist))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twist::pose_twists;
    use gs2e_num::se3::rotation::exp_vector;

    fn mount() -> CameraMount {
        CameraMount { position: DVec3::new(0.3, -0.2, 0.1), rotation: exp_vector(DVec3::new(0.2, -0.7, 0.4)) }
    }

    /// A body that turns about an axis that turns itself.
    fn body(t: f64) -> Se3 {
        let rotation = exp_vector(DVec3::new(0.0, 0.0, 2.0 * t))
            * exp_vector(DVec3::new(0.8 * libm::sin(3.0 * t), 0.0, 0.0));
        Se3 { rotation, translation: DVec3::new(libm::sin(2.0 * t), libm::cos(3.0 * t), t * t) }
    }

    /// Its twist in closed form.
    fn body_twist(t: f64) -> Twist {
        let tilt = 0.8 * libm::sin(3.0 * t);
        let about_z = 2.0 * DVec3::new(0.0, libm::sin(tilt), libm::cos(tilt));
        Twist {
            linear: DVec3::new(2.0 * libm::cos(2.0 * t), -3.0 * libm::sin(3.0 * t), 2.0 * t),
            angular: about_z + DVec3::new(2.4 * libm::cos(3.0 * t), 0.0, 0.0),
        }
    }

    #[test]
    fn the_twist_of_a_mounted_camera_is_the_difference_of_its_poses() {
        for t in [0.0, 0.13, 0.4, 0.77] {
            let found = mount().twist(&body(t), &body_twist(t));
            // Fourth order over 2 ms: 1.6e-11/30 of fifth derivatives below 1e3.
            let times: Vec<f64> = (-2..=2).map(|k| f64::from(k) * 1e-3).collect();
            let poses: Vec<Se3> = times.iter().map(|dt| mount().pose(&body(t + dt))).collect();
            let wanted = pose_twists(&poses, &times)[2];
            assert!((found.linear - wanted.linear).length() < 1e-9, "{t}: {found:?} {wanted:?}");
            assert!((found.angular - wanted.angular).length() < 1e-9, "{t}: {found:?} {wanted:?}");
        }
    }

    #[test]
    fn a_point_of_the_body_is_seen_from_where_the_camera_is() {
        // A point at the camera's centre has the coordinates zero in the camera.
        let (pose, mount) = (body(0.3), mount());
        let world = pose.rotation * mount.position + pose.translation;
        let camera = mount.pose(&pose).inverse();
        assert!((camera.rotation * world + camera.translation).length() < 1e-15);
    }
}
