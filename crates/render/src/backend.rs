//! Choice of a back end, and the numerical class that it adds to the keys of steps.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
//! use gs2e_render::backend::Backend;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! let backend = Backend::default();
//! assert!(!backend.takes_gpu() && Backend::is_cpu(&backend.class()));
//! let renderer = backend.renderer(scene.into(), style)?;
//! assert_eq!(renderer.fingerprint(), backend.class());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::cpu::{self, CpuRenderer};
use super::differentiable::DifferentiableRenderer;
use super::lens::LensRenderer;
use super::reference::{self, ReferenceRenderer};
use super::{GpuError, LayerOrder, RenderError, RenderStyle, Renderer};
use gs2e_image::Size;
use gs2e_scene::Gaussians;
use std::sync::Arc;

/// Open GPUs of one numerical class, as the code that plans and runs steps knows them.
pub trait GpuBackend: std::fmt::Debug + Send + Sync {
    /// The numerical class of all GPUs: the [`Renderer::fingerprint`] of their renderers.
    fn class(&self) -> &str;

    /// The number of GPUs.
    fn device_count(&self) -> usize;

    /// Returns true if no GPU can render any more.
    fn is_lost(&self) -> bool;

    /// Creates the renderer of a scene, for cameras without a lens.
    ///
    /// # Errors
    /// The GPU cannot hold the scene, or cannot render in this style.
    fn renderer(&self, scene: &Gaussians, style: RenderStyle) -> Result<Box<dyn Renderer>, RenderError>;

    /// Creates a renderer with gradients.
    ///
    /// # Errors
    /// As [`Self::renderer`], or the style has no gradients.
    fn differentiable(
        &self,
        scene: Gaussians,
        style: RenderStyle,
    ) -> Result<Box<dyn DifferentiableRenderer>, RenderError>;
}

/// A back end that can take scenes.
#[derive(Debug, Clone, Default)]
pub enum Backend {
    /// The CPU in f32.
    #[default]
    Cpu,
    /// The CPU in f64: slow.
    Reference,
    /// A GPU, or several of one kind.
    Gpu(Arc<dyn GpuBackend>),
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
            Self::Gpu(gpus) => gpus.class().to_owned(),
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
            Self::Gpu(gpus) => gpus.renderer(&scene, style)?,
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
            Self::Gpu(_) | Self::Unopened(_) => Self::gpu_memory(scene_bytes, size),
        }
    }

    /// Host memory for rendering on a GPU, in bytes: the scene and its activated form during the upload, and
    /// the images of a few frames in transfer.
    fn gpu_memory(scene_bytes: u64, size: Size) -> u64 {
        const BYTES_A_PIXEL: u64 = 96;
        2 * scene_bytes + BYTES_A_PIXEL * u64::from(size.width) * u64::from(size.height)
    }

    /// Creates a renderer with gradients.
    ///
    /// # Errors
    /// As [`Self::renderer`], or the back end or the style has no gradients.
    pub fn differentiable(
        &self,
        scene: Gaussians,
        style: RenderStyle,
    ) -> Result<Box<dyn DifferentiableRenderer>, RenderError> {
        match self {
            Self::Cpu => Ok(Box::new(cpu::backward::GradientRenderer::new(scene, style)?)),
            Self::Gpu(gpus) => gpus.differentiable(scene, style),
            Self::Reference | Self::Unopened(_) => {
                Err(RenderError::Style(format!("{} has no gradients", self.class())))
            }
        }
    }

    /// Returns true if a GPU can blend layers in this order.
    #[must_use]
    pub fn gpu_supports_order(order: LayerOrder) -> bool {
        order == LayerOrder::Depth
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
