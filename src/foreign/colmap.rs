//! COLMAP registers pictures anew, without being told where they were taken: only with which camera.
//!
//! Key points by its SIFT on the CPU, 2,048 of a picture at most; matches by our own rule (see `features`); verified pairs, and one
//! model by its mapper with the intrinsics kept. Points farther than 1 px from their key points are left out of the model
//! (COLMAP's default, 4 px, is for lenses): on rendered pictures this brings the poses nearer by a factor of three.

use super::align::{Apart, Pair, apart};
use super::run::Run;
use super::versions::COLMAP;
use super::{ForeignError, Picture, Told, features, versions};
use crate::camera::Camera;
use crate::programs::How;
use crate::reconstruct::Desk;
use crate::se3::Se3;
use crate::source::colmap::{Image, Model};
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::path::Path;

/// Pictures that are registered where nobody says how many.
pub const PICTURES: u32 = 20;
/// Three cameras are the fewest whose arrangement says anything.
pub const LEAST_PICTURES: u32 = 3;

/// What COLMAP found of some pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registration {
    /// The program, with its version.
    pub program: String,
    /// How many pictures it was given.
    pub given: usize,
    /// Length of the straight lines from each picture that it registered to the next, scene units.
    pub path: f64,
    /// The pictures that it registered, in the order of time.
    pub poses: Vec<Registered>,
}

/// How far a pose is from where COLMAP found it, once the two worlds are one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Registered {
    /// Number of the pose.
    pub pose: usize,
    /// Angle between the rotations, degrees.
    pub rotation_deg: f64,
    /// Distance of the centres over the length of the path; 0 where there is none.
    pub translation: f64,
}

/// No step takes so long: a day for each.
const MOST_SECONDS: u32 = 86_400;
/// What the mapper says where it ends with exit code 1 and no model.
const NO_MODEL: &str = "failed to create sparse model";

/// Where COLMAP found pictures, in a world of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The program, with its version.
    pub program: String,
    /// Number and pose, camera to world, of each picture that was given; `None` where it was not registered.
    pub poses: Vec<(usize, Option<Se3>)>,
}

/// Registers pictures.
///
/// # Errors
/// When a file cannot be used, COLMAP fails, or the work was asked to stop.
pub fn register(pictures: &[Picture], camera: &Camera, desk: Desk<'_>) -> Result<Told<Found>, ForeignError> {
    let program = match versions::colmap(desk.programs) {
        Ok(program) => program,
        Err(because) => return Ok(Err(because)),
    };
    if pictures.len() < LEAST_PICTURES as usize {
        return Ok(Err(format!("there are {} pictures, {LEAST_PICTURES} are the fewest", pictures.len())));
    }
    let images = match model(pictures, camera, desk)? {
        Ok(images) => images,
        Err(because) => return Ok(Err(format!("{program} {because}"))),
    };
    let pose = |picture: &Picture| {
        let name = name_of(picture.pose);
        let image = images.iter().find(|image| image.name == name)?;
        let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
        Some(camera_from_world.inverse())
    };
    let poses = pictures.iter().map(|picture| (picture.pose, pose(picture))).collect();
    Ok(Ok(Found { program, poses }))
}

/// The registered images of the model that COLMAP makes of these pictures.
fn model(pictures: &[Picture], camera: &Camera, desk: Desk<'_>) -> Result<Told<Vec<Image>>, ForeignError> {
    let place = |name: &str| desk.folder.join(name);
    let (database, images, sparse) = (place("database.db"), place("images"), place("sparse"));
    for folder in [&images, &sparse] {
        std::fs::create_dir(folder).map_err(ForeignError::io(folder))?;
    }
    for picture in pictures {
        let link = images.join(name_of(picture.pose));
        let file = std::path::absolute(&picture.file).map_err(ForeignError::io(&picture.file))?;
        std::os::unix::fs::symlink(file, &link).map_err(ForeignError::io(&link))?;
    }
    let colmap = |command: &str, options: &[(&str, OsString)]| {
        let fixed = [("--random_seed", OsString::from("1")), ("--database_path", database.clone().into())];
        let options =
            fixed.iter().chain(options).flat_map(|(key, value)| [OsString::from(key), value.clone()]);
        let arguments = std::iter::once(OsString::from(command)).chain(options).collect();
        Run { program: COLMAP, arguments, seconds: MOST_SECONDS, desk }
    };
    colmap("feature_extractor", &extraction(&images, camera)).end_well()?;
    let described = features::read(&database).map_err(ForeignError::own(&database))?;
    let (matches, pairs) = features::matches(&described);
    if !(desk.goes_on)() {
        return Err(ForeignError::Stopped);
    }
    if pairs == 0 {
        return Ok(Err("finds no key points that two pictures share".to_owned()));
    }
    let list = place("matches.txt");
    std::fs::write(&list, matches).map_err(ForeignError::io(&list))?;
    colmap("matches_importer", &import(&list)).end_well()?;
    match colmap("mapper", &mapping(&images, &sparse)).end()? {
        Ok(ran) => {
            let read = || Model::find(&sparse.join("0"))?.images();
            read().map(Ok).map_err(|e| ran.failed(How::Product(format!("its model: {e}"))))
        }
        Err(ran) if ran.says(NO_MODEL) => Ok(Err("finds no two pictures to begin a model with".to_owned())),
        Err(ran) => Err(ran.failed(How::Code(1))),
    }
}

fn name_of(pose: usize) -> String {
    format!("{pose:06}.png")
}

type Options = Vec<(&'static str, OsString)>;

fn extraction(images: &Path, camera: &Camera) -> Options {
    let Camera { fx, fy, cx, cy, .. } = camera;
    vec![
        ("--image_path", images.into()),
        ("--ImageReader.single_camera", "1".into()),
        ("--ImageReader.camera_model", "PINHOLE".into()),
        ("--ImageReader.camera_params", format!("{fx},{fy},{cx},{cy}").into()),
        ("--SiftExtraction.use_gpu", "0".into()),
        ("--SiftExtraction.num_threads", "1".into()),
        ("--SiftExtraction.max_num_features", "2048".into()),
    ]
}

fn import(list: &Path) -> Options {
    vec![
        ("--match_list_path", list.into()),
        ("--match_type", "raw".into()),
        ("--SiftMatching.use_gpu", "0".into()),
        ("--SiftMatching.num_threads", "1".into()),
    ]
}

/// The angle between the rays of a point may be small: clips are short.
fn mapping(images: &Path, sparse: &Path) -> Options {
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

impl Found {
    /// Holds what was found against the poses of a trajectory, camera to world.
    #[must_use]
    pub fn against(self, stated: &[Se3]) -> Registration {
        let Self { program, poses } = self;
        let pair = |(pose, found): &(usize, Option<Se3>)| {
            Some((*pose, Pair { stated: stated[*pose], found: (*found)? }))
        };
        let (numbers, pairs): (Vec<usize>, Vec<Pair>) = poses.iter().filter_map(pair).unzip();
        let centre = |pair: &Pair| pair.stated.translation;
        let path: f64 = pairs.windows(2).map(|w| centre(&w[1]).distance(centre(&w[0]))).sum();
        let registered = |(pose, apart): (usize, Apart)| Registered {
            pose,
            rotation_deg: apart.rotation * 180.0 / std::f64::consts::PI,
            translation: if path > 0.0 { apart.translation / path } else { 0.0 },
        };
        let given = poses.len();
        let poses = numbers.into_iter().zip(apart(&pairs)).map(registered).collect();
        Registration { program, given, path, poses }
    }
}
