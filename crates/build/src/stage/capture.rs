//! Stage `capture`: reads and normalises a source.

use super::{SourceFile, Stage, StageContext, StageError, StageFacts, StepTarget};
use crate::artifact::{PictureSet, SolvedModel};
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_files::is_there;
use gs2e_source::colmap::ColmapModel;
use gs2e_source::photos::base_name;
use gs2e_source::{Capture, DiskCapture};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Parameters: the source. Paths stay out of the key; the content of the files enters it.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CaptureStage {
    /// The capture of the embedded scene, for any number of Gaussians.
    Procedural {
        /// Number of key views.
        views: u32,
        /// Extent of the arc in degrees.
        arc: f64,
        /// Seed of the capture's unevenness.
        seed: u64,
    },
    /// No source: a capture without views.
    None,
    /// A capture on disk: its kind and selection. The content of its files enters by digest.
    #[serde(untagged)]
    Captured(DiskCapture),
}

impl CaptureStage {
    /// The capture of an embedded scene.
    #[must_use]
    pub(crate) fn procedural(still_life: &StillLife) -> Self {
        let StillLife { views, arc, seed, .. } = *still_life;
        Self::Procedural { views, arc, seed }
    }
}

/// The steps that find the poses of a source without poses: its model, and its frames if it is a
/// video.
pub(crate) type SolvingInputs = Option<(StepTarget<SolvedModel>, Option<StepTarget<PictureSet>>)>;
/// The outputs of these steps.
pub(crate) type SolvedInputs = Option<(SolvedModel, Option<PictureSet>)>;

/// Endings of files that are not photos.
const NO_PHOTOS: [&str; 3] = ["bin", "txt", "json"];

impl CaptureStage {
    /// The photos: those among its files, and the frames of a video.
    ///
    /// # Errors
    /// The source cannot be listed.
    pub(super) fn all_photos(&self, solved: &SolvedInputs) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.photos()?;
        files.extend(frames_of(solved));
        Ok(files)
    }

    /// The photos among its files.
    ///
    /// # Errors
    /// The source cannot be listed.
    pub(super) fn photos(&self) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.sources()?;
        files.retain(|f| !f.path.extension().is_some_and(|ending| NO_PHOTOS.iter().any(|no| ending == *no)));
        Ok(files)
    }
}

impl CaptureStage {
    /// The photos, and the points of its model. Its poses come with the capture.
    ///
    /// # Errors
    /// The source cannot be listed.
    pub(super) fn photos_and_points(&self) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.sources()?;
        files.retain(|file| !holds_poses(&file.path));
        Ok(files)
    }

    /// The photos and the points, each with its name in the source; those that steps made included.
    ///
    /// # Errors
    /// The source cannot be listed.
    pub(super) fn training_files(&self, solved: &SolvedInputs) -> Result<Vec<(String, PathBuf)>, StageError> {
        let mut files = self.photos_and_points()?;
        files.extend(frames_of(solved));
        let points = solved.iter().map(|(model, _)| model.points.clone());
        files.extend(points.map(|path| SourceFile { name: "points3D.bin".to_owned(), path }));
        Ok(files.into_iter().map(|file| (file.name, file.path)).collect())
    }

    /// The COLMAP model on disk from which its poses come, if there is one.
    pub(super) fn model(&self) -> Option<ColmapModel> {
        match self {
            Self::Captured(captured) => captured.model(),
            Self::Procedural { .. } | Self::None => None,
        }
    }
}

impl StageFacts for CaptureStage {
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let Self::Captured(captured) = self else { return Ok(Vec::new()) };
        if captured.kind.is_video() {
            // The frames of a video are the product of a step.
            return Ok(Vec::new());
        }
        let root = &captured.path;
        if !is_there(root) {
            return Err(StageError::Missing { path: root.clone() });
        }
        let listed = captured.files().map_err(StageError::work_failed("read the source"))?;
        Ok(listed.into_iter().map(|(name, path)| SourceFile { name, path }).collect())
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        match self {
            Self::Captured(captured) => captured.folders(),
            Self::Procedural { .. } | Self::None => Vec::new(),
        }
    }
}

impl Stage for CaptureStage {
    const NAME: &'static str = "capture";
    const REVISION: u32 = 1;
    type Inputs = SolvingInputs;
    type Output = Capture;

    fn run(&self, solved: SolvedInputs, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, warnings) = match self {
            Self::Procedural { views, arc, seed } => {
                let still_life = StillLife { views: *views, arc: *arc, seed: *seed, ..StillLife::default() };
                (procedural::still_capture(&still_life), Vec::new())
            }
            Self::Captured(captured) => {
                let read = match &solved {
                    Some((model, _)) => {
                        let photos = self.all_photos(&solved)?.into_iter();
                        let photos: Vec<_> =
                            photos.map(|file| (base_name(&file.name).to_owned(), file.path)).collect();
                        captured.read_solved(&model.model, &photos)
                    }
                    None => captured.read(),
                };
                read.map_err(StageError::work_failed("read the source"))?
            }
            Self::None => (Vec::new().into(), Vec::new()),
        };
        cx.warnings.extend(warnings.iter().map(ToString::to_string));
        cx.write_record("capture.json", &capture)
    }
}

/// The frames of a video, named like photos.
fn frames_of(solved: &SolvedInputs) -> impl Iterator<Item = SourceFile> {
    let frames = solved.iter().flat_map(|(_, frames)| frames).flat_map(|frames| &frames.files);
    frames.map(|(name, path)| SourceFile { name: format!("images/{name}"), path: path.clone() })
}

/// Returns true if the capture contains everything that a file of a source says.
fn holds_poses(file: &Path) -> bool {
    let is = |name: &str| file.file_name().is_some_and(|found| found == name);
    let is_json = file.extension().is_some_and(|extension| extension == "json");
    is_json || ["cameras.bin", "cameras.txt", "images.bin", "images.txt"].into_iter().any(is)
}
