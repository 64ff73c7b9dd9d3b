//! Stage `sharp`: sharp frames of a release, one PNG per pose.

use super::pass::{self, PassGround, PassRole, PoseStage, PoseTaker};
use super::shot::{FileTaker, PoseFileForm, ShotParameters};
use super::{Stage, StageContext, StageError, StepNeed, StepTarget};
use crate::artifact::{ArtifactFiles, PictureSet, TrajectoryProduct};
use crate::camera::Camera;
use crate::image::png;
use crate::lights::SceneLights;
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
    /// Light that changes, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<SceneLights>,
    /// Dense frames per exposure, if frames in the middle of exposures are kept too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposed: Option<u32>,
}

/// Memory per pixel of a picture in 32-bit colour, a batch in bytes, and its encoders, bytes, as measured.
const BYTES_A_PIXEL: u64 = 44;

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

    fn role(&self) -> Option<PassRole<'_>> {
        Some(PassRole::Poses(self))
    }

    fn run(
        &self,
        inputs: (Capture, Gaussians, TrajectoryProduct),
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        pass::run_alone(self, inputs, cx)
    }
}

impl PoseStage for SharpStage {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        BYTES_A_PIXEL
    }

    fn taker(&self, ground: &PassGround, _: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let kept = exposure::kept_poses(ground.poses(), self.every, self.exposed);
        let want = ChannelSet { rgb: true, ..ChannelSet::NONE };
        let lit = self.lights.clone().map(|lights| (lights, ground.motion.trajectory.stamps_us.clone()));
        let keep = move |images: &RenderedImages, pose: usize| {
            let picture = images.rgb.as_ref().expect("colour was asked for");
            match &lit {
                Some((lights, stamps_us)) => png::to_bytes(&lights.at_us(stamps_us[pose]).lit(picture)),
                None => png::to_bytes(picture),
            }
        };
        let form = PoseFileForm {
            extension: "png",
            // As bytes, because several pictures wait at once.
            keep: Box::new(keep),
            write: |picture, file| png::write_image(picture, file),
            is_encoded: true,
        };
        Ok(Box::new(FileTaker::new(kept, want, form)))
    }
}
