//! Small scenes in plain terms, and views of them, as in `gs2e stress`.

pub(crate) use gs2e::study::stress::splat::blobs::{
    ALL, ColourBlob, OFFICIAL, ScatterDraws, blob_crowd, blob_scene, view_ahead,
};

use gs2e::camera::view::CameraView;
use gs2e::render::cpu::CpuRenderer;
use gs2e::render::{RenderStyle, RenderWork, RenderedImages, Renderer};
use gs2e::scene::Gaussians;
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
