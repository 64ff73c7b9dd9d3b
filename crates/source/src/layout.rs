//! Tasks of a kind of capture on disk. Each kind is one file that implements [`CaptureLayout`];
//! [`super::kind::CaptureKind`] is the list of them.

use super::colmap::ColmapModel;
use super::inventory::{self, ScenePath};
use super::photo::PhotoScrutiny;
use super::{Capture, DiskCapture, SourceError, SourceWarning};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A kind of capture on disk.
pub(super) trait CaptureLayout: Sync {
    /// Name of the kind in recipes and in `scene.json`.
    fn name(&self) -> &'static str;

    /// The kind in a sentence, with its article.
    fn words(&self) -> &'static str;

    /// Returns true if the files of a folder show that it is of this kind. Layouts of datasets are
    /// also of a general kind, and are recognised as that one.
    fn is_in(&self, _folder: &Path) -> bool {
        false
    }

    /// Returns true if the name of a file shows that it is of this kind.
    fn is_file(&self, _file: &Path) -> bool {
        false
    }

    /// Reads a capture, whatever its selection of views.
    ///
    /// # Errors
    /// A file is absent or damaged, or has content that is not supported.
    fn read(
        &self,
        captured: &DiskCapture,
        look: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError>;

    /// The files that [`CaptureLayout::read`] reads, each with its name within the source.
    ///
    /// # Errors
    /// The names of the photos are in a file that cannot be read.
    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError>;

    /// The existing folders whose listing determines [`CaptureLayout::files`].
    fn folders(&self, captured: &DiskCapture) -> Vec<PathBuf>;

    /// The COLMAP model of the poses, if they come from a model.
    fn model(&self, _captured: &DiskCapture) -> Option<ColmapModel> {
        None
    }

    /// The folders of a tree that may be scenes of this kind, and those with photos that lack its files.
    /// `classes` are the wanted classes, if the kind has classes; all if empty.
    ///
    /// # Errors
    /// The tree cannot be listed.
    fn scenes(&self, root: &Path, _classes: &BTreeSet<String>) -> Result<Vec<ScenePath>, SourceError> {
        let mut found = inventory::capture_folders(root, &|folder| self.is_in(folder))?;
        if !self.has_gaussians() {
            inventory::add_photo_folders(root, &mut found);
        }
        Ok(found)
    }

    /// Returns true if the files of this kind have no poses, so that a step finds them.
    fn needs_poses(&self) -> bool {
        false
    }

    /// Returns true if the source is a video, so that a step takes frames from it.
    fn is_video(&self) -> bool {
        false
    }

    /// Returns true if the folder has the Gaussians of the scene, and no photos.
    fn has_gaussians(&self) -> bool {
        false
    }

    /// The dataset whose layout this is.
    fn dataset(&self) -> Option<&'static SourceDataset> {
        None
    }

    /// Id of a capture in its dataset, as the names of its folders show it.
    fn upstream_id(&self, _path: &Path) -> Option<String> {
        None
    }
}

/// A dataset with a layout of its own.
#[derive(Debug, PartialEq, Eq)]
pub struct SourceDataset {
    /// Name of the dataset; also that of its row in the ledger of licences.
    pub name: &'static str,
    /// Its address.
    pub url: &'static str,
    /// Scale of its scenes, as in `scene.json`.
    pub scale: &'static str,
    /// Patterns of the names of photos that are no views.
    pub leftovers: &'static [&'static str],
    /// True if its scenes are in folders of classes.
    pub has_classes: bool,
    /// True if its scenes may have two files of poses.
    pub has_two_poses: bool,
}
