//! Speed of the middle of the picture, from the poses alone.
//!
//! By `Xdot = -v - w x X` (docs/design/numerics-rendering.md, "Rates of a moving camera") a point
//! straight ahead at distance `D` moves on the image by `f |v| / D` for a camera that shifts
//! sideways by `v`, and by `f |w|` for one that turns by `w` across its optical axis. The
//! directions of the two motions are ignored. Their sum is the largest possible motion of the
//! point, and it contains the motion that a camera hides by looking at the point. Forward motion
//! and rotation about the optical axis leave the point in place.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! use gs2e_render::centre::centre_px;
//! use gs2e_scene::camera::Camera;
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! // Two steps to the right, of 1/4 and of 1/2.
//! let poses = [0.0, 0.25, 0.75].map(|x| Se3 { translation: DVec3::X * x, ..Se3::IDENTITY });
//! let motion = centre_px(&poses, &camera, 5.0).ok_or("no step")?;
//! // The larger one moves a point at distance 5 by 100 * 0.5 / 5 px.
//! assert_eq!(motion.max, 10.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![expect(clippy::cast_possible_truncation, reason = "displacements are rounded to 32 bits at the end")]

use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::log_vector;
use gs2e_scene::camera::Camera;
use gs2e_trajectory::flow::FlowQuantiles;

/// Quantiles, over the steps between neighbouring poses, of the largest possible motion of a point
/// straight ahead at `distance` (scene units). They are in px of `camera` along x, to first order
/// in the turn. `None` if there is no step.
#[must_use]
pub fn centre_px(poses: &[Se3], camera: &Camera, distance: f64) -> Option<FlowQuantiles> {
    let across = |v: DVec3| v.truncate().length();
    let step = |pair: &[Se3]| {
        let camera_from_world = pair[0].rotation.conjugate();
        // In the axes of the first pose, where the components across the optical axis are x and y.
        let shift = camera_from_world * (pair[1].translation - pair[0].translation);
        let turn = log_vector(camera_from_world * pair[1].rotation);
        (camera.fx * (across(shift) / distance + across(turn))) as f32
    };
    FlowQuantiles::from_values(poses.windows(2).map(step).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use gs2e_image::{Image, Size};
    use gs2e_num::se3::rotation::exp_vector;
    use gs2e_scene::camera::flow::flow_displacement;
    use gs2e_scene::camera::view::CameraView;

    const CAMERA: Camera =
        Camera { size: Size { width: 41, height: 31 }, fx: 50.0, fy: 50.0, cx: 20.5, cy: 15.5, lens: None };
    const DISTANCE: f32 = 4.0;

    /// Motion of the middle pixel for this motion of the camera, by the formula and by projection.
    fn both(shift: DVec3, turn: DVec3) -> [f32; 2] {
        let start =
            Se3 { rotation: exp_vector(DVec3::new(0.3, -0.7, 0.2)), translation: DVec3::new(5.0, -2.0, 9.0) };
        let end = Se3 {
            rotation: start.rotation * exp_vector(turn),
            translation: start.translation + start.rotation * shift,
        };
        let [from, to] = [start, end].map(|pose| CameraView::at_rest(CAMERA, pose));
        let moved = flow_displacement(&Image::filled(CAMERA.size, DISTANCE), &from, &to);
        let px = centre_px(&[start, end], &CAMERA, DISTANCE.into()).unwrap();
        [px.max, moved.pixels()[15 * 41 + 20]]
    }

    #[test]
    fn the_middle_moves_as_it_is_projected() {
        // to first order: what is left out is of the order of 1e-3^2 of 50 px
        for (shift, turn) in [
            (DVec3::new(4e-3, 0.0, 0.0), DVec3::ZERO),
            (DVec3::new(0.0, -4e-3, 0.0), DVec3::ZERO),
            (DVec3::ZERO, DVec3::new(1e-3, 0.0, 0.0)),
            (DVec3::ZERO, DVec3::new(6e-4, -8e-4, 0.0)),
            // along and about the optical axis
            (DVec3::new(0.0, 0.0, 4e-3), DVec3::new(0.0, 0.0, 1e-3)),
            // turning to where it moves, the two add up: the point falls behind
            (DVec3::new(4e-3, 0.0, 0.0), DVec3::new(0.0, 1e-3, 0.0)),
        ] {
            let [found, wanted] = both(shift, turn);
            assert!((found - wanted).abs() < 1e-4, "{shift} {turn}: {found}, projected {wanted}");
        }
    }

    #[test]
    fn a_point_that_the_camera_keeps_in_view_moves_less() {
        let [most, moved] = both(DVec3::new(4e-3, 0.0, 0.0), DVec3::new(0.0, -1e-3, 0.0));
        assert!((most - 0.1).abs() < 1e-6 && moved < 1e-4, "{most} {moved}");
    }

    #[test]
    fn one_pose_makes_no_step() {
        let pose = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };
        assert_eq!(centre_px(&[pose], &CAMERA, 1.0), None);
        assert_eq!(centre_px(&[pose; 3], &CAMERA, 1.0).map(|q| q.max), Some(0.0));
    }
}
