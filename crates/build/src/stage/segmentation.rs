//! Stage `segmentation`: the object that each pixel shows, one PNG per pose, and the places of the objects.

use super::pass::{PassGround, PoseProduct, PoseStage, PoseTaker};
use super::shot::{FileTaker, PoseFileForm, ShotParameters};
use super::{ExpectedSize, PathLength, StageContext, StageError};
use crate::artifact::{OBJECT_PLACES, PictureSet};
use gs2e_image::{Image, png};
use gs2e_recipe::OutputKind;
use gs2e_render::{ChannelSet, RenderedImages, Renderer};
use gs2e_sampling::exposure;
use gs2e_sampling::rendered::RenderedPose;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::motion::write_places;
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;

/// Parameters: camera, rendering, and the spacing of segmentations.
#[derive(Debug, Serialize)]
pub struct SegmentationStage {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// Spacing of segmentations, in poses.
    pub every: u32,
}

/// Memory per pixel of a batch of segmentations, of the weights of the objects, and of the encoders, bytes.
const BYTES_A_PIXEL: u64 = 48;

/// Bytes per pixel of a segmentation, which is one colour in most places; an estimate.
const BYTES_A_SEGMENTED_PIXEL: f64 = 0.02;

impl PoseProduct for SegmentationStage {
    const NAME: &'static str = OutputKind::Segmentation.name();
    const REVISION: u32 = 1;
    type Output = PictureSet;

    fn size_along(&self, path: PathLength) -> ExpectedSize {
        ExpectedSize::of_pictures(path.pictures(self.every), self.shot.camera, BYTES_A_SEGMENTED_PIXEL)
    }
}

impl PoseStage for SegmentationStage {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        BYTES_A_PIXEL
    }

    fn taker(&self, ground: &PassGround, _: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let kept = exposure::kept_poses(ground.poses(), self.every, None);
        let want = ChannelSet { segmentation: true, ..ChannelSet::NONE };
        let form = PoseFileForm {
            extension: "png",
            keep: Box::new(|images: &RenderedImages, _| {
                images.segmentation.clone().expect("the segmentation was asked for")
            }),
            write: |segmentation, file| png::write_image(segmentation, file),
            is_encoded: true,
        };
        let stamps_us = ground.motion.trajectory.stamps_us.clone();
        let segmentations = FileTaker::new(kept, want, form);
        Ok(Box::new(SegmentationTaker { segmentations, scene: ground.gaussians.clone(), stamps_us }))
    }
}

/// The segmentations of a trajectory, and the places of its objects.
struct SegmentationTaker {
    segmentations: FileTaker<Image<u8>>,
    scene: Arc<Gaussians>,
    stamps_us: Vec<i64>,
}

impl PoseTaker for SegmentationTaker {
    fn want(&mut self, pose: usize, renderer: &mut dyn Renderer) -> ChannelSet {
        self.segmentations.want(pose, renderer)
    }

    fn take(&mut self, pose: RenderedPose<'_>, cx: &StageContext<'_>) -> Result<(), StageError> {
        self.segmentations.take(pose, cx)
    }

    fn finish(self: Box<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let out = cx.out.join(OBJECT_PLACES);
        let written = File::create(&out).and_then(|file| {
            write_places(self.scene.motion.as_deref(), &self.stamps_us, BufWriter::new(file))
        });
        written.map_err(StageError::io_error(&out))?;
        Box::new(self.segmentations).finish(cx)
    }
}
