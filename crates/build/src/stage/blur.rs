//! Stage `blur`: blurred frames, one PNG per exposure.

use super::pass::{PassGround, PoseProduct, PoseStage, PoseTaker};
use super::shot::{ShotParameters, record_work};
use super::size::PNG_BYTES;
use super::{ExpectedSize, PathLength, StageContext, StageError};
use crate::artifact::BlurredFrames;
use gs2e_image::png;
use gs2e_recipe::OutputKind;
use gs2e_render::lights::SceneLights;
use gs2e_render::{ChannelSet, Renderer};
use gs2e_sampling::exposure;
use gs2e_sampling::exposure::{
    DenseView, ExposedFrame, ExposureCourse, ExposureRecord, FrameExposer, ShutterSettings,
};
use gs2e_sampling::rendered::RenderedPose;
use gs2e_scene::camera::Camera;
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;

/// Parameters: camera, rendering and shutter.
#[derive(Debug, Serialize)]
pub struct BlurStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// The shutter.
    #[serde(flatten)]
    pub shutter: ShutterSettings,
    /// Light that changes, if it does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lights: Option<SceneLights>,
}

/// Bytes per pixel: sums of three colours in 64 bits, a picture in 32 bits, its flow, and the
/// encoder.
const BYTES_A_PIXEL: u64 = 72;

impl PoseProduct for BlurStage {
    const NAME: &'static str = OutputKind::Blur.name();
    const REVISION: u32 = 1;
    type Output = BlurredFrames;

    fn size_along(&self, path: PathLength) -> ExpectedSize {
        ExpectedSize::of_pictures(path.exposures(self.shutter.frames), self.shot.camera, PNG_BYTES)
    }
}

impl PoseStage for BlurStage {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        BYTES_A_PIXEL
    }

    fn taker(&self, ground: &PassGround, camera: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let (poses, seconds) = (ground.motion.trajectory.world_from_camera.clone(), ground.motion.seconds());
        if exposure::exposure_centres(poses.len(), self.shutter.frames).is_empty() {
            return Err(exposure::TooShort { poses: poses.len(), frames: self.shutter.frames })
                .map_err(StageError::work_failed("expose"));
        }
        let exposer = FrameExposer::new(ExposureCourse { camera, poses, seconds }, self.shutter);
        let exposer = exposer.map(|exposer| exposer.lit_by(self.lights.clone()));
        let exposer = exposer.map_err(StageError::work_failed("join the poses by a path"))?;
        Ok(Box::new(BlurTaker { exposer, exposures: Vec::new() }))
    }
}

/// The exposures of a trajectory.
struct BlurTaker {
    exposer: FrameExposer,
    exposures: Vec<ExposureRecord>,
}

impl PoseTaker for BlurTaker {
    fn want(&mut self, pose: usize, renderer: &mut dyn Renderer) -> ChannelSet {
        self.exposer.want(pose, renderer)
    }

    fn take(&mut self, pose: RenderedPose<'_>, cx: &StageContext<'_>) -> Result<(), StageError> {
        let RenderedPose { index, images, work, renderer, .. } = pose;
        let exposed =
            self.exposer.see(DenseView { pose: index, images, work, renderer }, &|| !cx.is_cancelled());
        let Some(ExposedFrame { exposure, picture }) = exposed? else {
            return Ok(());
        };
        let out = cx.out.join(format!("{:06}.png", exposure.pose));
        let written = File::create(&out)
            .and_then(|file| png::write_image(&png::to_bytes(&picture), BufWriter::new(file)));
        written.map_err(StageError::io_error(&out))?;
        self.exposures.push(exposure);
        Ok(())
    }

    fn finish(self: Box<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        cx.warnings.extend(exposure::ghost_warning(&self.exposures));
        cx.write_record(BlurredFrames::EXPOSURES, &self.exposures)?;
        record_work(&self.exposer.work, cx)
    }
}
