//! Frames at any moment of a path, for the pilot only.

use super::measure::{PathViewer, SampledShot};
use crate::rendered::RenderedFrames;
use gs2e_render::Renderer;
use gs2e_render::lights::SceneLights;
use gs2e_scene::camera::Camera;
use gs2e_sensor::frames::{DenseFrame, FrameError, FrameSequence as _};
use gs2e_sensor::front_end::FrontEnd;
use gs2e_trajectory::sampled::SampledPath;

/// The renderer and its state.
pub struct ScoutRenderer<'a> {
    /// `None` during a rendering.
    renderer: Option<Box<dyn Renderer>>,
    camera: Camera,
    path: &'a SampledPath,
    front_ends: &'a [FrontEnd],
    lights: Option<&'a SceneLights>,
    go_on: &'a dyn Fn() -> bool,
}

impl std::fmt::Debug for ScoutRenderer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ScoutRenderer").field("camera", &self.camera).finish_non_exhaustive()
    }
}

/// The reason why there is no frame.
#[derive(Debug, thiserror::Error)]
pub enum ScoutError {
    /// The frame cannot be rendered.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The caller stopped.
    #[error("interrupted")]
    Interrupted,
}

impl<'a> ScoutRenderer<'a> {
    /// Renders the views of `camera` along a path through these front ends, while `go_on` returns
    /// true.
    pub fn new(
        renderer: Box<dyn Renderer>,
        camera: Camera,
        path: &'a SampledPath,
        front_ends: &'a [FrontEnd],
        go_on: &'a dyn Fn() -> bool,
    ) -> Self {
        Self { renderer: Some(renderer), camera, path, front_ends, lights: None, go_on }
    }

    /// Sets the light of the scene.
    #[must_use]
    pub fn lit_by(self, lights: Option<&'a SceneLights>) -> Self {
        Self { lights, ..self }
    }

    /// The renderer.
    ///
    /// # Panics
    /// A frame failed before.
    #[must_use]
    pub fn into_renderer(self) -> Box<dyn Renderer> {
        self.renderer.expect("it came back from the last frames")
    }
}

impl PathViewer for ScoutRenderer<'_> {
    type Error = ScoutError;

    fn show(
        &mut self,
        shots: &[SampledShot],
        rated: bool,
        look: &mut dyn FnMut(&[DenseFrame]),
    ) -> Result<(), ScoutError> {
        let (moments_us, samples): (Vec<i64>, Vec<_>) = shots.iter().cloned().unzip();
        let (trajectory, velocities) = self.path.sampled(&moments_us);
        // The frames own the renderer while they are rendered. After an error it is not given back.
        let renderer = self.renderer.take().expect("it came back from the last frames");
        let frames = RenderedFrames::new(renderer, self.camera, trajectory);
        let mut frames = frames.with_samples(samples).lit_by(self.lights.cloned());
        if rated {
            frames = frames.with_rates(velocities);
        }
        if self.front_ends.iter().any(FrontEnd::needs_colour) {
            frames.want_colour();
        }
        while let Some(frame) = frames.next()? {
            // A plain front end shows the frame as it is.
            let seen = |front_end: &FrontEnd| match front_end.is_plain() {
                true => frame.clone(),
                false => front_end.see(&frame, frames.colour()),
            };
            look(&self.front_ends.iter().map(seen).collect::<Vec<_>>());
            if !(self.go_on)() {
                return Err(ScoutError::Interrupted);
            }
        }
        self.renderer = Some(frames.into_renderer());
        Ok(())
    }
}
