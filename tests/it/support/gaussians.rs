//! Small scenes in plain terms, and views of them: those of `gs2e stress`.

pub(crate) use gs2e::study::stress::splat::blobs::{
    ALL, Blob, Draws, OFFICIAL, blob_crowd, blob_scene, view_ahead,
};

use gs2e::render::cpu::Cpu;
use gs2e::render::{Rendered, Renderer, Style, View, Work};
use gs2e::scene::Gaussians;
use std::sync::Arc;

pub(crate) fn render(scene: Gaussians, style: Style, view: &View) -> (Rendered, Work) {
    let mut out = Rendered::default();
    let work = Cpu::new(Arc::new(scene), style).unwrap().render(view, ALL, &mut out).unwrap();
    (out, work)
}
