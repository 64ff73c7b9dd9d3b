//! Choice of a back end, and the numerical class that it adds to the keys of steps.

use super::cpu::{self, CpuRenderer};
use super::gpu::{self, GpuError, GpuPool, GpuRenderer};
use super::lens::LensRenderer;
use super::reference::{self, ReferenceRenderer};
use super::{RenderError, RenderStyle, Renderer};
use crate::image::Size;
use crate::scene::Gaussians;
use std::sync::Arc;

/// A back end that can take scenes.
#[derive(Debug, Clone, Default)]
pub enum Backend {
    /// The CPU in f32.
    #[default]
    Cpu,
    /// The CPU in f64: slow.
    Reference,
    /// A GPU, or several of one kind.
    Gpu(GpuPool),
    /// A GPU that was not opened, known by its numerical class. It is enough for keys, but it
    /// cannot render.
    Unopened(String),
}

impl Backend {
    /// The numerical class: the [`Renderer::fingerprint`] of its renderers.
    #[must_use]
    pub fn class(&self) -> String {
        match self {
            Self::Cpu => cpu::FINGERPRINT.to_owned(),
            Self::Reference => reference::FINGERPRINT.to_owned(),
            Self::Gpu(pool) => pool.fingerprint().to_owned(),
            Self::Unopened(class) => class.clone(),
        }
    }

    /// Creates the renderer of a scene, for cameras with and without a lens.
    ///
    /// # Errors
    /// The back end cannot hold the scene, or cannot render in this style.
    pub fn renderer(
        &self,
        scene: Arc<Gaussians>,
        style: RenderStyle,
    ) -> Result<Box<dyn Renderer>, RenderError> {
        let pinhole: Box<dyn Renderer> = match self {
            Self::Cpu => Box::new(CpuRenderer::new(scene, style)?),
            Self::Reference => Box::new(ReferenceRenderer::new(scene, style)?),
            Self::Gpu(pool) => Box::new(GpuRenderer::new(pool.take()?, &scene, style)?),
            Self::Unopened(class) => return Err(GpuError::None(format!("{class} was not opened")).into()),
        };
        Ok(Box::new(LensRenderer::new(pinhole)))
    }

    /// Host memory for rendering a scene of this many bytes at this size, in bytes.
    #[must_use]
    pub fn memory(&self, scene_bytes: u64, size: Size) -> u64 {
        match self {
            Self::Cpu => cpu::memory_needed(scene_bytes, size),
            Self::Reference => reference::memory_needed(scene_bytes, size),
            Self::Gpu(_) | Self::Unopened(_) => gpu::memory_needed(scene_bytes, size),
        }
    }

    /// Returns true if the back end can render both with and without leaving work out.
    #[must_use]
    pub fn has_choice(&self) -> bool {
        matches!(self, Self::Cpu)
    }

    /// Returns true if the back end uses a GPU.
    #[must_use]
    pub fn takes_gpu(&self) -> bool {
        matches!(self, Self::Gpu(_) | Self::Unopened(_))
    }

    /// Returns true if a numerical class is that of the CPU in f32, in any revision.
    #[must_use]
    // The number behind the slash is the revision, which does not matter here.
    pub fn is_cpu(class: &str) -> bool {
        class.starts_with("cpu/")
    }

    /// Returns true if a numerical class is that of a GPU.
    #[must_use]
    pub fn is_gpu(class: &str) -> bool {
        class.starts_with("gpu/")
    }
}
