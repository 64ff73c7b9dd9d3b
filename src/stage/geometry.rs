//! Stages `depth` and `flow`: geometry of the scene as seen by the camera, one `.npy` per pose.

use super::shot::ShotParameters;
use super::{Stage, StageContext, StageError, StepNeed, StepTarget};
use crate::artifact::{ArtifactFiles, PictureSet, TrajectoryProduct};
use crate::image::npy;
use crate::render::{CameraVelocity, ChannelSet, RenderedImages};
use crate::sampling::exposure;
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;
use std::fmt::Debug;
use std::io::{self, Write};
use std::marker::PhantomData;

/// Parameters: camera, rendering, and the spacing of images.
#[derive(Debug, Serialize)]
pub struct GeometryStage<Q> {
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
    pub fn new(shot: ShotParameters, every: u32) -> Self {
        Self { shot, every, quantity: PhantomData }
    }
}

/// A quantity of each pixel.
pub trait PixelQuantity: Debug + Send + Sync {
    /// The stage's name.
    const NAME: &'static str;
    /// The stage's revision.
    const REVISION: u32;
    /// Memory per pixel of a batch of images and their renderer, bytes, as measured.
    const BYTES_A_PIXEL: u64;
    /// The rendered channels.
    const CHANNELS: ChannelSet;

    /// The velocity of the camera at each pose, if the quantity depends on it.
    fn velocities(motion: &TrajectoryProduct) -> Option<Vec<CameraVelocity>>;

    /// Writes one image.
    ///
    /// # Errors
    /// Writing to `out` fails.
    fn write(rendered: &RenderedImages, out: impl Write) -> io::Result<()>;
}

/// Float32 `[H, W]`, scene units along the optical axis; NaN where opacity is below 0.5.
#[derive(Debug)]
pub struct DepthQuantity;

/// Float32 `[H, W, 2]`, px/s at the time of the pose, of the static point at each pixel's depth;
/// NaN where the depth is NaN.
#[derive(Debug)]
pub struct FlowQuantity;

impl PixelQuantity for DepthQuantity {
    const NAME: &'static str = "depth";
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 24;
    const CHANNELS: ChannelSet = ChannelSet { depth: true, ..ChannelSet::NONE };

    fn velocities(_: &TrajectoryProduct) -> Option<Vec<CameraVelocity>> {
        None
    }

    fn write(rendered: &RenderedImages, out: impl Write) -> io::Result<()> {
        npy::write_image(rendered.depth.as_ref().expect("depth was asked for"), out)
    }
}

impl PixelQuantity for FlowQuantity {
    const NAME: &'static str = "flow";
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 72;
    const CHANNELS: ChannelSet = ChannelSet { flow: true, ..ChannelSet::NONE };

    fn velocities(motion: &TrajectoryProduct) -> Option<Vec<CameraVelocity>> {
        Some(motion.velocities())
    }

    fn write(rendered: &RenderedImages, out: impl Write) -> io::Result<()> {
        npy::write_image(rendered.flow.as_ref().expect("flow was asked for"), out)
    }
}

impl<Q: PixelQuantity> Stage for GeometryStage<Q> {
    const NAME: &'static str = Q::NAME;
    const REVISION: u32 = Q::REVISION;
    type Inputs = (StepTarget<Capture>, StepTarget<Gaussians>, StepTarget<TrajectoryProduct>);
    type Output = PictureSet;

    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        self.shot.need(files, Q::BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, TrajectoryProduct),
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        let mut ready = self.shot.ready(&capture, gaussians, &motion, cx)?;
        let kept = exposure::kept_poses(motion.trajectory.world_from_camera.len(), self.every, None);
        let views = ready.views(&motion, &kept, Q::velocities(&motion).as_deref());
        ready.take(&views, Q::CHANNELS, ("npy", |rendered, file| Q::write(rendered, file)), cx)
    }
}
