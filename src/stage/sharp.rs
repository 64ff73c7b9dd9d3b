//! Stage `sharp`: the frames that a release shows, one PNG a pose.

use super::{Context, Need, Stage, StageError, Target};
use crate::artifact::{Files, Motion, Pictures, write_json};
use crate::camera::CameraChoice;
use crate::image::png;
use crate::render::backend::Backend;
use crate::render::{Channels, Omit, RenderChoice, Rendered, View, Work};
use crate::scene::Gaussians;
use crate::source::Capture;
use rayon::prelude::*;
use serde::Serialize;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;

/// Parameters: camera, rendering, and every how many poses a frame is kept.
#[derive(Debug, Serialize)]
pub struct Photographing {
    /// The camera, where it differs from the source's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraChoice>,
    /// The rendering.
    pub render: RenderChoice,
    /// Every how many poses a frame is kept.
    pub every: u32,
    /// What is left out: the counts that a step writes down depend on it, its pictures and events do not.
    #[serde(skip_serializing_if = "Omit::is_needless")]
    pub omit: Omit,
    /// What renders.
    #[serde(skip)]
    pub backend: Backend,
}

/// Frames that are rendered before any of them is encoded: the encoder works on one core a frame.
const BATCH: usize = 8;

/// A batch in 32-bit colour, and what the encoders hold, by measurement.
const BYTES_A_PIXEL: u64 = 104;

impl Stage for Photographing {
    const NAME: &'static str = "sharp";
    const REVISION: u32 = 2;
    type Inputs = (Target<Capture>, Target<Gaussians>, Target<Motion>);
    type Output = Pictures;

    fn class(&self) -> Option<String> {
        Some(self.backend.class())
    }

    fn need(&self, files: &[Files]) -> Need {
        super::rendering_need(&self.backend, self.camera, files, BYTES_A_PIXEL)
    }

    fn run(
        &self,
        (capture, gaussians, motion): (Capture, Gaussians, Motion),
        cx: &mut Context<'_>,
    ) -> Result<(), StageError> {
        let camera = super::camera(self.camera, &capture, cx);
        let style = self.render.resolve(gaussians.antialiased);
        let mut renderer =
            self.backend.renderer(Arc::new(gaussians), style).map_err(StageError::work("render"))?;
        renderer.omit(self.omit);
        let poses = &motion.trajectory.world_from_camera;
        renderer.keep_to(&camera, poses);
        let kept: Vec<usize> = (0..poses.len()).step_by(self.every as usize).collect();
        let want = Channels { rgb: true, ..Channels::default() };
        let mut work = Work::default();
        for batch in kept.chunks(BATCH) {
            let mut images = Vec::with_capacity(batch.len());
            for &j in batch {
                cx.go_on()?;
                let view = View::still(camera, poses[j]);
                let mut rendered = Rendered::default();
                work += renderer.render(&view, want, &mut rendered).map_err(StageError::work("render"))?;
                images.push((j, rendered.rgb.expect("colour was asked for")));
            }
            images.par_iter().try_for_each(|(j, image)| {
                let out = cx.out.join(format!("{j:06}.png"));
                File::create(&out)
                    .and_then(|file| png::write(&png::to_bytes(image), BufWriter::new(file)))
                    .map_err(StageError::io(&out))
            })?;
        }
        let out = cx.out.join("work.json");
        write_json(&out, &work).map_err(StageError::io(&out))
    }
}
