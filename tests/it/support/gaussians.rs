//! Small scenes in plain terms, and views of them, as in `gs2e stress`.

pub(crate) use gs2e_lab::stress::splat::blobs::ALL;
pub(crate) use gs2e_lab::stress::splat::blobs::ColourBlob;
pub(crate) use gs2e_lab::stress::splat::blobs::OFFICIAL;
pub(crate) use gs2e_lab::stress::splat::blobs::ScatterDraws;
pub(crate) use gs2e_lab::stress::splat::blobs::blob_crowd;
pub(crate) use gs2e_lab::stress::splat::blobs::blob_scene;
pub(crate) use gs2e_lab::stress::splat::blobs::view_ahead;

use gs2e_render::cpu::CpuRenderer;
use gs2e_render::{RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;
use std::sync::Arc;

pub(crate) fn render(
    scene: Gaussians,
    style: RenderStyle,
    view: &CameraView,
) -> (RenderedImages, RenderWork) {
    let mut out = RenderedImages::default();
    let work = CpuRenderer::new(Arc::new(scene), style).unwrap().render(view, ALL, &mut out).unwrap();
    (out, work)
}
