//! Stage `frames`: takes sharp frames from a video with ffmpeg. Its class is the version of ffmpeg.

use super::{SourceFile, Stage, StageContext, StageError, StageFacts, StepNeed, known_program};
use crate::artifact::{ArtifactFiles, PictureSet};
use gs2e_files::is_there;
use gs2e_source::DiskCapture;
use gs2e_source::foreign::versions::VersionQuery;
use gs2e_source::foreign::video::{TakenFrames, take_frames};
use gs2e_source::photos::MIN_PHOTOS;
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_source::solving::FramePicking;
use serde::Serialize;

/// Parameters: the choice of frames.
#[derive(Debug, Serialize)]
pub(crate) struct FramesStage {
    /// The choice of frames.
    #[serde(flatten)]
    pub picking: FramePicking,
    /// The video.
    #[serde(skip)]
    pub capturing: DiskCapture,
    /// The version of ffmpeg, if it is known.
    #[serde(skip)]
    pub version: Option<String>,
}

/// Memory of ffmpeg with the reference frames of a 4K video, bytes.
const BYTES: u64 = 1 << 30;

impl StageFacts for FramesStage {
    fn class(&self) -> Option<String> {
        self.version.clone()
    }

    fn unasked(&self) -> Option<&'static str> {
        self.version.is_none().then(|| VersionQuery::Ffmpeg.name())
    }

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        if !is_there(&self.capturing.path) {
            return Err(StageError::Missing { path: self.capturing.path.clone() });
        }
        let listed = self.capturing.files().map_err(StageError::work_failed("read the source"))?;
        Ok(listed.into_iter().map(|(name, path)| SourceFile { name, path }).collect())
    }

    fn need(&self, _: &[ArtifactFiles]) -> StepNeed {
        StepNeed::for_memory([BYTES])
    }

    fn runs_known_programs(&self) -> bool {
        true
    }
}

impl Stage for FramesStage {
    const NAME: &'static str = "frames";
    const REVISION: u32 = 1;
    type Inputs = ();
    type Output = PictureSet;

    fn run(&self, _: (), cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let video = &self.capturing.path;
        let take =
            |workspace: ProgramWorkspace<'_>| take_frames(video, self.picking, cx.out, MIN_PHOTOS, workspace);
        let TakenFrames { kept, dropped } = known_program("ffmpeg", cx, take)?;
        cx.remark = Some(format!("{kept} frames"));
        if dropped > 0 {
            cx.warnings.push(format!("{dropped} of {} frames were dropped as blurred", kept + dropped));
        }
        Ok(())
    }
}
