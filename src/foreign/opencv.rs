//! OpenCV, given the poses and the camera as they are released: where it sees points, and how the camera moved between
//! pictures by what they show.

use super::{ForeignError, Picture, Told, python, spread, versions};
use crate::camera::Camera;
use crate::reconstruct::Desk;
use crate::se3::Se3;
use crate::trajectory::{Trajectory, transforms};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// What OpenCV finds of a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// The program, with its version.
    pub program: String,
    /// Where it sees points by `poses.txt`.
    pub poses_txt: Projection,
    /// The same by `transforms.json`.
    pub transforms_json: Projection,
    /// Pictures from which it was asked for the motion to a later one.
    pub tried: usize,
    /// The motions that it found.
    pub pairs: Vec<Motion>,
}

/// Where OpenCV sees points, against where the renderer's camera does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Projection {
    /// The largest distance, px.
    pub px: f64,
    /// The pose that has it; `None` where no pose was found in the file.
    pub pose: Option<usize>,
    /// How many points were seen.
    pub points: usize,
}

/// The motion between two pictures, found against stated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Number of the first one's pose.
    pub from: usize,
    /// Number of the second one's.
    pub to: usize,
    /// Key points that agree with the motion found.
    pub matches: usize,
    /// Angle between the rotations, degrees.
    pub rotation_deg: f64,
    /// Angle between the directions, degrees.
    pub direction_deg: f64,
}

/// The answer of the script.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    poses_txt: Projection,
    transforms_json: Projection,
    tried: usize,
    pairs: Vec<Motion>,
}

/// Poses whose points are projected, at most.
const VIEWS: usize = 200;
/// Points are on a grid of so many columns and rows, from edge to edge of the image.
const GRID: u8 = 5;
/// Their depths, in lengths of the camera's path: a wrong translation shows in near ones, a wrong rotation in all.
const DEPTHS: [f64; 3] = [0.25, 1.0, 16.0];
/// Pictures from which the motion to a later one is asked for.
const STARTS: usize = 20;

/// A trajectory's poses and camera, as a release has them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Released {
    /// `poses.txt`.
    pub poses_txt: Vec<u8>,
    /// `transforms.json`.
    pub transforms_json: Vec<u8>,
}

impl Released {
    /// The files of a trajectory with these pictures, sorted by their poses.
    #[must_use]
    pub fn of(camera: &Camera, trajectory: &Trajectory, pictures: &[Picture]) -> Self {
        let mut poses_txt = Vec::new();
        trajectory.write_poses(&mut poses_txt).expect("memory takes what is written");
        let names: Vec<String> = pictures.iter().map(|picture| format!("{:06}.png", picture.pose)).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let pictures = transforms::Pictures { sharp: &names, blurred: &BTreeMap::new() };
        let transforms_json = transforms::compose(camera, trajectory, &pictures).to_string().into_bytes();
        Self { poses_txt, transforms_json }
    }
}

/// Has OpenCV hold released files against where the renderer's camera sees points, and against pictures, sorted by their
/// poses.
///
/// # Errors
/// When a file cannot be used, Python fails, or the work was asked to stop.
pub fn measure(
    released: &Released,
    (camera, trajectory): (&Camera, &Trajectory),
    pictures: &[Picture],
    desk: Desk<'_>,
) -> Result<Told<Geometry>, ForeignError> {
    let program = match versions::having(&["cv2", "numpy"], desk.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    let files = [("poses.txt", &released.poses_txt), ("transforms.json", &released.transforms_json)];
    for (name, bytes) in files {
        let file = desk.folder.join(name);
        std::fs::write(&file, bytes).map_err(ForeignError::io(&file))?;
    }
    let request = Request { camera, trajectory, pictures }.compose(desk.folder)?;
    let Answer { poses_txt, transforms_json, tried, pairs } = python::ask("geometry", &request, desk)?;
    Ok(Ok(Geometry { program, poses_txt, transforms_json, tried, pairs }))
}

struct Request<'a> {
    camera: &'a Camera,
    trajectory: &'a Trajectory,
    pictures: &'a [Picture],
}

impl Request<'_> {
    fn compose(&self, folder: &Path) -> Result<serde_json::Value, ForeignError> {
        let stamps = &self.trajectory.stamps_us;
        let pictures = self.pictures.iter().map(|Picture { pose, file }| {
            let file = std::path::absolute(file).map_err(ForeignError::io(file))?;
            Ok(json!({ "pose": pose, "t_us": stamps[*pose], "file": file }))
        });
        Ok(json!({
            "poses": folder.join("poses.txt"),
            "transforms": folder.join("transforms.json"),
            "views": self.views(),
            "pictures": pictures.collect::<Result<Vec<_>, ForeignError>>()?,
            "starts": spread(self.pictures.len(), STARTS),
        }))
    }

    /// Points in the world, and where the renderer's camera sees them. Poses with a picture come first to be chosen, since
    /// `transforms.json` has no others where there are pictures.
    fn views(&self) -> Vec<serde_json::Value> {
        let Trajectory { world_from_camera, stamps_us } = self.trajectory;
        let shown: Vec<usize> = self.pictures.iter().map(|picture| picture.pose).collect();
        let candidates = if shown.is_empty() { (0..stamps_us.len()).collect() } else { shown };
        let steps = world_from_camera.windows(2).map(|w| w[1].translation.distance(w[0].translation));
        let path: f64 = steps.sum();
        let unit = if path > 0.0 { path } else { 1.0 };
        let view = |k: usize| {
            let pose = candidates[k];
            let (points, pixels) = self.seen(&world_from_camera[pose], unit);
            json!({ "pose": pose, "t_us": stamps_us[pose], "points": points, "pixels": pixels })
        };
        spread(candidates.len(), VIEWS).into_iter().map(view).collect()
    }

    /// Points on a grid at each depth, in the world, and where they are seen.
    fn seen(&self, world_from_camera: &Se3, unit: f64) -> (Vec<DVec3>, Vec<[f64; 2]>) {
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
            let seen = camera_from_world.rotation * point + camera_from_world.translation;
            Some((point, self.camera.project(seen)?))
        };
        points.filter_map(project).unzip()
    }
}
