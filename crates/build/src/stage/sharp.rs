//! Stage `sharp`: sharp frames of a release, one PNG per pose.

use super::pass::{PassGround, PoseProduct, PoseStage, PoseTaker};
use super::shot::{FileTaker, PoseFileForm, ShotParameters};
use super::size::PNG_BYTES;
use super::{ExpectedSize, PathLength, StageContext, StageError};
use crate::artifact::PictureSet;
use gs2e_image::{Image, png};
use gs2e_recipe::OutputKind;
use gs2e_render::lights::SceneLights;
use gs2e_render::{ChannelSet, RenderedImages, Renderer};
use gs2e_sampling::exposure;
use gs2e_sampling::exposure::{DenseView, ExposureCourse};
use gs2e_sampling::rendered::RenderedPose;
use gs2e_sampling::rolling::RowRoller;
use gs2e_scene::camera::Camera;
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
    /// Time from the first row of a frame to the last, us, if the shutter rolls.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub readout_us: Option<u32>,
    /// Dense frames per exposure, if frames in the middle of exposures are kept too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposed: Option<u32>,
}

/// Memory per pixel of a picture in 32-bit colour, a batch in bytes, and its encoders, bytes, as measured.
const BYTES_A_PIXEL: u64 = 44;

/// Bytes per pixel of a rolling shutter: the frame, a band's rendering, depth and flow.
const BYTES_OF_ROWS: u64 = 36;

impl PoseProduct for SharpStage {
    const NAME: &'static str = OutputKind::Sharp.name();
    const REVISION: u32 = 2;
    type Output = PictureSet;

    fn size_along(&self, path: PathLength) -> ExpectedSize {
        let exposed = self.exposed.map_or(0.0, |frames| path.exposures(frames));
        let pictures = path.pictures(self.every) + exposed;
        ExpectedSize::of_pictures(pictures, self.shot.camera, PNG_BYTES)
    }

    fn is_shareable(&self) -> bool {
        // The bands of a rolling shutter are views of its own, on which the counts of other steps must not
        // depend.
        self.readout_us.is_none()
    }
}

impl PoseStage for SharpStage {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        BYTES_A_PIXEL + if self.readout_us.is_some() { BYTES_OF_ROWS } else { 0 }
    }

    fn taker(&self, ground: &PassGround, camera: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let kept = exposure::kept_poses(ground.poses(), self.every, self.exposed);
        let rolls = self.readout_us.is_some() && ground.poses() > 1;
        let want = if rolls { RowRoller::WANT } else { ChannelSet { rgb: true, ..ChannelSet::NONE } };
        // The rows of a rolling shutter are lit one by one.
        let lit = self.lights.clone().filter(|_| !rolls);
        let lit = lit.map(|lights| (lights, ground.motion.trajectory.stamps_us.clone()));
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
        let files = FileTaker::new(kept, want, form);
        let Some(readout_us) = self.readout_us.filter(|_| rolls) else { return Ok(Box::new(files)) };
        let (poses, seconds) = (ground.motion.trajectory.world_from_camera.clone(), ground.motion.seconds());
        let roller = RowRoller::new(ExposureCourse { camera, poses, seconds }, readout_us)
            .map_err(StageError::work_failed("join the poses by a path"))?;
        Ok(Box::new(RollTaker { files, roller: roller.lit_by(self.lights.clone()) }))
    }
}

/// Frames of a rolling shutter.
struct RollTaker {
    files: FileTaker<Image<[u8; 3]>>,
    roller: RowRoller,
}

impl PoseTaker for RollTaker {
    fn want(&mut self, pose: usize, renderer: &mut dyn Renderer) -> ChannelSet {
        let want = self.files.want(pose, renderer);
        // What moves by itself moves rows too.
        if want.depth { want.with(renderer.motion_channels()) } else { want }
    }

    fn take(&mut self, pose: RenderedPose<'_>, cx: &StageContext<'_>) -> Result<(), StageError> {
        if !self.files.has(pose.index) {
            return Ok(());
        }
        let RenderedPose { index, images, work, seconds, has_frame, renderer } = pose;
        let view = DenseView { pose: index, images, work, renderer: &mut *renderer };
        let rolled = self.roller.roll(view, &|| !cx.is_cancelled())?;
        let images = &RenderedImages { rgb: Some(rolled), ..RenderedImages::default() };
        self.files.take(RenderedPose { index, images, work, seconds, has_frame, renderer }, cx)
    }

    fn finish(mut self: Box<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let RowRoller { work, most_bands, resting_rows, .. } = self.roller;
        self.files.work += work;
        cx.remark = Some(format!("rows in at most {most_bands} bands a frame"));
        if resting_rows > 0 {
            cx.warnings.push(format!(
                "{resting_rows} rows of the rolling shutter are before the first pose or after the last: they show \
                 the scene from that pose"
            ));
        }
        Box::new(self.files).finish(cx)
    }
}
