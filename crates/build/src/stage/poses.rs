//! Stage `poses`: finds the poses of photos or of the frames of a video with COLMAP. Its class is the
//! version of COLMAP. Later steps depend on the bytes of the model only.

use super::capture::CaptureStage;
use super::{SourceFile, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget, known_program};
use crate::artifact::{ArtifactFiles, PictureSet, SolvedModel};
use gs2e_source::DiskCapture;
use gs2e_source::foreign::photos::{SolvedPhotos, solve_photos};
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_source::photos::base_name;
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_source::solving::PoseSolving;
use serde::Serialize;
use std::path::PathBuf;

/// Parameters: the settings of the search.
#[derive(Debug, Serialize)]
pub(crate) struct PosesStage {
    /// The settings.
    #[serde(flatten)]
    pub solving: PoseSolving,
    /// The photos, unless they are an input.
    #[serde(skip)]
    pub capturing: DiskCapture,
    /// The version of COLMAP, if it is known.
    #[serde(skip)]
    pub version: Option<String>,
}

/// Memory of COLMAP with one large photo, bytes: SIFT doubles a photo of 3,200 px.
const BYTES: u64 = 2 << 30;
/// Bytes per photo and key point: a descriptor in 16 bits, and what is matched.
const BYTES_A_KEY_POINT: u64 = 320;

impl PosesStage {
    /// The photos on disk, without excluded ones; none if the source is a video.
    fn photos(&self) -> Result<Vec<SourceFile>, StageError> {
        let is_given = self.capturing.is_given();
        let mut files = CaptureStage::Captured(self.capturing.clone()).sources()?;
        files.retain(|file| is_given(base_name(&file.name)));
        Ok(files)
    }
}

impl StageFacts for PosesStage {
    fn class(&self) -> Option<String> {
        self.version.clone()
    }

    fn unasked(&self) -> Option<&'static str> {
        self.version.is_none().then(|| VersionQuery::Colmap.name())
    }

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        let mut files = self.photos()?;
        let tree = self.solving.vocabulary.iter();
        files.extend(tree.map(|path| SourceFile { name: "vocabulary tree".to_owned(), path: path.clone() }));
        Ok(files)
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        self.capturing.folders()
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        let frames = files.first().map_or(0, |frames| frames.iter().count());
        // A source that cannot be listed is reported by the run. A need has no errors.
        let photos = self.photos().map_or(0, |photos| photos.len()) + frames;
        let key_points = photos as u64 * u64::from(self.solving.features);
        StepNeed::for_memory([BYTES, key_points * BYTES_A_KEY_POINT])
    }

    fn runs_known_programs(&self) -> bool {
        true
    }
}

impl Stage for PosesStage {
    const NAME: &'static str = "poses";
    const REVISION: u32 = 1;
    /// The frames, if the source is a video.
    type Inputs = Option<StepTarget<PictureSet>>;
    type Output = SolvedModel;

    fn run(&self, frames: Option<PictureSet>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let on_disk = self.photos()?.into_iter().map(|file| (base_name(&file.name).to_owned(), file.path));
        let photos: Vec<(String, PathBuf)> = match frames {
            Some(frames) => frames.files,
            None => on_disk.collect(),
        };
        let progress = cx.progress;
        let report_progress = |words: &str| progress.iter().for_each(|progress| progress.report(words));
        let solve = |workspace: ProgramWorkspace<'_>| {
            solve_photos(&photos, &self.solving, cx.out, workspace, &report_progress)
        };
        let solved = known_program("colmap", cx, solve)?;
        report(&solved, cx);
        Ok(())
    }
}

/// Adds what a user should know about a model.
fn report(solved: &SolvedPhotos, cx: &mut StageContext<'_>) {
    let SolvedPhotos { given, models, reprojection_px, cameras } = solved;
    let registered = models.first().copied().unwrap_or_default();
    let error = reprojection_px.map_or_else(String::new, |px| format!(", {px:.2} px"));
    cx.remark = Some(format!("{registered} of {given} photos{error}"));
    if models.len() > 1 {
        let sizes: Vec<String> = models[1..].iter().map(usize::to_string).collect();
        cx.warnings.push(format!(
            "COLMAP made {} models: the one with {registered} of {given} photos is used; the others have {}",
            models.len(),
            sizes.join(", ")
        ));
    }
    if registered < *given {
        let left = given - registered;
        cx.warnings.push(format!(
            "{left} of {given} photos have no pose, because COLMAP could not place them; scene.json lists them"
        ));
    }
    if *cameras > 1 {
        cx.warnings.push(format!("the photos are of {cameras} cameras, by size, camera and focal length"));
    }
}
