//! COLMAP models (GitHub colmap/colmap, `doc/format.rst`): `cameras`, `images` and `points3D`, as
//! `.bin` or `.txt`.
//!
//! Poses are stored as world to camera with quaternion w first. Pixel centres lie at half-integers,
//! as in this program. If both forms exist, the binary form is read.

mod binary;
mod capture;
mod lenses;
mod model;
mod reprojection;
mod text;
pub mod write;

pub(super) use capture::{ModelPhotos, PhotoPlace, PhotoSizing, files_of, read_listed, read_model};
pub use model::ColmapModel;
pub use reprojection::ReprojectionStats;

use super::layout::CaptureLayout;
use super::photo::{self, PhotoScrutiny};
use super::{Capture, DiskCapture, SourceError, SourcePlace, SourceWarning};
use glam::{DQuat, DVec3};
use gs2e_files::{FolderWalk, MAX_DEPTH};
use gs2e_num::se3;
use gs2e_scene::camera::Camera;
use model::DEEPEST;
use std::path::{Path, PathBuf};

/// A camera of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelCamera {
    /// Pinhole part.
    pub camera: Camera,
    /// Lens distortion.
    pub lens: super::LensModel,
}

/// A registered image of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapImage {
    /// Name, which may contain folders.
    pub name: String,
    /// Id of its camera.
    pub camera_id: u32,
    /// Rotation, unit quaternion, world to camera, with the deviation of the stored rotation.
    pub rotation: se3::ScreenedRotation,
    /// Translation, world to camera.
    pub translation: DVec3,
    /// Key points.
    pub observations: Vec<KeyPoint>,
    /// Place in the file.
    pub place: SourcePlace,
}

/// A key point of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeyPoint {
    /// Position, px.
    pub xy: [f64; 2],
    /// Id of its point, if one was triangulated.
    pub point: Option<u64>,
}

/// A triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColmapPoint {
    /// Position in the world.
    pub xyz: DVec3,
    /// Colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error, px, as stored by COLMAP.
    pub error: f64,
}

/// COLMAP models.
pub(super) struct ColmapLayout;

impl CaptureLayout for ColmapLayout {
    fn name(&self) -> &'static str {
        "colmap"
    }

    fn words(&self) -> &'static str {
        "a COLMAP model"
    }

    fn is_in(&self, folder: &Path) -> bool {
        ColmapModel::model_near(folder).is_some()
    }

    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        look_at(&captured.path, look)
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        let model = ColmapModel::find_model(&captured.path)?;
        files_of(&model, model.photos().as_deref())
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        // A model lies in `sparse/0` of the deepest folder that is looked into, and no deeper.
        let mut folders: Vec<PathBuf> = folders_below(&captured.path, DEEPEST + 2).collect();
        if let Ok(model) = ColmapModel::find_model(&captured.path) {
            folders.extend(model.bases().into_iter().map(photo::or_here));
            let photos = model.photos().into_iter();
            folders.extend(photos.flat_map(|images| folders_below(&images, MAX_DEPTH).collect::<Vec<_>>()));
        }
        folders.sort();
        folders.dedup();
        folders
    }

    fn model(&self, captured: &DiskCapture) -> Option<ColmapModel> {
        ColmapModel::find_model(&captured.path).ok()
    }
}

/// Reads the model found in `dir` as a capture.
///
/// # Errors
/// No model or more than one is found, a file is damaged, the model of a camera is not supported,
/// or two images have the same name.
pub fn read_capture(dir: &Path) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    look_at(dir, PhotoScrutiny::Bytes)
}

/// Reads the model found in `dir`, with the given depth of reading for photos.
pub(super) fn look_at(dir: &Path, look: PhotoScrutiny) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let model = ColmapModel::find_model(dir)?;
    let folder = model.photos();
    let from = folder.as_deref().map(PhotoPlace::Folder);
    read_model(&model, ModelPhotos { from, sizing: PhotoSizing::AsStated, look })
}

/// A folder and the folders below it, down to a depth. Folders that cannot be walked are left out.
pub(super) fn folders_below(root: &Path, depth: usize) -> impl Iterator<Item = PathBuf> {
    let entries = FolderWalk::new(root).to_depth(depth).entries(|_| true).filter_map(Result::ok);
    entries.filter(|entry| entry.file_type().is_dir()).map(walkdir::DirEntry::into_path)
}

/// Reads a file of points in the order of their ids. The file name determines the form.
///
/// # Errors
/// The file is absent or damaged.
pub(crate) fn read_points(file: &Path) -> Result<Vec<ColmapPoint>, SourceError> {
    let is_text = file.extension().is_some_and(|extension| extension == "txt");
    let points = if is_text { text::read_points(file) } else { binary::read_points(file) }?;
    Ok(points.into_values().collect())
}

/// Converts the seven numbers of a pose that COLMAP stores.
fn image_pose([w, x, y, z, tx, ty, tz]: [f64; 7]) -> Result<(se3::ScreenedRotation, DVec3), String> {
    let translation = DVec3::new(tx, ty, tz);
    if !translation.is_finite() {
        return Err(format!("the translation is {translation}, wanted finite numbers"));
    }
    // COLMAP stores `w` first.
    let rotation = se3::rotation_from_quaternion(DQuat::from_xyzw(x, y, z, w)).map_err(|e| e.to_string())?;
    Ok((rotation, translation))
}
