//! Registration of pictures by COLMAP. COLMAP gets the camera but no poses.
//!
//! Key points are found with its SIFT on the CPU, at most 2,048 per picture. Matches follow our own
//! rule (see `features`), and pairs are verified. The mapper makes one model with fixed intrinsics.
//! Points farther than 1 px from their key points are left out of the model (COLMAP's default, 4
//! px, is meant for lenses). On rendered pictures this limit makes the poses three times more
//! accurate.

use super::align::{CameraPair, PoseDistance, pose_distances};
use super::colmap_run::{ColmapOptions, colmap_run};
use super::{ForeignAnswer, ForeignError, TrajectoryPicture, features, versions};
use crate::colmap::{ColmapImage, ColmapModel};
use crate::reconstruct::ProgramWorkspace;
use crate::solving::PairRule;
use gs2e_files::programs::EndKind;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::lens::Distortion;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Default number of registered pictures.
pub const PICTURES: u32 = 20;
/// Minimum number of pictures: an arrangement needs at least three cameras to mean anything.
pub const MIN_PICTURES: u32 = 3;

/// COLMAP's answer on some pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColmapRegistration {
    /// The program, with its version.
    pub program: String,
    /// Number of given pictures.
    pub given: usize,
    /// Sum of the distances from each registered picture to the next, scene units.
    pub path: f64,
    /// The registered pictures, ordered by time.
    pub poses: Vec<PoseAgreement>,
}

/// Distance of a pose from COLMAP's pose after the alignment of the worlds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseAgreement {
    /// Index of the pose.
    pub pose: usize,
    /// Angle between the rotations, degrees.
    pub rotation_deg: f64,
    /// Distance of the centres divided by the length of the path; 0 for a path of length 0.
    pub translation: f64,
}

/// COLMAP's message when the mapper ends with exit code 1 and no model.
const NO_MODEL: &str = "failed to create sparse model";

/// COLMAP's poses of pictures, in its own world.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapPoses {
    /// The program, with its version.
    pub program: String,
    /// Index and pose, camera to world, of each given picture; `None` if it was not registered.
    pub poses: Vec<(usize, Option<Se3>)>,
}

/// Registers pictures.
///
/// # Errors
/// A file cannot be used, COLMAP fails, or the work was asked to stop.
pub fn register_pictures(
    pictures: &[TrajectoryPicture],
    camera: &Camera,
    workspace: ProgramWorkspace<'_>,
) -> Result<ForeignAnswer<ColmapPoses>, ForeignError> {
    let program = match versions::colmap(workspace.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    if pictures.len() < MIN_PICTURES as usize {
        return Ok(Err(format!("there are {} pictures, {MIN_PICTURES} are the fewest", pictures.len())));
    }
    let images = match make_model(pictures, camera, workspace)? {
        Ok(images) => images,
        Err(because) => return Ok(Err(format!("{program} {because}"))),
    };
    let pose = |picture: &TrajectoryPicture| {
        let name = name_of(picture.pose);
        let image = images.iter().find(|image| image.name == name)?;
        let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
        Some(camera_from_world.inverse())
    };
    let poses = pictures.iter().map(|picture| (picture.pose, pose(picture))).collect();
    Ok(Ok(ColmapPoses { program, poses }))
}

/// Returns the registered images of the model that COLMAP makes of these pictures.
fn make_model(
    pictures: &[TrajectoryPicture],
    camera: &Camera,
    workspace: ProgramWorkspace<'_>,
) -> Result<ForeignAnswer<Vec<ColmapImage>>, ForeignError> {
    let place = |name: &str| workspace.folder.join(name);
    let (database, images, sparse) = (place("database.db"), place("images"), place("sparse"));
    for folder in [&images, &sparse] {
        std::fs::create_dir(folder).map_err(ForeignError::io_error(folder))?;
    }
    for picture in pictures {
        let link = images.join(name_of(picture.pose));
        // A relative link would be resolved from its own folder.
        let file = std::path::absolute(&picture.file).map_err(ForeignError::io_error(&picture.file))?;
        std::os::unix::fs::symlink(file, &link).map_err(ForeignError::io_error(&link))?;
    }
    let colmap = |command: &str, options| colmap_run(command, &database, options, workspace);
    colmap("feature_extractor", extraction_options(&images, camera)).end_well()?;
    let described = features::read_database(&database).map_err(ForeignError::product_error(&database))?;
    let all = PairRule::Exhaustive.pairs(described.len());
    let matched = features::match_pairs(&described, &all, workspace.goes_on);
    let (matches, pairs) = matched.ok_or(ForeignError::Stopped)?;
    if pairs == 0 {
        return Ok(Err("finds no key points shared by two pictures".to_owned()));
    }
    let list = place("matches.txt");
    std::fs::write(&list, matches).map_err(ForeignError::io_error(&list))?;
    colmap("matches_importer", import_options(&list)).end_well()?;
    match colmap("mapper", mapping_options(&images, &sparse)).end()? {
        Ok(ran) => {
            // With `multiple_models` off, the only model is number 0.
            let read = || ColmapModel::find_model(&sparse.join("0"))?.images();
            read().map(Ok).map_err(|e| ran.failed(EndKind::Product(format!("its model: {e}"))))
        }
        Err(ran) if ran.says(NO_MODEL) => {
            Ok(Err("finds no pair of pictures to start a model from".to_owned()))
        }
        Err(ran) => Err(ran.failed(EndKind::Code(1))),
    }
}

fn name_of(pose: usize) -> String {
    // Six digits, so that names sort like poses.
    format!("{pose:06}.png")
}

fn extraction_options(images: &Path, camera: &Camera) -> ColmapOptions {
    let Camera { fx, fy, cx, cy, lens, .. } = camera;
    let (model, coefficients) = match lens {
        None => ("PINHOLE", &[][..]),
        Some(lens @ Distortion::Rational(_)) => ("FULL_OPENCV", lens.coefficients()),
        Some(lens @ Distortion::Fisheye(_)) => ("OPENCV_FISHEYE", lens.coefficients()),
    };
    let numbers = [fx, fy, cx, cy].into_iter().chain(coefficients);
    let numbers: Vec<String> = numbers.map(ToString::to_string).collect();
    vec![
        ("--image_path", images.into()),
        ("--ImageReader.single_camera", "1".into()),
        ("--ImageReader.camera_model", model.into()),
        ("--ImageReader.camera_params", numbers.join(",").into()),
        ("--SiftExtraction.use_gpu", "0".into()),
        ("--SiftExtraction.num_threads", "1".into()),
        ("--SiftExtraction.max_num_features", "2048".into()),
    ]
}

fn import_options(list: &Path) -> ColmapOptions {
    vec![
        ("--match_list_path", list.into()),
        ("--match_type", "raw".into()),
        ("--SiftMatching.use_gpu", "0".into()),
        ("--SiftMatching.num_threads", "1".into()),
    ]
}

/// Options of the mapper: one thread, one model, fixed intrinsics and a narrow error limit.
fn mapping_options(images: &Path, sparse: &Path) -> ColmapOptions {
    vec![
        ("--image_path", images.into()),
        ("--output_path", sparse.into()),
        ("--Mapper.num_threads", "1".into()),
        ("--Mapper.multiple_models", "0".into()),
        ("--Mapper.ba_refine_focal_length", "0".into()),
        ("--Mapper.ba_refine_principal_point", "0".into()),
        ("--Mapper.ba_refine_extra_params", "0".into()),
        ("--Mapper.filter_max_reproj_error", "1".into()),
    ]
}

impl ColmapPoses {
    /// Compares COLMAP's poses with the poses of a trajectory, camera to world.
    #[must_use]
    pub fn against(self, stated: &[Se3]) -> ColmapRegistration {
        let Self { program, poses } = self;
        let pair = |(pose, found): &(usize, Option<Se3>)| {
            Some((*pose, CameraPair { stated: stated[*pose], found: (*found)? }))
        };
        let (numbers, pairs): (Vec<usize>, Vec<CameraPair>) = poses.iter().filter_map(pair).unzip();
        let centre = |pair: &CameraPair| pair.stated.translation;
        // Only registered pictures count, because only their errors are divided by the length.
        let path: f64 = pairs.windows(2).map(|w| centre(&w[1]).distance(centre(&w[0]))).sum();
        let registered = |(pose, apart): (usize, PoseDistance)| PoseAgreement {
            pose,
            rotation_deg: apart.rotation * 180.0 / std::f64::consts::PI,
            translation: if path > 0.0 { apart.translation / path } else { 0.0 },
        };
        let given = poses.len();
        let poses = numbers.into_iter().zip(pose_distances(&pairs)).map(registered).collect();
        ColmapRegistration { program, given, path, poses }
    }
}
