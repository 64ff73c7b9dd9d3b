//! `MVImgNet` (GitHub GAP-LAB-CUHK-SZ/MVImgNet): an instance is a folder `<class>/<instance>` with
//! a COLMAP model in `sparse/0` and its photos in `images`.
//!
//! The same folder contains photos with the background removed, as `*_bg_removed.png`. They are no
//! views. Some instances have no model.

use super::colmap::{self, ColmapModel, ModelPhotos, PhotoSizing};
use super::photo::PhotoScrutiny;
use super::{Capture, SourceError, SourceWarning};
use crate::files::{MAX_DEPTH, is_there};
use std::path::{Path, PathBuf};

/// Pattern of the names of photos that are no views.
pub const LEFTOVERS: &str = "*_bg_removed.png";

/// Returns true if the name of a folder is that of a class: a number.
pub(super) fn is_class(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit())
}

/// Returns true if the name of a folder is that of an instance: 8 hexadecimal digits.
pub(super) fn is_instance(name: &str) -> bool {
    name.len() == 8 && name.bytes().all(|b| b.is_ascii_hexdigit())
}

/// Returns the model of an instance.
pub(super) fn instance_model(instance: &Path) -> Result<ColmapModel, SourceError> {
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

pub(super) fn read_capture(
    instance: &Path,
    look: PhotoScrutiny,
) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
    let folder = photo_folder(instance);
    colmap::read_model(
        &instance_model(instance)?,
        ModelPhotos { folder: Some(&folder), sizing: PhotoSizing::AsStated, look },
    )
}

pub(super) fn source_files(instance: &Path) -> Result<Vec<(String, PathBuf)>, SourceError> {
    colmap::files_of(&instance_model(instance)?, Some(&photo_folder(instance)))
}

pub(super) fn source_folders(instance: &Path) -> Vec<PathBuf> {
    let sparse = [instance.to_owned(), instance.join("sparse"), instance.join("sparse/0")];
    sparse
        .into_iter()
        .filter(|dir| dir.is_dir())
        .chain(colmap::folders_below(&photo_folder(instance), MAX_DEPTH))
        .collect()
}
