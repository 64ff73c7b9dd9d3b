//! The request to OpenCV: poses, points and pictures.

use super::VIEWS;
use crate::foreign::{ForeignError, TrajectoryPicture, spread_evenly};
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_trajectory::Trajectory;
use serde_json::json;
use std::path::Path;

/// Number of columns and rows of the grid of points, from edge to edge of the image.
const GRID: u8 = 5;

/// Depths of the points, in lengths of the camera's path. A wrong translation shows at near points,
/// a wrong rotation at all.
const DEPTHS: [f64; 3] = [0.25, 1.0, 16.0];

/// Maximum number of pictures from which a motion is requested.
const STARTS: usize = 20;

pub(super) struct OpencvRequest<'a> {
    pub(super) camera: &'a Camera,
    pub(super) trajectory: &'a Trajectory,
    pub(super) pictures: &'a [TrajectoryPicture],
}

impl OpencvRequest<'_> {
    pub(super) fn compose(&self, folder: &Path) -> Result<serde_json::Value, ForeignError> {
        let stamps = &self.trajectory.stamps_us;
        let pictures = self.pictures.iter().map(|TrajectoryPicture { pose, file }| {
            let file = std::path::absolute(file).map_err(ForeignError::io_error(file))?;
            Ok(json!({ "pose": pose, "t_us": stamps[*pose], "file": file }))
        });
        Ok(json!({
            "poses": folder.join("poses.txt"),
            "transforms": folder.join("transforms.json"),
            "views": self.views(),
            "pictures": pictures.collect::<Result<Vec<_>, ForeignError>>()?,
            "starts": spread_evenly(self.pictures.len(), STARTS),
        }))
    }

    /// Returns points in the world and their projections by the renderer's camera. Only poses with
    /// pictures are chosen if there are pictures, because `transforms.json` then contains only
    /// these.
    fn views(&self) -> Vec<serde_json::Value> {
        let Trajectory { world_from_camera, stamps_us } = self.trajectory;
        let pictured: Vec<usize> = self.pictures.iter().map(|picture| picture.pose).collect();
        // Without pictures, the file contains every pose.
        let candidates = if pictured.is_empty() { (0..stamps_us.len()).collect() } else { pictured };
        let steps = world_from_camera.windows(2).map(|w| w[1].translation.distance(w[0].translation));
        let path: f64 = steps.sum();
        // A camera at rest has no path to scale the depths by.
        let unit = if path > 0.0 { path } else { 1.0 };
        let view = |k: usize| {
            let pose = candidates[k];
            let (points, pixels) = self.grid_projections(&world_from_camera[pose], unit);
            json!({ "pose": pose, "t_us": stamps_us[pose], "points": points, "pixels": pixels })
        };
        spread_evenly(candidates.len(), VIEWS).into_iter().map(view).collect()
    }

    /// Returns the points of a grid at each depth, in the world, and their projections.
    fn grid_projections(&self, world_from_camera: &Se3, unit: f64) -> (Vec<DVec3>, Vec<[f64; 2]>) {
        let size = self.camera.size;
        let across = |side: u32, i: u8| f64::from(side) * f64::from(i) / f64::from(GRID - 1);
        let camera_from_world = world_from_camera.inverse();
        let cells = (0..GRID).flat_map(|row| (0..GRID).map(move |column| (column, row)));
        let places = cells.map(|(column, row)| [across(size.width, column), across(size.height, row)]);
        let points = places.flat_map(|place| {
            DEPTHS.map(|depth| {
                let point = self.camera.unproject(place, depth * unit);
                world_from_camera.rotation * point + world_from_camera.translation
            })
        });
        let project = |point: DVec3| {
            let in_camera = camera_from_world.rotation * point + camera_from_world.translation;
            Some((point, self.camera.project(in_camera)?))
        };
        points.filter_map(project).unzip()
    }
}
