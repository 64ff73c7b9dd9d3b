//! Stages `depth` and `flow`: geometry of the scene as seen by the camera, one `.npy` per pose.

use super::pass::{PassGround, PoseProduct, PoseStage, PoseTaker};
use super::shot::{FileTaker, PoseFileForm, ShotParameters};
use super::{ExpectedSize, PathLength, StageError};
use crate::artifact::PictureSet;
use gs2e_image::npy::NpyPixel;
use gs2e_image::{Image, npy};
use gs2e_recipe::OutputKind;
use gs2e_render::{ChannelSet, RenderedImages};
use gs2e_sampling::exposure;
use gs2e_scene::camera::Camera;
use serde::Serialize;
use std::fmt::Debug;
use std::marker::PhantomData;

/// Parameters: camera, rendering, and the spacing of images.
#[derive(Debug, Serialize)]
pub(crate) struct GeometryStage<Q> {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: ShotParameters,
    /// Spacing of images, in poses.
    pub every: u32,
    #[serde(skip)]
    quantity: PhantomData<Q>,
}

impl<Q> GeometryStage<Q> {
    /// Images at this spacing.
    #[must_use]
    pub(crate) fn new(shot: ShotParameters, every: u32) -> Self {
        Self { shot, every, quantity: PhantomData }
    }
}

/// A quantity of each pixel.
pub trait PixelQuantity: Debug + Send + Sync {
    /// The stage's name.
    const NAME: &'static str;
    /// The stage's revision.
    const REVISION: u32;
    /// Memory per pixel of an image and its copy, bytes, as measured.
    const BYTES_A_PIXEL: u64;
    /// Bytes per pixel of a file.
    const FILE_BYTES: f64;
    /// The rendered channels.
    const CHANNELS: ChannelSet;

    /// The value of a pixel.
    type Pixel: NpyPixel + Send + Sync + 'static;

    /// The image of the quantity.
    fn keep(rendered: &RenderedImages) -> Image<Self::Pixel>;
}

/// Float32 `[H, W]`, scene units along the optical axis; NaN where opacity is below 0.5.
#[derive(Debug)]
pub struct DepthQuantity;

/// Float32 `[H, W, 2]`, px/s at the time of the pose, of the point at each pixel's depth, which rests in
/// the scene or in its object; NaN where the depth is NaN.
#[derive(Debug)]
pub struct FlowQuantity;

impl PixelQuantity for DepthQuantity {
    const NAME: &'static str = OutputKind::Depth.name();
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 8;
    const FILE_BYTES: f64 = 4.0;
    const CHANNELS: ChannelSet = ChannelSet { depth: true, ..ChannelSet::NONE };

    type Pixel = f32;

    fn keep(rendered: &RenderedImages) -> Image<f32> {
        rendered.depth.clone().expect("depth was asked for")
    }
}

impl PixelQuantity for FlowQuantity {
    const NAME: &'static str = OutputKind::Flow.name();
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 20;
    const FILE_BYTES: f64 = 8.0;
    const CHANNELS: ChannelSet = ChannelSet { flow: true, ..ChannelSet::NONE };

    type Pixel = [f32; 2];

    fn keep(rendered: &RenderedImages) -> Image<[f32; 2]> {
        rendered.flow.clone().expect("flow was asked for")
    }
}

impl<Q: PixelQuantity> PoseProduct for GeometryStage<Q> {
    const NAME: &'static str = Q::NAME;
    const REVISION: u32 = Q::REVISION;
    type Output = PictureSet;

    fn size_along(&self, path: PathLength) -> ExpectedSize {
        ExpectedSize::of_pictures(path.pictures(self.every), self.shot.camera, Q::FILE_BYTES)
    }
}

impl<Q: PixelQuantity> PoseStage for GeometryStage<Q> {
    fn shot(&self) -> &ShotParameters {
        &self.shot
    }

    fn bytes_a_pixel(&self) -> u64 {
        Q::BYTES_A_PIXEL
    }

    fn taker(&self, ground: &PassGround, _: Camera) -> Result<Box<dyn PoseTaker>, StageError> {
        let kept = exposure::kept_poses(ground.poses(), self.every, None);
        let form = PoseFileForm {
            extension: "npy",
            keep: Box::new(|images, _| Q::keep(images)),
            write: |image, file| npy::write_image(image, file),
            is_encoded: false,
        };
        Ok(Box::new(FileTaker::new(kept, Q::CHANNELS, form)))
    }
}
