//! `MVImgNet` (GitHub GAP-LAB-CUHK-SZ/MVImgNet): an instance is a folder `<class>/<instance>` with
//! a COLMAP model in `sparse/0` and its photos in `images`.
//!
//! The same folder contains photos with the background removed, as `*_bg_removed.png`. They are no
//! views. Some instances have no model.

use super::colmap::{self, ColmapModel, ModelPhotos, PhotoPlace, PhotoSizing};
use super::inventory::{RejectionReason, ScenePath, list_subfolders};
use super::layout::CaptureLayout;
use super::photo::PhotoScrutiny;
use super::{Capture, DiskCapture, SourceDataset, SourceError, SourceWarning};
use gs2e_files::{MAX_DEPTH, is_there};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

static DATASET: SourceDataset = SourceDataset {
    name: "MVImgNet",
    url: "https://github.com/GAP-LAB-CUHK-SZ/MVImgNet",
    scale: "object",
    leftovers: &["*_bg_removed.png"],
    has_classes: true,
    has_two_poses: false,
};

/// Instances of the dataset.
pub(super) struct MvimgnetLayout;

impl CaptureLayout for MvimgnetLayout {
    fn name(&self) -> &'static str {
        "mvimgnet"
    }

    fn words(&self) -> &'static str {
        "an instance of MVImgNet"
    }

    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        let folder = photo_folder(&captured.path);
        let from = Some(PhotoPlace::Folder(&folder));
        let photos = ModelPhotos { from, sizing: PhotoSizing::AsStated, look };
        colmap::read_model(&instance_model(&captured.path)?, photos)
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        colmap::files_of(&instance_model(&captured.path)?, Some(&photo_folder(&captured.path)))
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        let path = &captured.path;
        let own = [path.clone(), path.join("sparse"), path.join("sparse/0")];
        let own = own.into_iter().filter(|dir| dir.is_dir());
        own.chain(colmap::folders_below(&photo_folder(path), MAX_DEPTH)).collect()
    }

    fn model(&self, captured: &DiskCapture) -> Option<ColmapModel> {
        instance_model(&captured.path).ok()
    }

    fn scenes(&self, root: &Path, classes: &BTreeSet<String>) -> Result<Vec<ScenePath>, SourceError> {
        instance_folders(root, classes)
    }

    fn dataset(&self) -> Option<&'static SourceDataset> {
        Some(&DATASET)
    }

    fn upstream_id(&self, path: &Path) -> Option<String> {
        let mut names = path.iter().rev().map(|name| name.to_str());
        let (instance, class) = (names.next()??, names.next()??);
        (is_instance(instance) && is_class(class)).then(|| format!("{class}/{instance}"))
    }
}

/// Returns true if the name of a folder is that of a class: a number.
fn is_class(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}

/// Returns true if the name of a folder is that of an instance: 8 hexadecimal digits.
fn is_instance(name: &str) -> bool {
    name.len() == 8 && name.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Returns the model of an instance.
fn instance_model(instance: &Path) -> Result<ColmapModel, SourceError> {
    std::fs::read_dir(instance).map_err(SourceError::io_error(instance))?;
    let dir = instance.join("sparse/0");
    ColmapModel::model_at(dir.clone()).ok_or_else(|| {
        let is_there =
            |name: &str| ["bin", "txt"].iter().any(|form| is_there(&dir.join(name).with_extension(form)));
        let because = match (is_there("cameras"), is_there("images")) {
            (false, false) => "the instance has no COLMAP model: cameras and images are missing",
            (false, true) => "the instance's COLMAP model has no cameras",
            (true, false) => "the instance's COLMAP model has no images",
            (true, true) => {
                "the files of the instance's COLMAP model have mixed formats, wanted all .bin or all .txt"
            }
        };
        SourceError::Absent { dir, because: because.to_owned() }
    })
}

fn photo_folder(instance: &Path) -> PathBuf {
    instance.join("images")
}

/// Finds `class/instance` folders. Classes are numbers; other folders are ignored.
fn instance_folders(root: &Path, classes: &BTreeSet<String>) -> Result<Vec<ScenePath>, SourceError> {
    let wanted = |class: &str| is_class(class) && (classes.is_empty() || classes.contains(class));
    let mut found = Vec::new();
    for (class, dir) in list_subfolders(root)?.into_iter().filter(|(class, _)| wanted(class)) {
        found.extend(list_subfolders(&dir)?.into_iter().map(|(instance, path)| {
            let known = is_instance(&instance);
            let misnamed = (!known).then_some(RejectionReason::Name("8 hexadecimal digits"));
            ScenePath { name: format!("{class}/{instance}"), path, misnamed }
        }));
    }
    Ok(found)
}
