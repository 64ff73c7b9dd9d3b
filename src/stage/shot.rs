//! Common part of the stages that render pictures for a release: camera, rules, and the loop over
//! poses.

use super::{StageContext, StageError, StepNeed};
use crate::artifact::{ArtifactFiles, TrajectoryProduct, write_json};
use crate::camera::{Camera, CameraChoice};
use crate::render::backend::Backend;
use crate::render::{
    CameraVelocity, CameraView, ChannelSet, OmissionPolicy, RenderChoice, RenderWork, RenderedImages,
    Renderer,
};
use crate::scene::Gaussians;
use crate::source::Capture;
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter};
use std::sync::Arc;

/// Parameters: the camera and the rendering.
#[derive(Debug, Clone, Serialize)]
pub struct ShotParameters {
    /// The camera, if it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// Work that the renderer leaves out. The stored counts depend on it; pictures do not.
    #[serde(skip_serializing_if = "OmissionPolicy::is_needless")]
    pub omit: OmissionPolicy,
    /// The back end.
    #[serde(skip)]
    pub backend: Backend,
}

/// Number of pictures rendered before they are encoded: the encoder uses one core per picture.
const BATCH: usize = 8;

/// A camera and its renderer.
pub(super) struct ReadyShot {
    pub(super) camera: Camera,
    pub(super) renderer: Box<dyn Renderer>,
}

impl ShotParameters {
    pub(super) fn need(&self, files: &[ArtifactFiles], bytes_a_pixel: u64) -> StepNeed {
        super::rendering_need(&self.backend, self.camera, files, bytes_a_pixel)
    }

    /// A renderer that was promised the poses.
    pub(super) fn ready(
        &self,
        capture: &Capture,
        gaussians: Gaussians,
        motion: &TrajectoryProduct,
        cx: &mut StageContext<'_>,
    ) -> Result<ReadyShot, StageError> {
        let camera = super::choose_camera(self.camera, capture, cx);
        let style = self.render.resolve(gaussians.antialiased);
        let mut renderer =
            self.backend.renderer(Arc::new(gaussians), style).map_err(StageError::work_failed("render"))?;
        // The policy comes first: under another one, the renderer ignores the promise.
        renderer.omit(self.omit);
        renderer.keep_to(&camera, &motion.trajectory.world_from_camera);
        Ok(ReadyShot { camera, renderer })
    }
}

impl ReadyShot {
    /// The views from these poses, of a camera at rest or in motion.
    pub(super) fn views(
        &self,
        motion: &TrajectoryProduct,
        poses: &[usize],
        velocities: Option<&[CameraVelocity]>,
    ) -> Vec<(usize, CameraView)> {
        let view = |j: usize| {
            let still = CameraView::at_rest(self.camera, motion.trajectory.world_from_camera[j]);
            velocities.map_or(still, |all| CameraView { velocity: all[j], ..still })
        };
        poses.iter().map(|j| (*j, view(*j))).collect()
    }

    /// Renders the requested channels of these views, and writes each to the file of its index, and
    /// `work.json`.
    pub(super) fn take(
        &mut self,
        views: &[(usize, CameraView)],
        want: ChannelSet,
        (extension, write): (&str, impl Fn(&RenderedImages, BufWriter<File>) -> io::Result<()> + Sync),
        cx: &StageContext<'_>,
    ) -> Result<(), StageError> {
        let mut work = RenderWork::default();
        for batch in views.chunks(BATCH) {
            let mut pictures = Vec::with_capacity(batch.len());
            for (j, view) in batch {
                cx.go_on()?;
                let mut rendered = RenderedImages::default();
                work += self
                    .renderer
                    .render(view, want, &mut rendered)
                    .map_err(StageError::work_failed("render"))?;
                pictures.push((j, rendered));
            }
            pictures.par_iter().try_for_each(|(j, rendered)| {
                let out = cx.out.join(format!("{j:06}.{extension}"));
                let written = File::create(&out).and_then(|file| write(rendered, BufWriter::new(file)));
                written.map_err(StageError::io_error(&out))
            })?;
        }
        record_work(&work, cx)
    }
}

/// Writes the counts of the rendering.
pub(super) fn record_work(work: &RenderWork, cx: &StageContext<'_>) -> Result<(), StageError> {
    let out = cx.out.join("work.json");
    write_json(&out, work).map_err(StageError::io_error(&out))
}
