//! Renderings of a scene under training, and the gradients of its parameters.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle, cpu::backward::ViewGradients};
//! # use gs2e_scene::camera::{Camera, view::CameraView};
//! use gs2e_render::backend::Backend;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The only Gaussian of `scene` is grey, and covers half of the black in the middle pixel.
//! let mut renderer = Backend::Cpu.differentiable(scene, style)?;
//! renderer.render(&CameraView::at_rest(camera, Se3::IDENTITY))?;
//! let (mut by_pixel, mut found) = ([[0.0; 3]; 9 * 9], ViewGradients::default());
//! by_pixel[4 * 9 + 4] = [1.0, 0.0, 0.0];
//! renderer.gradients(&by_pixel, &[0.0; 9 * 9], &mut found)?;
//! // The slope of the sigmoid at 0 is 1/4, and the red of the Gaussian is 1/2.
//! assert!((found.gradients[0].logit - 0.125).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::cpu::backward::{GradientRenderer, ViewGradients};
use super::{RenderError, RenderWork};
use gs2e_image::Image;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::view::CameraView;

/// A scene on a back end with gradients.
pub trait DifferentiableRenderer: std::fmt::Debug {
    /// The scene.
    fn scene(&self) -> &Gaussians;

    /// Returns the scene and drops the rest.
    fn into_scene(self: Box<Self>) -> Gaussians;

    /// Sets the highest degree of harmonics that is evaluated. Higher ones count as zero.
    fn set_degree(&mut self, degree: u8);

    /// Changes parameters of the Gaussians with these indices, ascending. The number of Gaussians stays.
    ///
    /// # Panics
    /// The change adds or removes Gaussians.
    fn change(&mut self, numbers: &[u32], change: &mut dyn FnMut(&mut Gaussians));

    /// Changes the scene in any way, except its degree of harmonics.
    ///
    /// # Errors
    /// There is no memory for the scene.
    ///
    /// # Panics
    /// The degree of harmonics changes, on a back end with shaders for one degree.
    fn rebuild(&mut self, change: &mut dyn FnMut(&mut Gaussians)) -> Result<(), RenderError>;

    /// Renders a view and keeps the trace for [`Self::gradients`].
    ///
    /// # Errors
    /// The view cannot be rendered.
    fn render(&mut self, view: &CameraView) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError>;

    /// Gradients of a loss with respect to all parameters, from those with respect to the pixels of the last
    /// view, as [`GradientRenderer::gradients`].
    ///
    /// # Errors
    /// The back end has no memory for the sums, or it failed.
    ///
    /// # Panics
    /// No view was rendered since the last change of the scene or of the degree, or there is not one value
    /// per pixel.
    fn gradients(
        &mut self,
        by_pixel: &[[f32; 3]],
        score: &[f32],
        out: &mut ViewGradients,
    ) -> Result<(), RenderError>;
}

impl DifferentiableRenderer for GradientRenderer {
    fn scene(&self) -> &Gaussians {
        self.scene()
    }

    fn into_scene(self: Box<Self>) -> Gaussians {
        (*self).into_scene()
    }

    fn set_degree(&mut self, degree: u8) {
        self.set_degree(degree);
    }

    fn change(&mut self, numbers: &[u32], change: &mut dyn FnMut(&mut Gaussians)) {
        self.change(numbers, change);
    }

    fn rebuild(&mut self, change: &mut dyn FnMut(&mut Gaussians)) -> Result<(), RenderError> {
        self.rebuild(change);
        Ok(())
    }

    fn render(&mut self, view: &CameraView) -> Result<(&Image<[f32; 3]>, RenderWork), RenderError> {
        self.render(view)
    }

    fn gradients(
        &mut self,
        by_pixel: &[[f32; 3]],
        score: &[f32],
        out: &mut ViewGradients,
    ) -> Result<(), RenderError> {
        self.gradients(by_pixel, score, out);
        Ok(())
    }
}
