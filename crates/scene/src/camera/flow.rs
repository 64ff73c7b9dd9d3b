//! Optical flow of a static scene between two views, from the depth of the first.
//!
//! The world point of a pixel lies at the pixel's depth along the optical axis. Where depth mixes
//! near and far at a semi-transparent edge, flow does too.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::{Image, Size};
//! # use gs2e_num::se3::Se3;
//! use gs2e_scene::camera::{Camera, flow::flow_between, view::CameraView};
//!
//! let camera = Camera::pinhole(Size { width: 4, height: 3 }, [100.0, 100.0, 2.0, 1.5]);
//! let from = CameraView::at_rest(camera, Se3::IDENTITY);
//! let to = CameraView::at_rest(camera, Se3 { translation: DVec3::X * 0.25, ..Se3::IDENTITY });
//! let flow = flow_between(&Image::filled(camera.size, 2.0), &from, &to);
//! // The camera goes to the right, so a wall at depth 2 goes to the left by 100 / 4 / 2 px.
//! assert!(flow.pixels().iter().all(|[x, y]| (x + 12.5).abs() < 1e-4 && y.abs() < 1e-4));
//! ```

#![expect(clippy::cast_possible_truncation, reason = "displacements are rounded to 32 bits at the end")]

use super::Camera;
use super::view::CameraView;
use glam::{DVec2, DVec3};
use gs2e_image::Image;
use rayon::prelude::*;

/// Length of the displacement of each pixel's world point on the image from view `from` to view `to`, px.
/// `depth` is in scene units along the optical axis of `from`. NaN where depth is NaN, and where the point
/// is not in front of `to`.
///
/// # Panics
/// If `depth` does not have the size of `from`'s camera.
#[must_use]
pub fn flow_displacement(depth: &Image<f32>, from: &CameraView, to: &CameraView) -> Image<f32> {
    displacements(depth, from, to, |moved| moved.map_or(f32::NAN, |moved| moved.length() as f32))
}

/// Displacement of each pixel's world point as [`flow_displacement`], to the right and down, px.
///
/// # Panics
/// If `depth` does not have the size of `from`'s camera.
#[must_use]
pub fn flow_between(depth: &Image<f32>, from: &CameraView, to: &CameraView) -> Image<[f32; 2]> {
    let vector = |moved: DVec2| [moved.x as f32, moved.y as f32];
    displacements(depth, from, to, |moved| moved.map_or([f32::NAN; 2], vector))
}

/// As [`flow_displacement`], where each pixel shows the object of `segmentation`. The views are those of
/// `Renderer::object_views`.
///
/// # Panics
/// If an image does not have the size of the view's camera, or an object has no view.
#[must_use]
pub fn displacement_of_objects(
    depth: &Image<f32>,
    segmentation: Option<&Image<u8>>,
    from: &[CameraView],
    to: &[CameraView],
) -> Image<f32> {
    let mut moved = flow_displacement(depth, &from[0], &to[0]);
    let Some(segmentation) = segmentation else { return moved };
    for (object, (from, to)) in (0_u8..=u8::MAX).zip(from.iter().zip(to)).skip(1) {
        let own = flow_displacement(depth, from, to);
        let pixels = moved.pixels_mut().iter_mut().zip(own.pixels()).zip(segmentation.pixels());
        pixels.filter(|(_, number)| **number == object).for_each(|((moved, own), _)| *moved = *own);
    }
    moved
}

/// As [`flow_displacement`], of points that move with the velocities of `drift`, in camera axes of `from`,
/// until the time of `to`.
///
/// # Panics
/// If an image does not have the size of `from`'s camera.
#[must_use]
pub fn displacement_with_drift(
    depth: &Image<f32>,
    drift: &Image<[f32; 3]>,
    from: &CameraView,
    to: &CameraView,
) -> Image<f32> {
    let still = flow_between(depth, from, to);
    let seconds = to.seconds - from.seconds;
    // From a flow of 0: the camera's motion is in `still`, and only that of the points is a rate here.
    let own = with_drift(Image::filled(depth.size(), [0.0; 2]), depth, Some(drift), &from.camera);
    let length = |(still, own): (&[f32; 2], &[f32; 2])| {
        let along = |k: usize| f64::from(still[k]) + seconds * f64::from(own[k]);
        (along(0) * along(0) + along(1) * along(1)).sqrt() as f32
    };
    Image::from_vec(depth.size(), still.pixels().iter().zip(own.pixels()).map(length).collect())
}

/// Takes the value, a depth or a flow, from the pixels of moving objects.
///
/// # Panics
/// The images differ in size.
pub fn leave_out_objects<T: UndefinedPixel>(image: &mut Image<T>, segmentation: &Image<u8>) {
    assert_eq!(image.size(), segmentation.size(), "the objects are those of the view");
    let pixels = image.pixels_mut().iter_mut().zip(segmentation.pixels());
    pixels.filter(|(_, number)| **number > 0).for_each(|(value, _)| *value = T::UNDEFINED);
}

/// A pixel that can be without a value.
pub trait UndefinedPixel: Sized {
    /// The pixel without a value.
    const UNDEFINED: Self;
}

impl UndefinedPixel for f32 {
    const UNDEFINED: Self = Self::NAN;
}

impl UndefinedPixel for [f32; 2] {
    const UNDEFINED: Self = [f32::NAN; 2];
}

/// The result of `see` at each pixel, from its displacement.
fn displacements<T: Copy + Default + Send>(
    depth: &Image<f32>,
    from: &CameraView,
    to: &CameraView,
    see: impl Fn(Option<DVec2>) -> T + Sync,
) -> Image<T> {
    let size = from.camera.size;
    assert_eq!(depth.size(), size, "the depth image is that of the view");
    // Centres are subtracted before anything is rotated: far from the world's origin, the
    // composition of two poses cancels.
    let to_from_world = to.world_from_camera.rotation_matrix().transpose();
    let turn = to_from_world * from.world_from_camera.rotation_matrix();
    let shift = to_from_world * (from.world_from_camera.translation - to.world_from_camera.translation);
    let width = size.width as usize;
    let mut all = vec![T::default(); size.pixels()];
    all.par_iter_mut().enumerate().for_each(|(i, found)| {
        let pixel = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        // NaN for a pixel without depth; the projection refuses it, and the result is NaN again.
        let point = from.camera.unproject(pixel, f64::from(depth.pixels()[i]));
        let moved = to.camera.project(turn * point + shift);
        *found = see(moved.map(|[x, y]| DVec2::new(x - pixel[0], y - pixel[1])));
    });
    Image::from_vec(size, all)
}

/// Image velocity of each pixel's world point for a moving camera, px per unit of the velocity's
/// time: `Xdot = -v - w x X`. NaN where depth is NaN.
///
/// # Panics
/// If `depth` does not have the size of the view's camera.
#[must_use]
pub fn flow_rates(depth: &Image<f32>, view: &CameraView) -> Image<[f32; 2]> {
    flow_of_objects(depth, None, std::slice::from_ref(view))
}

/// As [`flow_rates`], where each pixel shows the object of `segmentation`, by default what is still. `views`
/// are those of `Renderer::object_views`; the point of a pixel rests in the axes of its object.
///
/// # Panics
/// If an image does not have the size of the view's camera, or an object has no view.
#[must_use]
pub fn flow_of_objects(
    depth: &Image<f32>,
    segmentation: Option<&Image<u8>>,
    views: &[CameraView],
) -> Image<[f32; 2]> {
    let (camera, size) = (&views[0].camera, views[0].camera.size);
    assert_eq!(depth.size(), size, "the depth image is that of the view");
    assert!(
        segmentation.is_none_or(|segmentation| segmentation.size() == size),
        "the objects are those of the view"
    );
    let width = size.width as usize;
    let rate = |(i, z): (usize, &f32)| {
        let view = &views[segmentation.map_or(0, |segmentation| usize::from(segmentation.pixels()[i]))];
        let pixel = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let point = camera.unproject(pixel, f64::from(*z));
        // In camera axes the camera rests, and the point moves against it.
        let moving = -view.velocity.linear - view.velocity.angular.cross(point);
        camera.velocity(point, moving).as_vec2().to_array()
    };
    Image::from_vec(size, depth.pixels().iter().enumerate().map(rate).collect())
}

/// Adds the motion of Gaussians that change to a flow, by the velocity that each pixel shows.
///
/// # Panics
/// The images differ in size.
#[must_use]
pub fn with_drift(
    mut flow: Image<[f32; 2]>,
    depth: &Image<f32>,
    drift: Option<&Image<[f32; 3]>>,
    camera: &Camera,
) -> Image<[f32; 2]> {
    let Some(drift) = drift else { return flow };
    assert!(
        drift.size() == flow.size() && depth.size() == flow.size(),
        "the velocities are those of the view"
    );
    let width = flow.size().width as usize;
    let pixels = flow.pixels_mut().iter_mut().zip(depth.pixels()).zip(drift.pixels());
    for (i, ((flow, z), velocity)) in pixels.enumerate() {
        let pixel = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let point = camera.unproject(pixel, f64::from(*z));
        let own = camera.velocity(point, DVec3::from_array(velocity.map(f64::from)));
        *flow = [(f64::from(flow[0]) + own.x) as f32, (f64::from(flow[1]) + own.y) as f32];
    }
    flow
}

/// Takes the depth from the pixels that show Gaussians in motion.
///
/// # Panics
/// The images differ in size.
pub fn leave_out_drifting(depth: &mut Image<f32>, drift: &Image<[f32; 3]>) {
    assert_eq!(depth.size(), drift.size(), "the velocities are those of the view");
    let pixels = depth.pixels_mut().iter_mut().zip(drift.pixels());
    let moves = |velocity: &[f32; 3]| velocity.iter().any(|v| v.abs() > 0.0);
    pixels.filter(|(_, velocity)| moves(velocity)).for_each(|(z, _)| *z = f32::NAN);
}

/// At most `wanted` pairs of neighbouring poses, spread evenly over `poses`, including the first
/// and the last pair.
#[must_use]
pub fn sample_pairs(poses: usize, wanted: usize) -> Vec<(usize, usize)> {
    let pairs = poses.saturating_sub(1);
    let count = wanted.min(pairs);
    // The first and the last pair are both included. A single pair has no distance to divide.
    let first = |i: usize| if count > 1 { i * (pairs - 1) / (count - 1) } else { 0 };
    (0..count).map(|i| (first(i), first(i) + 1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use gs2e_image::Size;
    use gs2e_num::se3::Se3;

    const SIZE: Size = Size { width: 40, height: 30 };

    fn view(translation: DVec3, rotation: DQuat) -> CameraView {
        let camera = Camera { size: SIZE, fx: 50.0, fy: 60.0, cx: 20.0, cy: 15.0, lens: None };
        CameraView::at_rest(camera, Se3 { rotation, translation })
    }

    #[test]
    fn a_parallel_plane_moves_by_focal_length_times_shift_over_depth() {
        // Far from the world's origin and with the camera turned: neither changes a shift along the
        // camera's own axes.
        let turn = DQuat::from_rotation_y(0.7);
        let start = DVec3::splat(1e6);
        let depth = Image::filled(SIZE, 4.0);
        let from = view(start, turn);
        let sideways =
            flow_displacement(&depth, &from, &view(start + turn * DVec3::new(0.1, 0.0, 0.0), turn));
        let down = flow_displacement(&depth, &from, &view(start + turn * DVec3::new(0.0, 0.1, 0.0), turn));
        for (moved, wanted) in [(sideways, 50.0 * 0.1 / 4.0), (down, 60.0 * 0.1 / 4.0)] {
            // Positions at 1e6 are rounded at 1.2e-10, times 60/4 px per unit; the result is
            // rounded at 6e-8 of itself.
            assert!(moved.pixels().iter().all(|v| (v - wanted).abs() < 2e-7), "{:?}", moved.pixels()[0]);
        }
    }

    #[test]
    fn sampled_pairs_hold_both_ends() {
        assert_eq!(sample_pairs(150, 3), [(0, 1), (74, 75), (148, 149)]);
        assert_eq!(sample_pairs(3, 9), [(0, 1), (1, 2)]);
        assert_eq!(sample_pairs(1, 9), []);
    }

    #[test]
    fn the_flow_of_a_pure_rotation_does_not_depend_on_depth() {
        let (from, to) =
            (view(DVec3::ZERO, DQuat::IDENTITY), view(DVec3::ZERO, DQuat::from_rotation_x(0.01)));
        let [near, far] = [1.0, 1000.0].map(|z| flow_displacement(&Image::filled(SIZE, z), &from, &to));
        for (a, b) in near.pixels().iter().zip(far.pixels()) {
            assert!((a - b).abs() <= 1e-7, "{a} {b}");
        }
        // The row through the centre moves by fy tan(angle), and it is half a pixel off.
        let wanted = 60.0 * (0.01_f64 - (0.5_f64 / 60.0).atan()).tan() + 0.5;
        assert!((f64::from(near.pixels()[14 * 40 + 20]) - wanted).abs() < 1e-3, "{wanted}");
    }

    #[test]
    fn undefined_depth_and_points_behind_have_no_flow() {
        let mut depth = Image::filled(SIZE, 4.0);
        depth.pixels_mut()[7] = f32::NAN;
        let from = view(DVec3::ZERO, DQuat::IDENTITY);
        let still = flow_displacement(&depth, &from, &from);
        assert!(still.pixels()[7].is_nan());
        assert_eq!(still.pixels().iter().filter(|&&v| v < 1e-12).count(), SIZE.pixels() - 1);
        let past = flow_displacement(&depth, &from, &view(DVec3::new(0.0, 0.0, 5.0), DQuat::IDENTITY));
        assert!(past.pixels().iter().all(|v| v.is_nan()));
    }
}
