//! The Gaussian that makes most of a change between two views.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! # use gs2e_render::{LayerOrder, RenderRules, RenderStyle};
//! # use gs2e_scene::camera::Camera;
//! use gs2e_render::near::cause::{FlashViews, find_cause};
//! use gs2e_scene::camera::view::CameraView;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! # let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! # let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! # let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! // The only Gaussian of `scene` is at z = 2: in front of the first view, and behind the second one.
//! let views = [0.0, 3.0].map(|z| {
//!     CameraView::at_rest(camera, Se3 { translation: DVec3::Z * z, ..Se3::IDENTITY })
//! });
//! let cause = find_cause(&scene.into(), &FlashViews { views, style })?.ok_or("no cause")?;
//! // Without it, both views are black.
//! assert_eq!((cause.gaussian, cause.distance, cause.share), (0, 2.0, 1.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::footprint::NearEye;
use crate::cpu::CpuRenderer;
use crate::{ChannelSet, RenderError, RenderStyle, RenderedImages, Renderer};
use gs2e_image::Size;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use rayon::prelude::*;
use std::sync::Arc;

/// Number of Gaussians that are tried.
const TRIED: usize = 12;
/// Width of the pictures, px: a flash is large.
const WIDTH: u32 = 96;
/// Smallest part of the change that a cause makes.
const LEAST_SHARE: f64 = 0.1;

/// The views before and after the change, and their rendering.
#[derive(Debug, Clone, Copy)]
pub struct FlashViews {
    /// Before and after.
    pub views: [CameraView; 2],
    /// The rendering.
    pub style: RenderStyle,
}

/// The Gaussian that makes a change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlashCause {
    /// Its number in the scene.
    pub gaussian: usize,
    /// Distance of its mean from the camera in the first view, scene units.
    pub distance: f64,
    /// The part of the change that is gone without it.
    pub share: f64,
}

/// Finds the Gaussian without which two views differ least, among those whose share of the picture changes
/// most. `None` if none makes a tenth of the change.
///
/// # Errors
/// A view cannot be rendered.
pub fn find_cause(scene: &Arc<Gaussians>, change: &FlashViews) -> Result<Option<FlashCause>, RenderError> {
    let views = change.views.map(|view| CameraView { camera: small(view.camera), ..view });
    let whole = difference(scene.clone(), &views, change.style)?;
    let mut found: Option<FlashCause> = None;
    for gaussian in candidates(scene, change) {
        let mut without = Gaussians::clone(scene);
        without.opacity_logits[gaussian] = super::HIDDEN_LOGIT;
        // Two equal views make NaN, which exceeds no share.
        let share = 1.0 - difference(Arc::new(without), &views, change.style)? / whole;
        if share > found.map_or(LEAST_SHARE, |best| best.share) {
            let centre = change.views[0].world_from_camera.translation;
            let distance = (scene.position(gaussian) - centre).length();
            found = Some(FlashCause { gaussian, distance, share });
        }
    }
    Ok(found)
}

/// The Gaussians whose share of the picture changes most.
fn candidates(scene: &Gaussians, change: &FlashViews) -> Vec<usize> {
    let eyes = change.views.each_ref().map(|view| NearEye {
        camera: &view.camera,
        rules: change.style.rules,
        world_from_camera: view.world_from_camera,
    });
    let near = super::renderer_plane(change.style.rules);
    let cover = |eye: &NearEye<'_>, i: usize| {
        let footprint = eye.footprint(scene, i);
        if footprint.depth > near { footprint.cover() } else { 0.0 }
    };
    let changes = (0..scene.len()).into_par_iter().map(|i| (cover(&eyes[0], i) - cover(&eyes[1], i)).abs());
    let mut changes: Vec<(f64, usize)> = changes.collect::<Vec<_>>().into_iter().zip(0..).collect();
    changes.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    changes.into_iter().take(TRIED).map(|(_, i)| i).collect()
}

/// Mean difference of the luminance of two views.
fn difference(
    scene: Arc<Gaussians>,
    views: &[CameraView; 2],
    style: RenderStyle,
) -> Result<f64, RenderError> {
    let mut renderer = CpuRenderer::new(scene, style)?;
    let want = ChannelSet { luminance: true, ..ChannelSet::NONE };
    let mut images = [RenderedImages::default(), RenderedImages::default()];
    for (view, image) in views.iter().zip(&mut images) {
        renderer.render(view, want, image)?;
    }
    let [before, after] = images.map(|image| image.luminance.expect("luminance was asked for").into_pixels());
    let sum = before.iter().zip(&after).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    Ok(sum / before.len() as f64)
}

/// The camera with a small picture of the same field, without its lens.
fn small(camera: Camera) -> Camera {
    let Size { width, height } = camera.size;
    let narrow = width.min(WIDTH);
    let size = Size { width: narrow, height: (height * narrow / width).max(1) };
    let [across, down] =
        [f64::from(size.width) / f64::from(width), f64::from(size.height) / f64::from(height)];
    Camera {
        size,
        fx: camera.fx * across,
        fy: camera.fy * down,
        cx: camera.cx * across,
        cy: camera.cy * down,
        lens: None,
    }
}
