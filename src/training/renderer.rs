//! The renderer of a training, with gradients: the CPU, or a GPU.

use crate::image::Image;
use crate::render::backend::Backend;
use crate::render::cpu::backward::{GradientRenderer, ViewGradients};
use crate::render::gpu::GpuGradientRenderer;
use crate::render::{CameraView, RenderError, RenderStyle, RenderWork};
use crate::scene::Gaussians;

/// A scene that is trained, on its back end.
#[derive(Debug)]
pub(super) enum TrainingRenderer {
    Cpu(Box<GradientRenderer>),
    Gpu(Box<GpuGradientRenderer>),
}

impl TrainingRenderer {
    pub(super) fn new(backend: &Backend, scene: Gaussians, style: RenderStyle) -> Result<Self, RenderError> {
        match backend {
            Backend::Cpu => Ok(Self::Cpu(Box::new(GradientRenderer::new(scene, style)?))),
            Backend::Gpu(pool) => {
                Ok(Self::Gpu(Box::new(GpuGradientRenderer::new(pool.take()?, scene, style)?)))
            }
            Backend::Reference | Backend::Unopened(_) => {
                Err(RenderError::Style(format!("{} has no gradients", backend.class())))
            }
        }
    }

    pub(super) fn scene(&self) -> &Gaussians {
        match self {
            Self::Cpu(renderer) => renderer.scene(),
            Self::Gpu(renderer) => renderer.scene(),
        }
    }

    pub(super) fn into_scene(self) -> Gaussians {
        match self {
            Self::Cpu(renderer) => renderer.into_scene(),
            Self::Gpu(renderer) => renderer.into_scene(),
        }
    }

    pub(super) fn set_degree(&mut self, degree: u8) {
        match self {
            Self::Cpu(renderer) => renderer.set_degree(degree),
            Self::Gpu(renderer) => renderer.set_degree(degree),
        }
    }

    /// See [`GradientRenderer::change`].
    pub(super) fn change<T>(&mut self, numbers: &[u32], change: impl FnOnce(&mut Gaussians) -> T) -> T {
        match self {
            Self::Cpu(renderer) => renderer.change(numbers, change),
            Self::Gpu(renderer) => renderer.change(numbers, change),
        }
    }

    /// Changes the scene in any way, except its degree of harmonics.
    pub(super) fn rebuild<T>(&mut self, change: impl FnOnce(&mut Gaussians) -> T) -> Result<T, RenderError> {
        match self {
            Self::Cpu(renderer) => Ok(renderer.rebuild(change)),
            Self::Gpu(renderer) => renderer.rebuild(change),
        }
    }

    pub(super) fn render(
        &mut self,
        view: &CameraView,
    ) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError> {
        match self {
            Self::Cpu(renderer) => renderer.render(view),
            Self::Gpu(renderer) => renderer.render(view),
        }
    }

    /// See [`GradientRenderer::gradients`].
    pub(super) fn gradients(
        &mut self,
        by_pixel: &[[f32; 3]],
        score: &[f32],
        out: &mut ViewGradients,
    ) -> Result<(), RenderError> {
        match self {
            Self::Cpu(renderer) => {
                renderer.gradients(by_pixel, score, out);
                Ok(())
            }
            Self::Gpu(renderer) => renderer.gradients(by_pixel, score, out),
        }
    }
}
