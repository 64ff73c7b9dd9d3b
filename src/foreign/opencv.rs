//! OpenCV's answers from the released poses and camera: the projections of points, and the camera
//! motion between pictures, recovered from the pictures.

use super::{ForeignError, Told, TrajectoryPicture, python, spread_evenly, versions};
use crate::camera::Camera;
use crate::reconstruct::TrainingWorkspace;
use crate::se3::Se3;
use crate::trajectory::{Trajectory, transforms};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// OpenCV's answer on a trajectory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpencvGeometry {
    /// The program, with its version.
    pub program: String,
    /// Projections with the poses of `poses.txt`.
    pub poses_txt: ProjectionAgreement,
    /// Projections with the poses of `transforms.json`.
    pub transforms_json: ProjectionAgreement,
    /// Number of pictures from which a motion to a later picture was requested.
    pub tried: usize,
    /// The recovered motions.
    pub pairs: Vec<RelativeMotion>,
}

/// Comparison of OpenCV's projections with those of the renderer's camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectionAgreement {
    /// Maximum distance, px.
    pub px: f64,
    /// The pose with the maximum distance; `None` if no pose was found in the file.
    pub pose: Option<usize>,
    /// Number of points.
    pub points: usize,
}

/// Comparison of the recovered and the stated motion between two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RelativeMotion {
    /// Pose index of the first picture.
    pub from: usize,
    /// Pose index of the second picture.
    pub to: usize,
    /// Number of key points that agree with the recovered motion.
    pub matches: usize,
    /// Angle between the rotations, degrees.
    pub rotation_deg: f64,
    /// Angle between the directions of translation, degrees.
    pub direction_deg: f64,
}

/// The answer of the script.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OpencvAnswer {
    poses_txt: ProjectionAgreement,
    transforms_json: ProjectionAgreement,
    tried: usize,
    pairs: Vec<RelativeMotion>,
}

/// Maximum number of poses whose points are projected.
const VIEWS: usize = 200;
/// Number of columns and rows of the grid of points, from edge to edge of the image.
const GRID: u8 = 5;
/// Depths of the points, in lengths of the camera's path. A wrong translation shows at near points,
/// a wrong rotation at all.
const DEPTHS: [f64; 3] = [0.25, 1.0, 16.0];
/// Maximum number of pictures from which a motion is requested.
const STARTS: usize = 20;

/// Poses and camera of a trajectory, in the released form.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReleasedPoses {
    /// `poses.txt`.
    pub poses_txt: Vec<u8>,
    /// `transforms.json`.
    pub transforms_json: Vec<u8>,
}

impl ReleasedPoses {
    /// Returns the files of a trajectory with these pictures, sorted by pose.
    #[must_use]
    pub fn from_trajectory(camera: &Camera, trajectory: &Trajectory, pictures: &[TrajectoryPicture]) -> Self {
        let mut poses_txt = Vec::new();
        trajectory.write_poses(&mut poses_txt).expect("memory takes what is written");
        let names: Vec<String> = pictures.iter().map(|picture| format!("{:06}.png", picture.pose)).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let pictures = transforms::PictureLinks { sharp: &names, blurred: &BTreeMap::new() };
        let transforms_json =
            transforms::compose_transforms(camera, trajectory, &pictures).to_string().into_bytes();
        Self { poses_txt, transforms_json }
    }
}

/// Lets OpenCV compare released files with the projections of the renderer's camera and with the
/// pictures, which are sorted by pose.
///
/// # Errors
/// A file cannot be used, Python fails, or the work was asked to stop.
pub fn measure_released(
    released: &ReleasedPoses,
    (camera, trajectory): (&Camera, &Trajectory),
    pictures: &[TrajectoryPicture],
    desk: TrainingWorkspace<'_>,
) -> Result<Told<OpencvGeometry>, ForeignError> {
    let program = match versions::having(&["cv2", "numpy"], desk.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    let files = [("poses.txt", &released.poses_txt), ("transforms.json", &released.transforms_json)];
    for (name, bytes) in files {
        let file = desk.folder.join(name);
        std::fs::write(&file, bytes).map_err(ForeignError::io_error(&file))?;
    }
    let request = OpencvRequest { camera, trajectory, pictures }.compose(desk.folder)?;
    let OpencvAnswer { poses_txt, transforms_json, tried, pairs } =
        python::ask_script("geometry", &request, desk)?;
    Ok(Ok(OpencvGeometry { program, poses_txt, transforms_json, tried, pairs }))
}

struct OpencvRequest<'a> {
    camera: &'a Camera,
    trajectory: &'a Trajectory,
    pictures: &'a [TrajectoryPicture],
}

impl OpencvRequest<'_> {
    fn compose(&self, folder: &Path) -> Result<serde_json::Value, ForeignError> {
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
        let shown: Vec<usize> = self.pictures.iter().map(|picture| picture.pose).collect();
        // Without pictures, the file contains every pose.
        let candidates = if shown.is_empty() { (0..stamps_us.len()).collect() } else { shown };
        let steps = world_from_camera.windows(2).map(|w| w[1].translation.distance(w[0].translation));
        let path: f64 = steps.sum();
        // A camera at rest has no path to scale the depths by.
        let unit = if path > 0.0 { path } else { 1.0 };
        let view = |k: usize| {
            let pose = candidates[k];
            let (points, pixels) = self.seen(&world_from_camera[pose], unit);
            json!({ "pose": pose, "t_us": stamps_us[pose], "points": points, "pixels": pixels })
        };
        spread_evenly(candidates.len(), VIEWS).into_iter().map(view).collect()
    }

    /// Returns the points of a grid at each depth, in the world, and their projections.
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
