//! The renderers on the CPU, compared with goldens of another program, closed forms, differences and
//! each other.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]
#![expect(clippy::print_stdout, reason = "the figures")]

mod cases;
mod golden;
mod layering;
mod left_out;
mod rates;
mod rules;
mod same_bytes;

use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{ChannelSet, RenderStyle, RenderWork, RenderedImages, Renderer as _};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

/// All images of a camera at rest.
const ALL: ChannelSet = ChannelSet::AT_REST;
/// The published rules over a black background.
const OFFICIAL: RenderStyle = RenderStyle::OFFICIAL;

fn render(scene: Gaussians, style: RenderStyle, view: &CameraView) -> (RenderedImages, RenderWork) {
    let mut out = RenderedImages::default();
    let work = CpuRenderer::new(Arc::new(scene), style).unwrap().render(view, ALL, &mut out).unwrap();
    (out, work)
}
