//! Stage `sharp`: sharp frames of a release, one PNG per pose.

use super::shot::ShotParameters;
use super::{Stage, StageContext, StageError, StepNeed, StepTarget};
use crate::artifact::{ArtifactFiles, PictureSet, TrajectoryProduct};
use crate::image::png;
use crate::render::{ChannelSet, RenderedImages};
use crate::sampling::exposure;
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;

/// Parameters: camera, rendering, and the poses with a frame.
#[derive(Debug, Serialize)]
pub struct SharpStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// Spacing of frames, in poses.
    pub every: u32,
    /// Dense frames per exposure, if frames in the middle of exposures are kept too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposed: Option<u32>,
}

/// Memory per pixel of a batch in 32-bit colour with its encoders, bytes, as measured.
const BYTES_A_PIXEL: u64 = 104;

impl Stage for SharpStage {
    const NAME: &'static str = "sharp";
    const REVISION: u32 = 2;
    type Inputs = (StepTarget<Capture>, StepTarget<Gaussians>, StepTarget<TrajectoryProduct>);
    type Output = PictureSet;

    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        self.shot.need(files, BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, TrajectoryProduct),
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        let mut ready = self.shot.ready(&capture, gaussians, &motion, cx)?;
        let kept = exposure::kept_poses(motion.trajectory.world_from_camera.len(), self.every, self.exposed);
        let want = ChannelSet { rgb: true, ..ChannelSet::default() };
        let views = ready.views(&motion, &kept, None);
        let write = |rendered: &RenderedImages, file| {
            png::write_image(&png::to_bytes(rendered.rgb.as_ref().expect("colour was asked for")), file)
        };
        ready.take(&views, want, ("png", write), cx)
    }
}
