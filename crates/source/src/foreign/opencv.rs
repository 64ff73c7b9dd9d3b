//! OpenCV's answers from the released poses and camera: the projections of points, and the camera
//! motion between pictures, recovered from the pictures.

mod request;

use request::OpencvRequest;

use super::{ForeignAnswer, ForeignError, TrajectoryPicture, python, versions};
use crate::reconstruct::ProgramWorkspace;
use gs2e_scene::camera::Camera;
use gs2e_trajectory::{Trajectory, transforms};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
        let pictures =
            transforms::PictureLinks { sharp: &names, readout_us: None, blurred: &BTreeMap::new() };
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
    camera: &Camera,
    trajectory: &Trajectory,
    pictures: &[TrajectoryPicture],
    workspace: ProgramWorkspace<'_>,
) -> Result<ForeignAnswer<OpencvGeometry>, ForeignError> {
    let program = match versions::having(&["cv2", "numpy"], workspace.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    let files = [("poses.txt", &released.poses_txt), ("transforms.json", &released.transforms_json)];
    for (name, bytes) in files {
        let file = workspace.folder.join(name);
        std::fs::write(&file, bytes).map_err(ForeignError::io_error(&file))?;
    }
    let request = OpencvRequest { camera, trajectory, pictures }.compose(workspace.folder)?;
    let OpencvAnswer { poses_txt, transforms_json, tried, pairs } =
        python::ask_script("geometry", &request, workspace)?;
    Ok(Ok(OpencvGeometry { program, poses_txt, transforms_json, tried, pairs }))
}
