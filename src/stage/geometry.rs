//! Stages `depth` and `flow`: geometry of the scene as seen by the camera, one `.npy` per pose.

use super::shot::Shot;
use super::{Context, Need, Stage, StageError, Target};
use crate::artifact::{Files, Motion, Pictures};
use crate::image::npy;
use crate::render::{Channels, Rendered, Velocity};
use crate::sampling::exposure;
use crate::scene::Gaussians;
use crate::source::Capture;
use serde::Serialize;
use std::fmt::Debug;
use std::io::{self, Write};
use std::marker::PhantomData;

/// Parameters: camera, rendering, and the spacing of images.
#[derive(Debug, Serialize)]
pub struct Measuring<Q> {
    /// Camera and rendering.
    #[serde(flatten)]
    pub shot: Shot,
    /// Spacing of images, in poses.
    pub every: u32,
    #[serde(skip)]
    quantity: PhantomData<Q>,
}

impl<Q> Measuring<Q> {
    /// Images at this spacing.
    #[must_use]
    pub fn new(shot: Shot, every: u32) -> Self {
        Self { shot, every, quantity: PhantomData }
    }
}

/// A quantity of each pixel.
pub trait Quantity: Debug + Send + Sync {
    /// The stage's name.
    const NAME: &'static str;
    /// The stage's revision.
    const REVISION: u32;
    /// Memory per pixel of a batch of images and their renderer, bytes, as measured.
    const BYTES_A_PIXEL: u64;
    /// The rendered channels.
    const CHANNELS: Channels;

    /// The velocity of the camera at each pose, if the quantity depends on it.
    fn velocities(motion: &Motion) -> Option<Vec<Velocity>>;

    /// Writes one image.
    ///
    /// # Errors
    /// Writing to `out` fails.
    fn write(rendered: &Rendered, out: impl Write) -> io::Result<()>;
}

/// Float32 `[H, W]`, scene units along the optical axis; NaN where opacity is below 0.5.
#[derive(Debug)]
pub struct Depth;

/// Float32 `[H, W, 2]`, px/s at the time of the pose, of the static point at each pixel's depth; NaN where depth is.
#[derive(Debug)]
pub struct Flow;

impl Quantity for Depth {
    const NAME: &'static str = "depth";
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 24;
    const CHANNELS: Channels = Channels { depth: true, ..Channels::NONE };

    fn velocities(_: &Motion) -> Option<Vec<Velocity>> {
        None
    }

    fn write(rendered: &Rendered, out: impl Write) -> io::Result<()> {
        npy::write_image(rendered.depth.as_ref().expect("depth was asked for"), out)
    }
}

impl Quantity for Flow {
    const NAME: &'static str = "flow";
    const REVISION: u32 = 1;
    const BYTES_A_PIXEL: u64 = 72;
    const CHANNELS: Channels = Channels { flow: true, ..Channels::NONE };

    fn velocities(motion: &Motion) -> Option<Vec<Velocity>> {
        Some(motion.velocities())
    }

    fn write(rendered: &Rendered, out: impl Write) -> io::Result<()> {
        npy::write_image(rendered.flow.as_ref().expect("flow was asked for"), out)
    }
}

impl<Q: Quantity> Stage for Measuring<Q> {
    const NAME: &'static str = Q::NAME;
    const REVISION: u32 = Q::REVISION;
    type Inputs = (Target<Capture>, Target<Gaussians>, Target<Motion>);
    type Output = Pictures;

    fn class(&self) -> Option<String> {
        Some(self.shot.backend.class())
    }

    fn need(&self, files: &[Files]) -> Need {
        self.shot.need(files, Q::BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, Motion),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let mut ready = self.shot.ready(&capture, gaussians, &motion, cx)?;
        let kept = exposure::kept_poses(motion.trajectory.world_from_camera.len(), self.every, None);
        let views = ready.views(&motion, &kept, Q::velocities(&motion).as_deref());
        ready.take(&views, Q::CHANNELS, ("npy", |rendered, file| Q::write(rendered, file)), cx)
    }
}
