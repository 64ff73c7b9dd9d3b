//! The renderer of a training, with changes that return something.

use gs2e_image::Image;
use gs2e_render::backend::Backend;
use gs2e_render::cpu::backward::ViewGradients;
use gs2e_render::differentiable::DifferentiableRenderer;
use gs2e_render::{RenderError, RenderStyle, RenderWork};
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;

/// Why a change has a result.
const MADE: &str = "a renderer makes each change once";

/// A scene that is trained, on its back end.
#[derive(Debug)]
pub(super) struct TrainingRenderer(Box<dyn DifferentiableRenderer>);

impl TrainingRenderer {
    pub(super) fn new(backend: &Backend, scene: Gaussians, style: RenderStyle) -> Result<Self, RenderError> {
        backend.differentiable(scene, style).map(Self)
    }

    pub(super) fn scene(&self) -> &Gaussians {
        self.0.scene()
    }

    pub(super) fn into_scene(self) -> Gaussians {
        self.0.into_scene()
    }

    pub(super) fn set_degree(&mut self, degree: u8) {
        self.0.set_degree(degree);
    }

    /// See [`DifferentiableRenderer::change`].
    pub(super) fn change<T>(&mut self, numbers: &[u32], change: impl FnOnce(&mut Gaussians) -> T) -> T {
        let (mut change, mut found) = (Some(change), None);
        self.0.change(numbers, &mut |scene| found = change.take().map(|change| change(scene)));
        found.expect(MADE)
    }

    /// See [`DifferentiableRenderer::rebuild`].
    pub(super) fn rebuild<T>(&mut self, change: impl FnOnce(&mut Gaussians) -> T) -> Result<T, RenderError> {
        let (mut change, mut found) = (Some(change), None);
        self.0.rebuild(&mut |scene| found = change.take().map(|change| change(scene)))?;
        Ok(found.expect(MADE))
    }

    /// See [`DifferentiableRenderer::render`].
    pub(super) fn render(
        &mut self,
        view: &CameraView,
    ) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError> {
        self.0.render(view)
    }

    /// See [`DifferentiableRenderer::gradients`].
    pub(super) fn gradients(
        &mut self,
        by_pixel: &[[f32; 3]],
        score: &[f32],
        out: &mut ViewGradients,
    ) -> Result<(), RenderError> {
        self.0.gradients(by_pixel, score, out)
    }
}
