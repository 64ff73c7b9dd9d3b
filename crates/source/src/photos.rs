//! Photos without poses: a folder with the photos of one scene. A step of the build finds the poses
//! with COLMAP, and the model is then read with the photos.

use super::colmap::{self, ColmapModel};
use super::inventory::{self, ScenePath};
use super::layout::CaptureLayout;
use super::photo::{self, PhotoScrutiny};
use super::{Capture, DiskCapture, SourceError, SourceWarning};
use gs2e_files::MAX_DEPTH;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Minimum number of photos: two show a scene only up to the noise of one pair.
pub const MIN_PHOTOS: usize = 3;

/// Folders of photos.
pub(super) struct PhotosLayout;

impl CaptureLayout for PhotosLayout {
    fn name(&self) -> &'static str {
        "photos"
    }

    fn words(&self) -> &'static str {
        "photos without poses"
    }

    fn read(
        &self,
        captured: &DiskCapture,
        _: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        Err(unsolved(&captured.path))
    }

    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        photo_files(&captured.path)
    }

    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf> {
        colmap::folders_below(&captured.path, MAX_DEPTH).collect()
    }

    fn needs_poses(&self) -> bool {
        true
    }

    fn scenes(&self, root: &Path, _: &BTreeSet<String>) -> Result<Vec<ScenePath>, SourceError> {
        inventory::capture_folders(root, &|folder| photo::has_photos(folder))
    }
}

/// The error of a reader that needs poses.
pub(super) fn unsolved(path: &Path) -> SourceError {
    let because = "it has no poses: a build finds them, in a step of its own".to_owned();
    SourceError::Absent { dir: path.to_owned(), because }
}

/// The photos of a folder, each with its name within a source.
fn photo_files(folder: &Path) -> Result<Vec<(String, PathBuf)>, SourceError> {
    if !super::is_folder(folder)? {
        let because = "it is a file, wanted a folder of photos; a video has its own kind, `video`".to_owned();
        return Err(SourceError::Absent { dir: folder.to_owned(), because });
    }
    let names = photo::list_photos(folder)?;
    Ok(names.into_iter().map(|name| (format!("images/{name}"), folder.join(name))).collect())
}

/// The name of a photo, from its name within a source.
#[must_use]
pub fn base_name(listed: &str) -> &str {
    listed.strip_prefix("images/").unwrap_or(listed)
}

impl DiskCapture {
    /// Reads a capture whose poses were found: `model` has the poses, and `photos` are all photos
    /// by their names, with and without a pose.
    ///
    /// # Errors
    /// A file is absent or damaged, or no view is left.
    pub fn read_solved(
        &self,
        model: &ColmapModel,
        photos: &[(String, PathBuf)],
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        let (capture, mut warnings) = colmap::read_listed(model, photos)?;
        // No warning about distortion: a scene of these poses is trained here, on undistorted photos.
        let capture = self.select(capture, &mut warnings)?;
        Ok((capture, warnings))
    }

    /// Returns true if a photo with this name is used to find poses.
    pub fn is_given(&self) -> impl Fn(&str) -> bool {
        let is_excluded = self.selection.excludes();
        move |name: &str| !is_excluded(name)
    }
}
