//! A video of one scene. A step of the build takes frames from it with ffmpeg, and the frames are
//! then treated like photos without poses.

use super::layout::CaptureLayout;
use super::photo::PhotoScrutiny;
use super::photos::unsolved;
use super::{Capture, DiskCapture, SourceError, SourceWarning};
use std::path::PathBuf;

/// Videos.
pub(super) struct VideoLayout;

impl CaptureLayout for VideoLayout {
    fn name(&self) -> &'static str {
        "video"
    }

    fn words(&self) -> &'static str {
        "a video"
    }

    fn read(
        &self,
        captured: &DiskCapture,
        _: PhotoScrutiny,
    ) -> Result<(Capture, Vec<SourceWarning>), SourceError> {
        Err(unsolved(&captured.path))
    }

    /// The video. It enters keys by this name, whatever the name of the file.
    fn files(&self, captured: &DiskCapture) -> Result<Vec<(String, PathBuf)>, SourceError> {
        if super::is_folder(&captured.path)? {
            let because = "it is a folder, wanted a video; photos have their own kind, `photos`".to_owned();
            return Err(SourceError::Absent { dir: captured.path.clone(), because });
        }
        Ok(vec![("video".to_owned(), captured.path.clone())])
    }

    fn folders(&self, _: &DiskCapture) -> Vec<PathBuf> {
        Vec::new()
    }

    fn needs_poses(&self) -> bool {
        true
    }

    fn is_video(&self) -> bool {
        true
    }
}
