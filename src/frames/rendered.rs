//! Frames rendered along a trajectory.

use super::{Frame, FrameError, Frames};
use crate::camera::Camera;
use crate::image::Size;
use crate::render::{Channels, Rendered, Renderer, View, Work};
use crate::trajectory::Trajectory;
use crate::units::Timestamp;

/// The grey scale of [`Frame::luminance`] over that of [`Rendered::luminance`].
const GREY_SCALE: f32 = 255.0;

/// The luminance that a camera sees at each pose of a trajectory; frame `j` is rendered at pose `j` when it is
/// asked for.
pub struct RenderedFrames {
    renderer: Box<dyn Renderer>,
    camera: Camera,
    trajectory: Trajectory,
    done: usize,
    rendered: Rendered,
    work: Work,
}

impl std::fmt::Debug for RenderedFrames {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderedFrames")
            .field("renderer", &self.renderer.fingerprint())
            .field("camera", &self.camera)
            .field("poses", &self.len())
            .field("done", &self.done)
            .field("work", &self.work)
            .finish_non_exhaustive()
    }
}

impl RenderedFrames {
    /// The frames of a trajectory.
    ///
    /// # Panics
    /// If the trajectory does not have one stamp a pose.
    #[must_use]
    pub fn new(renderer: Box<dyn Renderer>, camera: Camera, trajectory: Trajectory) -> Self {
        let (poses, stamps) = (trajectory.world_from_camera.len(), trajectory.stamps_us.len());
        assert_eq!(poses, stamps, "a trajectory has one stamp a pose");
        Self { renderer, camera, trajectory, done: 0, rendered: Rendered::default(), work: Work::default() }
    }

    /// What rendering the frames so far took, summed.
    #[must_use]
    pub fn work(&self) -> Work {
        self.work
    }
}

impl Frames for RenderedFrames {
    fn size(&self) -> Size {
        self.camera.size
    }

    fn len(&self) -> usize {
        self.trajectory.stamps_us.len()
    }

    fn next(&mut self) -> Result<Option<Frame>, FrameError> {
        let index = self.done;
        let Some(&world_from_camera) = self.trajectory.world_from_camera.get(index) else { return Ok(None) };
        let view = View { camera: self.camera, world_from_camera };
        let want = Channels { luminance: true, ..Channels::default() };
        self.work += self
            .renderer
            .render(&view, want, &mut self.rendered)
            .map_err(|source| FrameError::Render { index, source })?;
        let mut luminance = self.rendered.luminance.take().expect("a renderer renders what it is asked for");
        luminance.pixels_mut().iter_mut().for_each(|v| *v *= GREY_SCALE);
        if let Some(i) = luminance.pixels().iter().position(|v| !v.is_finite()) {
            let because = format!("luminance of pixel {i} is {}, wanted a finite one", luminance.pixels()[i]);
            return Err(FrameError::Invalid { index, because });
        }
        self.done += 1;
        let t = Timestamp::from_micros(self.trajectory.stamps_us[index]);
        Ok(Some(Frame { index, t, luminance }))
    }
}
