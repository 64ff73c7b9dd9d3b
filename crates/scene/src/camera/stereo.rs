//! Rectification of two cameras: rotations and one camera matrix after which the same point of the scene is
//! in the same row of both pictures, or in the same column for cameras above each other.
//!
//! The definition is that of OpenCV's `stereoRectify` (`modules/calib3d/src/calibration.cpp`; Bouguet's
//! method) with `CALIB_ZERO_DISPARITY` and the default scale, `alpha` = -1: each camera turns by half of the
//! rotation between them, and both turn together until the line through their centres is along an axis.
//! OpenCV holds the corners from which it takes the principal point in 32 bits, which moves it by about 1e-5
//! px. Behind a lens, a corner is where the lens shows it; OpenCV finds its ray in five steps, and this
//! module to the last bits. A fisheye has the same rule.
//!
//! OpenCV has the centre of the first pixel at (0, 0). Numbers of a [`Rectification`] follow it; those of a
//! [`Camera`] have the centre at (0.5, 0.5).
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! use gs2e_scene::camera::{Camera, stereo::Rectification};
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! // The second camera is half a unit to the right of the first one.
//! let second_from_first = Se3 { translation: DVec3::X * -0.5, ..Se3::IDENTITY };
//! let pair = Rectification::new([camera; 2], &second_from_first)?;
//! // Focal length times baseline over depth: 100 * 0.5 / 5.
//! let disparity = pair.disparity([32.0, 24.0], 5.0).ok_or("behind a camera")?;
//! assert!((disparity - 10.0).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::Camera;
use glam::{DMat3, DVec3};
use gs2e_image::{Image, Size};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{exp_vector, log_vector};

/// Distance of the centre of the first pixel from the corner of the picture, px.
const CENTRE: f64 = 0.5;
/// Shortest baseline, relative to a unit of the scene.
const MIN_BASELINE: f64 = 1e-9;

/// Reason why two cameras have no rectification.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RectificationError {
    /// Their centres coincide.
    #[error(
        "the centres of the cameras are {found:e} units apart, wanted a baseline of at least {MIN_BASELINE:e}"
    )]
    NoBaseline {
        /// Distance, scene units.
        found: f64,
    },
    /// Their pictures have different sizes.
    #[error("the pictures have {first} and {second} pixels, wanted one size")]
    Sizes {
        /// Of the first camera.
        first: Size,
        /// Of the second camera.
        second: Size,
    },
    /// They look in too different directions: a corner of a picture is behind the rectified camera.
    #[error(
        "the cameras look in too different directions: a corner of a picture is behind the rectified camera"
    )]
    Behind,
}

/// The rectified pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectification {
    cameras: [Camera; 2],
    /// Rectified from camera: OpenCV's `R1` and `R2`.
    pub rotations: [DMat3; 2],
    /// Focal length of both rectified cameras, px.
    pub focal: f64,
    /// Principal point of both rectified cameras in OpenCV's pixels.
    pub centre: [f64; 2],
    /// The axis along which they are apart: 0 for cameras next to each other, 1 above each other.
    pub axis: usize,
    /// Coordinate of the first camera's centre along this axis in the second camera, scene units.
    pub baseline: f64,
}

impl Rectification {
    /// Rectifies two cameras. `second_from_first` maps points of the first one to points of the second one.
    ///
    /// # Errors
    /// They have no rectification.
    pub fn new(cameras: [Camera; 2], second_from_first: &Se3) -> Result<Self, RectificationError> {
        let [first, second] = cameras.map(|camera| camera.size);
        if first != second {
            return Err(RectificationError::Sizes { first, second });
        }
        let half = DMat3::from_quat(exp_vector(log_vector(second_from_first.rotation) * -0.5));
        let between = half * second_from_first.translation;
        let axis = usize::from(between.x.abs() <= between.y.abs());
        let (along, length) = (between[axis], between.length());
        if length.is_nan() || length < MIN_BASELINE {
            return Err(RectificationError::NoBaseline { found: length });
        }
        let mut wanted = DVec3::ZERO;
        wanted[axis] = if along > 0.0 { 1.0 } else { -1.0 };
        let turn = between.cross(wanted);
        let sine = turn.length();
        // OpenCV's formula, although it has only half of the digits for a small angle.
        let angle = libm::acos((along.abs() / length).min(1.0));
        let turn = if sine > 0.0 { turn * (angle / sine) } else { DVec3::ZERO };
        let turn = DMat3::from_quat(exp_vector(turn));
        let rotations = [turn * half.transpose(), turn * half];
        let baseline = (rotations[1] * second_from_first.translation)[axis];
        // Epipolar lines are along the axis, so only the other focal length is bound.
        let focal = cameras.map(|camera| if axis == 0 { camera.fy } else { camera.fx });
        let focal = (focal[0] + focal[1]) / 2.0;
        let centres = [
            mean_centre(&cameras[0], &rotations[0], focal).ok_or(RectificationError::Behind)?,
            mean_centre(&cameras[1], &rotations[1], focal).ok_or(RectificationError::Behind)?,
        ];
        // The flag `CALIB_ZERO_DISPARITY`: with one principal point, points at infinity have no disparity.
        let centre = [0, 1].map(|k| (centres[0][k] + centres[1][k]) / 2.0);
        Ok(Self { cameras, rotations, focal, centre, axis, baseline })
    }

    /// OpenCV's `P1` and `P2`: rows of the matrices that map points in the axes of the first rectified camera
    /// to the pixels of each.
    #[must_use]
    pub fn projections(&self) -> [[[f64; 4]; 3]; 2] {
        let [cx, cy] = self.centre;
        let first = [[self.focal, 0.0, cx, 0.0], [0.0, self.focal, cy, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mut second = first;
        second[self.axis][3] = self.baseline * self.focal;
        [first, second]
    }

    /// OpenCV's `Q`: rows of the matrix that maps a place in the first rectified picture and its disparity,
    /// `[x, y, disparity, 1]`, to a homogeneous point.
    #[must_use]
    pub fn disparity_to_depth(&self) -> [[f64; 4]; 4] {
        let [cx, cy] = self.centre;
        [
            [1.0, 0.0, 0.0, -cx],
            [0.0, 1.0, 0.0, -cy],
            [0.0, 0.0, 0.0, self.focal],
            [0.0, 0.0, -1.0 / self.baseline, 0.0],
        ]
    }

    /// Disparity of the point at a place of the first camera's picture (in the pixels of a [`Camera`]) and at
    /// this depth along its optical axis: its coordinate along the axis in the first rectified picture minus
    /// that in the second, px. `None` if the point is not in front of the rectified cameras.
    #[must_use]
    pub fn disparity(&self, place: [f64; 2], depth: f64) -> Option<f64> {
        let z = (self.rotations[0] * self.cameras[0].unproject(place, depth)).z;
        (z > 0.0).then(|| -self.baseline * self.focal / z)
    }

    /// Disparity of each pixel of the first camera's picture, by its depth, px. NaN where there is no depth,
    /// or where the point is not in front of the rectified cameras.
    ///
    /// # Panics
    /// The picture has another size than the camera.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "pictures have 32 bits")]
    pub fn disparity_image(&self, depth: &Image<f32>) -> Image<f32> {
        let size = self.cameras[0].size;
        assert_eq!(depth.size(), size, "the depth is that of the first camera");
        let at = |(place, depth): ([f64; 2], &f32)| {
            let seen = (!depth.is_nan()).then(|| f64::from(*depth));
            let disparity = seen.and_then(|depth| self.disparity(place.map(|v| v + CENTRE), depth));
            disparity.map_or(f32::NAN, |disparity| disparity as f32)
        };
        Image::from_vec(size, pixels(size).zip(depth.pixels()).map(at).collect())
    }

    /// For each pixel of a camera's picture, its place in the rectified picture, in OpenCV's pixels: DSEC's
    /// `rectify_map`, row after row. NaN if the rectified camera does not see it.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "maps have 32 bits")]
    pub fn rectify_map(&self, camera: usize) -> Vec<[f32; 2]> {
        let (seen, turn) = (&self.cameras[camera], &self.rotations[camera]);
        pixels(seen.size)
            .map(|place| {
                let ray = *turn * seen.unproject(place.map(|v| v + CENTRE), 1.0);
                let rectified = [0, 1].map(|k| (self.focal * ray[k] / ray.z + self.centre[k]) as f32);
                if ray.z > 0.0 { rectified } else { [f32::NAN; 2] }
            })
            .collect()
    }

    /// For each pixel of a camera's rectified picture, its place in the picture, in OpenCV's pixels: the maps
    /// of `initUndistortRectifyMap`, for `remap`. NaN if the camera does not see it.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "maps have 32 bits")]
    pub fn source_map(&self, camera: usize) -> Vec<[f32; 2]> {
        let (seen, turn) = (&self.cameras[camera], self.rotations[camera].transpose());
        pixels(seen.size)
            .map(|[x, y]| {
                let [cx, cy] = self.centre;
                let ray = turn * DVec3::new((x - cx) / self.focal, (y - cy) / self.focal, 1.0);
                let place = seen.project(ray).map(|place| place.map(|v| (v - CENTRE) as f32));
                place.unwrap_or([f32::NAN; 2])
            })
            .collect()
    }
}

/// The pixels of a picture in OpenCV's numbers, row after row.
fn pixels(size: Size) -> impl Iterator<Item = [f64; 2]> {
    let columns = move || (0..size.width).map(f64::from);
    (0..size.height).map(f64::from).flat_map(move |y| columns().map(move |x| [x, y]))
}

/// The principal point, in OpenCV's pixels, that puts the mean of the rectified corners of the picture in its
/// middle.
fn mean_centre(camera: &Camera, turn: &DMat3, focal: f64) -> Option<[f64; 2]> {
    let last = [camera.size.width, camera.size.height].map(|side| f64::from(side) - 1.0);
    let mut sum = [0.0; 2];
    for corner in [[0.0, 0.0], [last[0], 0.0], [0.0, last[1]], last] {
        let ray = *turn * camera.unproject(corner.map(|v| v + CENTRE), 1.0);
        // NaN where the lens shows no ray.
        if ray.z.is_nan() || ray.z <= 0.0 {
            return None;
        }
        sum[0] += focal * ray.x / ray.z;
        sum[1] += focal * ray.y / ray.z;
    }
    Some([last[0] / 2.0 - sum[0] / 4.0, last[1] / 2.0 - sum[1] / 4.0])
}

impl Camera {
    /// Focal lengths and principal point as OpenCV, Kalibr and DSEC state them: fx, fy, cx, cy, with the
    /// centre of the first pixel at (0, 0).
    #[must_use]
    pub fn opencv_intrinsics(&self) -> [f64; 4] {
        [self.fx, self.fy, self.cx - CENTRE, self.cy - CENTRE]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { size: Size { width: 64, height: 48 }, fx: 60.0, fy: 61.0, cx: 31.0, cy: 25.5, lens: None }
    }

    fn moved(rotation: DVec3, translation: DVec3) -> Se3 {
        Se3 { rotation: exp_vector(rotation), translation }
    }

    /// Points of the scene are in one row of both rectified pictures, and as far apart as the disparity says.
    /// The pictures are projections by this test.
    #[test]
    fn points_are_in_one_row_and_the_disparity_apart() {
        for (pair, axis) in [
            (moved(DVec3::ZERO, DVec3::new(-0.1, 0.0, 0.0)), 0),
            (moved(DVec3::new(0.02, -0.1, 0.05), DVec3::new(-0.1, 0.01, 0.02)), 0),
            (moved(DVec3::new(0.02, 0.04, -0.03), DVec3::new(0.01, 0.2, -0.01)), 1),
        ] {
            let other = Camera { fx: 58.0, fy: 60.0, cx: 33.0, cy: 23.0, ..camera() };
            let found = Rectification::new([camera(), other], &pair).unwrap();
            assert_eq!(found.axis, axis);
            let [p1, p2] = found.projections();
            let at = |p: [[f64; 4]; 3], x: DVec3| {
                let row = |r: [f64; 4]| r[0] * x.x + r[1] * x.y + r[2] * x.z + r[3];
                [row(p[0]) / row(p[2]), row(p[1]) / row(p[2])]
            };
            for point in [DVec3::new(0.3, -0.2, 2.0), DVec3::new(-0.5, 0.4, 3.0), DVec3::new(0.0, 0.1, 1.2)] {
                let second = pair.rotation * point + pair.translation;
                // Each camera's own points, turned into its rectified axes.
                let seen = [at(p1, found.rotations[0] * point), at(p1, found.rotations[1] * second)];
                assert!((seen[0][1 - axis] - seen[1][1 - axis]).abs() < 1e-11, "{seen:?}");
                let place = camera().project(point).unwrap();
                let disparity = found.disparity(place, point.z).unwrap();
                assert!((seen[0][axis] - seen[1][axis] - disparity).abs() < 1e-11, "{seen:?} {disparity}");
                // `P2` takes points of the first rectified camera.
                let through = at(p2, found.rotations[0] * point);
                assert!((through[axis] - seen[1][axis]).abs() < 1e-11);
                // `Q` gives the point back.
                let q = found.disparity_to_depth();
                let v = [seen[0][0], seen[0][1], disparity, 1.0];
                let row = |r: [f64; 4]| r.iter().zip(v).map(|(a, b)| a * b).sum::<f64>();
                let back = DVec3::new(row(q[0]), row(q[1]), row(q[2])) / row(q[3]);
                assert!((back - found.rotations[0] * point).length() < 1e-10, "{back}");
            }
        }
    }

    #[test]
    fn equal_cameras_beside_each_other_are_rectified_already() {
        let found =
            Rectification::new([camera(); 2], &moved(DVec3::ZERO, DVec3::new(-0.1, 0.0, 0.0))).unwrap();
        assert_eq!(found.rotations, [DMat3::IDENTITY; 2]);
        // The focal length of the rows is that of the columns, and the middle of the corners stays.
        assert!((found.focal - 61.0).abs() < 1e-12);
        let disparity = found.disparity([10.0, 20.0], 2.0).unwrap();
        assert!((disparity - 61.0 * 0.1 / 2.0).abs() < 1e-12, "{disparity}");
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a pixel of the picture")]
    fn back_at(back: &[[f32; 2]], [x, y]: [f32; 2]) -> &[f32; 2] {
        &back[y as usize * 64 + x as usize]
    }

    #[test]
    fn maps_are_inverses_of_each_other() {
        let pair = moved(DVec3::new(0.02, -0.1, 0.05), DVec3::new(-0.1, 0.01, 0.02));
        let found = Rectification::new([camera(); 2], &pair).unwrap();
        for k in 0..2 {
            let (there, back) = (found.rectify_map(k), found.source_map(k));
            let mut compared = 0;
            for (i, [x, y]) in there.iter().enumerate() {
                // Where the place is near the middle of a pixel, the inverse at that pixel is near this one.
                let nearest = [x.round(), y.round()];
                let inside = nearest[0] >= 0.0 && nearest[0] < 64.0 && nearest[1] >= 0.0 && nearest[1] < 48.0;
                if !inside || (x - nearest[0]).abs().max((y - nearest[1]).abs()) > 0.05 {
                    continue;
                }
                let [u, v] = *back_at(&back, nearest);
                let [own_x, own_y] = [(i % 64) as f32, (i / 64) as f32];
                // A shift of at most 0.05 px in each direction, at a scale within 1.3.
                assert!((u - own_x).abs().max((v - own_y).abs()) < 0.1, "{i}: {u} {v}");
                compared += 1;
            }
            assert!(compared > 10, "{compared}");
        }
    }

    #[test]
    fn cameras_without_a_rectification_are_named() {
        let at = |x| moved(DVec3::ZERO, DVec3::new(x, 0.0, 0.0));
        let found = |pair, second| Rectification::new([camera(), second], &pair).unwrap_err().to_string();
        assert!(found(at(0.0), camera()).contains("wanted a baseline"));
        let other = Camera { size: Size { width: 32, height: 48 }, ..camera() };
        assert!(found(at(0.1), other).contains("wanted one size"));
        let back = moved(DVec3::new(0.0, 3.0, 0.0), DVec3::new(0.1, 0.0, 0.0));
        assert!(found(back, camera()).contains("too different directions"));
    }
}
