//! Image motion by points of a scene alone, where nothing can be rendered yet.
//!
//! The picture is divided into cells. A cell moves as fast as the median of the points in it, and the
//! picture as the median of its cells, so that a spot with many points counts by its area. Points behind
//! others are not known to be hidden, which makes the result an estimate.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::{Se3, Twist};
//! use gs2e_render::points::PointFlowMeter;
//! use gs2e_scene::camera::Camera;
//!
//! let camera = Camera::pinhole(Size { width: 64, height: 48 }, [100.0, 100.0, 32.0, 24.0]);
//! let meter = PointFlowMeter { points: vec![DVec3::Z * 5.0], camera };
//! let sideways = Twist { linear: DVec3::X, angular: DVec3::ZERO };
//! // A point at depth 5 moves by 100 / 5 px.
//! assert_eq!(meter.speed_px(&Se3::IDENTITY, &sideways), Some(20.0));
//! ```

#![expect(clippy::cast_possible_truncation, reason = "speeds are rounded to 32 bits; cells are few")]

use glam::{DVec2, DVec3};
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::stats::nearest_ranks;
use gs2e_scene::camera::Camera;
use gs2e_trajectory::flow::FlowMeter;
use std::collections::BTreeMap;

/// Number of cells along each side of the picture.
const CELLS: f64 = 12.0;

/// A meter for the views of a camera.
#[derive(Debug, Clone)]
pub struct PointFlowMeter {
    /// Points on surfaces of the scene, in world axes.
    pub points: Vec<DVec3>,
    /// The camera.
    pub camera: Camera,
}

impl PointFlowMeter {
    /// Median image speed of a moving camera, px per unit of the twist's time: `Xdot = -v - w x X` in
    /// camera axes. `None` if no point is in view.
    #[must_use]
    pub fn speed_px(&self, world_from_camera: &Se3, twist: &Twist) -> Option<f64> {
        let camera_from_world = world_from_camera.rotation.conjugate();
        let velocity = camera_from_world * twist.linear;
        let mut cells: BTreeMap<[i64; 2], Vec<f32>> = BTreeMap::new();
        for point in &self.points {
            let at = camera_from_world * (*point - world_from_camera.translation);
            let Some((cell, to_image)) = self.cell_of(at) else { continue };
            let moved = -velocity - twist.angular.cross(at);
            let px = to_image * (moved.truncate() - at.truncate() / at.z * moved.z);
            cells.entry(cell).or_default().push(px.length() as f32);
        }
        let median = |speeds| nearest_ranks(speeds, [50]).map(|[speed]| speed);
        median(cells.into_values().filter_map(median).collect()).map(f64::from)
    }

    /// The cell in which a point in camera axes is seen, and the pixels of a unit across at its depth.
    fn cell_of(&self, at: DVec3) -> Option<([i64; 2], DVec2)> {
        let Camera { fx, fy, cx, cy, size, .. } = self.camera;
        let focal = DVec2::new(fx, fy);
        let place = (focal * at.truncate() / at.z + DVec2::new(cx, cy))
            / DVec2::new(f64::from(size.width), f64::from(size.height));
        let inside = at.z > 0.0 && place.cmpge(DVec2::ZERO).all() && place.cmplt(DVec2::ONE).all();
        let cell = (place * CELLS).floor();
        inside.then_some(([cell.x as i64, cell.y as i64], focal / at.z))
    }
}

impl FlowMeter for PointFlowMeter {
    fn median_px(&mut self, world_from_camera: &Se3, twist: &Twist) -> Result<Option<f64>, String> {
        Ok(self.speed_px(world_from_camera, twist))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use gs2e_image::Size;

    /// A plane at depth 4, seen at 50 px of focal length.
    fn meter() -> PointFlowMeter {
        let camera = Camera::pinhole(Size { width: 40, height: 30 }, [50.0, 60.0, 20.0, 15.0]);
        let points =
            (0..400).map(|i| DVec3::new(f64::from(i % 20) / 8.0 - 1.2, f64::from(i / 20) / 8.0 - 1.2, 4.0));
        PointFlowMeter { points: points.collect(), camera }
    }

    #[test]
    fn a_plane_moves_by_focal_length_times_shift_over_depth() {
        let turn = DQuat::from_rotation_z(0.4);
        let pose = Se3 { rotation: turn, translation: DVec3::ZERO };
        let of = |linear: DVec3, angular: DVec3| meter().speed_px(&pose, &Twist { linear, angular }).unwrap();
        // Speeds are rounded at 6e-8 of themselves.
        assert!((of(turn * DVec3::X * 0.2, DVec3::ZERO) - 50.0 * 0.2 / 4.0).abs() < 1e-6);
        assert!((of(turn * DVec3::Y * 0.2, DVec3::ZERO) - 60.0 * 0.2 / 4.0).abs() < 1e-6);
        // The middle of the picture moves by f |w|; towards the corners it is more.
        assert!((1.0..1.2).contains(&(of(DVec3::ZERO, DVec3::Y) / 50.0)));
    }

    #[test]
    fn points_out_of_view_do_not_count() {
        let behind = Se3 { rotation: DQuat::IDENTITY, translation: DVec3::Z * 9.0 };
        let twist = Twist { linear: DVec3::X, angular: DVec3::ZERO };
        assert_eq!(meter().speed_px(&behind, &twist), None);
    }
}
