//! Views of moving objects: each object is seen from the camera's place in the object's own axes.
//!
//! Let a point rest in the axes of an object, which moves with the velocity `v` of its origin `T` and the
//! angular velocity `W`, in world axes. In the axes of a camera at `C` that moves with `v_c` and `w_c`, the
//! point `q` moves by
//!
//! ```text
//! qdot = -(v_c - u) - (w_c - r) x q,    u = R_c^T (v + W x (C - T)),    r = R_c^T W
//! ```
//! which is the motion of a point at rest for a camera with the velocities in brackets. The object's
//! projection, the direction from which its harmonics are seen, and all rates therefore follow from that
//! camera, without a rotation of covariances or harmonics.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! use gs2e_render::objects::views_of_motions;
//! use gs2e_scene::camera::{Camera, view::CameraView};
//! use gs2e_scene::motion::ObjectMotion;
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! // An object at x = 3, which goes to the right.
//! let pose = Se3 { translation: DVec3::X * 3.0, ..Se3::IDENTITY };
//! let object = ObjectMotion { pose, velocity: DVec3::X, angular: DVec3::ZERO };
//! let views = views_of_motions(&[object], &CameraView::at_rest(camera, Se3::IDENTITY));
//! // In its axes, the camera is at x = -3 and goes to the left.
//! assert_eq!(views[1].world_from_camera.translation, DVec3::X * -3.0);
//! assert_eq!(views[1].velocity.linear, DVec3::NEG_X);
//! ```

use super::shared::{GSPLAT_NEAR, NEAR};
use super::{RenderError, RenderRules};
use glam::{DVec2, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::renormalised;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::{CameraVelocity, CameraView};
use gs2e_scene::motion::{MovingObject, ObjectMotion};
use gs2e_trajectory::Trajectory;
use rayon::prelude::*;

/// The view as it looks from what is still, and then from the axes of each object.
///
/// # Errors
/// An object has no place at the time of the view.
pub(super) fn object_views(scene: &Gaussians, view: &CameraView) -> Result<Vec<CameraView>, RenderError> {
    let Some(motion) = &scene.motion else { return Ok(vec![*view]) };
    motion.check(view.seconds).map_err(|e| RenderError::View(e.to_string()))?;
    if let Some(dynamics) = &motion.dynamics {
        dynamics.check(view.seconds).map_err(|e| RenderError::View(e.to_string()))?;
    }
    let of_objects = motion.objects.iter().map(|object| view_from_object(&object.at(view.seconds), view));
    Ok(std::iter::once(*view).chain(of_objects).collect())
}

/// As [`object_views`], with objects after their last keyframe left there.
pub(super) fn held_object_views(scene: &Gaussians, view: &CameraView) -> Vec<CameraView> {
    let objects = scene.motion.iter().flat_map(|motion| &motion.objects);
    std::iter::once(*view)
        .chain(objects.map(|object| view_from_object(&object.at(view.seconds), view)))
        .collect()
}

/// The view as it looks from what is still, and then from the axes of objects with these motions.
#[must_use]
pub fn views_of_motions(motions: &[ObjectMotion], view: &CameraView) -> Vec<CameraView> {
    std::iter::once(*view).chain(motions.iter().map(|object| view_from_object(object, view))).collect()
}

/// A view in the axes of an object.
fn view_from_object(object: &ObjectMotion, view: &CameraView) -> CameraView {
    let Se3 { rotation, translation } = view.world_from_camera;
    let object_from_world = object.pose.rotation.conjugate();
    let arm = translation - object.pose.translation;
    let camera_from_world = rotation.conjugate();
    let moved = camera_from_world * (object.velocity + object.angular.cross(arm));
    let velocity = CameraVelocity {
        linear: view.velocity.linear - moved,
        angular: view.velocity.angular - camera_from_world * object.angular,
    };
    let pose =
        Se3 { rotation: renormalised(object_from_world * rotation), translation: object_from_world * arm };
    CameraView { world_from_camera: pose, velocity, ..*view }
}

/// A warning for each object that reaches the near plane within the view, with the number of poses at which
/// it does: what is nearer is not drawn. An object counts as the ball about its mean that holds 95 % of its
/// means.
#[must_use]
pub fn near_warnings(
    scene: &Gaussians,
    camera: &Camera,
    trajectory: &Trajectory,
    rules: RenderRules,
) -> Vec<String> {
    let near = f64::from(if rules == RenderRules::Gsplat { GSPLAT_NEAR } else { NEAR });
    let (poses, field) = (trajectory.world_from_camera.len(), camera.field());
    let warning = |(object, number): (&MovingObject, usize)| {
        let (centre, radius) = scene.object_ball(number);
        let reaches = |pose: &usize| {
            let world_from_object = object.at(trajectory.seconds(*pose)).pose;
            let Se3 { rotation, translation } = trajectory.world_from_camera[*pose];
            let world = world_from_object.rotation * centre + world_from_object.translation;
            reaches_near(rotation.conjugate() * (world - translation), radius, near, field)
        };
        let count = (0..poses).into_par_iter().filter(reaches).count();
        (count > 0).then(|| {
            let name = &object.record.name;
            format!(
                "object {name} reaches the near plane, {near:.2} units before the camera, at {count} of {poses} poses: \
                 what is nearer is not drawn"
            )
        })
    };
    scene.motion.iter().flat_map(|motion| motion.objects.iter().zip(1..)).filter_map(warning).collect()
}

/// Returns true if a ball touches the rectangle of the near plane within these slopes ([`Camera::field`]).
fn reaches_near(centre: DVec3, radius: f64, near: f64, [low, high]: [DVec2; 2]) -> bool {
    let nearest = centre.truncate().clamp(low * near, high * near).extend(near);
    (centre - nearest).length() < radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_scene::camera::lens::Distortion;

    /// At 0.2 units, a camera of 90 degrees sees 0.4 units in width.
    #[test]
    fn a_ball_reaches_the_near_plane_only_within_the_view() {
        let camera = Camera::pinhole(Size { width: 100, height: 100 }, [50.0, 50.0, 50.0, 50.0]);
        let t = |centre: [f64; 3], wanted: bool| {
            assert_eq!(reaches_near(centre.into(), 0.1, 0.2, camera.field()), wanted, "{centre:?}");
        };
        t([0.0, 0.0, 0.31], false);
        t([0.0, 0.0, 0.29], true);
        t([0.15, -0.15, 0.11], true);
        t([0.29, 0.0, 0.2], true);
        t([0.31, 0.0, 0.2], false);
        t([0.0, 0.0, 0.09], false);
    }

    /// The middle of the last pixel is 49.5 px from the axis. With a focal length of 50 px, a fisheye lens
    /// shows the angle 0.99 there: 0.305 units to the side at 0.2 units, where a pinhole shows 0.198.
    #[test]
    fn a_ball_reaches_the_near_plane_within_the_field_of_a_lens() {
        let flat = Camera::pinhole(Size { width: 100, height: 1 }, [50.0, 50.0, 50.0, 0.5]);
        let camera = Camera { lens: Some(Distortion::Fisheye([0.0; 4])), ..flat };
        let edge = 0.2 * libm::tan(0.99);
        for (x, wanted) in [(edge + 0.09, true), (edge + 0.11, false)] {
            let found = reaches_near(DVec3::new(x, 0.0, 0.2), 0.1, 0.2, camera.field());
            assert_eq!(found, wanted, "{x}");
        }
        // Without the lens the picture ends at 0.2 units.
        assert!(!reaches_near(DVec3::new(edge + 0.09, 0.0, 0.2), 0.1, 0.2, flat.field()));
    }
}
