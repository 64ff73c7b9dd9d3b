//! What every stage has that renders pictures for a release: camera, rules, and the loop over poses.

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
    /// The camera, where it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// What is left out: the counts that a step writes down depend on it, its pictures and events do not.
    #[serde(skip_serializing_if = "Omit::is_needless")]
    pub omit: Omit,
    /// What renders.
    #[serde(skip)]
    pub backend: Backend,
}

/// Pictures that are rendered before any of them is encoded: the encoder works on one core a picture.
const BATCH: usize = 8;

/// A camera and what renders for it.
pub(super) struct Ready {
    pub(super) camera: Camera,
    pub(super) renderer: Box<dyn Renderer>,
}

impl Shot {
    pub(super) fn need(&self, files: &[Files], bytes_a_pixel: u64) -> Need {
        super::rendering_need(&self.backend, self.camera, files, bytes_a_pixel)
    }

    /// A renderer that knows from where it will be asked.
    pub(super) fn ready(
        &self,
        capture: &Capture,
        gaussians: Gaussians,
        motion: &Motion,
        cx: &mut Context<'_>,
    ) -> Result<Ready, StageError> {
        let camera = super::camera(self.camera, capture, cx);
        let style = self.render.resolve(gaussians.antialiased);
        let mut renderer =
            self.backend.renderer(Arc::new(gaussians), style).map_err(StageError::work("render"))?;
        renderer.omit(self.omit);
        renderer.keep_to(&camera, &motion.trajectory.world_from_camera);
        Ok(Ready { camera, renderer })
    }
}

impl Ready {
    /// The views from these poses, of a camera at rest or as it moves.
    pub(super) fn views(
        &self,
        motion: &Motion,
        poses: &[usize],
        velocities: Option<&[Velocity]>,
    ) -> Vec<(usize, View)> {
        let view = |j: usize| {
            let still = View::still(self.camera, motion.trajectory.world_from_camera[j]);
            velocities.map_or(still, |all| View { velocity: all[j], ..still })
        };
        poses.iter().map(|j| (*j, view(*j))).collect()
    }

    /// Renders what is wanted of these views, and has each written to the file of its number; and `work.json`.
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
                work +=
                    self.renderer.render(view, want, &mut rendered).map_err(StageError::work("render"))?;
                pictures.push((j, rendered));
            }
            pictures.par_iter().try_for_each(|(j, rendered)| {
                let out = cx.out.join(format!("{j:06}.{extension}"));
                let written = File::create(&out).and_then(|file| write(rendered, BufWriter::new(file)));
                written.map_err(StageError::io(&out))
            })?;
        }
        record(&work, cx)
    }
}

/// Writes down what was rendered and left out.
pub(super) fn record(work: &Work, cx: &Context<'_>) -> Result<(), StageError> {
    let out = cx.out.join("work.json");
    write_json(&out, work).map_err(StageError::io(&out))
}
