//! Common part of the stages that render pictures for a release: camera, rules, and the loop over
//! poses.

use super::{Context, Need, StageError};
use crate::artifact::{Files, Motion, write_json};
use crate::camera::{Camera, CameraChoice};
use crate::render::backend::Backend;
use crate::render::{Channels, Omit, RenderChoice, Rendered, Renderer, Velocity, View, Work};
use crate::scene::Gaussians;
use crate::source::Capture;
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter};
use std::sync::Arc;

/// Parameters: the camera and the rendering.
#[derive(Debug, Clone, Serialize)]
pub struct Shot {
    /// The camera, if it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// Work that the renderer leaves out. The stored counts depend on it; pictures do not.
    #[serde(skip_serializing_if = "Omit::is_needless")]
    pub omit: Omit,
    /// The back end.
    #[serde(skip)]
    pub backend: Backend,
}

/// Number of pictures rendered before they are encoded: the encoder uses one core per picture.
const BATCH: usize = 8;

/// A camera and its renderer.
pub(super) struct Ready {
    pub(super) camera: Camera,
    pub(super) renderer: Box<dyn Renderer>,
}

impl Shot {
    pub(super) fn need(&self, files: &[Files], bytes_a_pixel: u64) -> Need {
        super::rendering_need(&self.backend, self.camera, files, bytes_a_pixel)
    }

    /// A renderer that was promised the poses.
    pub(super) fn ready(
        &self,
        capture: &Capture,
        gaussians: Gaussians,
        motion: &Motion,
        cx: &mut Context<'_>,
    ) -> Result<Ready, StageError> {
        let camera = super::choose_camera(self.camera, capture, cx);
        let style = self.render.resolve(gaussians.antialiased);
        let mut renderer =
            self.backend.renderer(Arc::new(gaussians), style).map_err(StageError::work_failed("render"))?;
        renderer.omit(self.omit);
        renderer.keep_to(&camera, &motion.trajectory.world_from_camera);
        Ok(Ready { camera, renderer })
    }
}

impl Ready {
    /// The views from these poses, of a camera at rest or in motion.
    pub(super) fn views(
        &self,
        motion: &Motion,
        poses: &[usize],
        velocities: Option<&[Velocity]>,
    ) -> Vec<(usize, View)> {
        let view = |j: usize| {
            let still = View::at_rest(self.camera, motion.trajectory.world_from_camera[j]);
            velocities.map_or(still, |all| View { velocity: all[j], ..still })
        };
        poses.iter().map(|j| (*j, view(*j))).collect()
    }

    /// Renders the requested channels of these views, and writes each to the file of its index, and
    /// `work.json`.
    pub(super) fn take(
        &mut self,
        views: &[(usize, View)],
        want: Channels,
        (extension, write): (&str, impl Fn(&Rendered, BufWriter<File>) -> io::Result<()> + Sync),
        cx: &Context<'_>,
    ) -> Result<(), StageError> {
        let mut work = Work::default();
        for batch in views.chunks(BATCH) {
            let mut pictures = Vec::with_capacity(batch.len());
            for (j, view) in batch {
                cx.go_on()?;
                let mut rendered = Rendered::default();
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
pub(super) fn record_work(work: &Work, cx: &Context<'_>) -> Result<(), StageError> {
    let out = cx.out.join("work.json");
    write_json(&out, work).map_err(StageError::io_error(&out))
}
