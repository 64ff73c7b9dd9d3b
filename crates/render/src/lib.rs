//! Rendering of Gaussians: the trait of the back ends, their common rules, and their counts.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_image::Size;
//! # use gs2e_num::se3::Se3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_render::cpu::CpuRenderer;
//! use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle, RenderedImages, Renderer as _};
//! use gs2e_scene::camera::{Camera, view::CameraView};
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([-1.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! let camera = Camera::pinhole(Size { width: 9, height: 9 }, [9.0, 9.0, 4.5, 4.5]);
//! let view = CameraView::at_rest(camera, Se3::IDENTITY);
//! let (rules, order) = (RenderRules::Exact, LayerOrder::Depth);
//! let style = RenderStyle { rules, order, antialiased: false, background: [0.0; 3] };
//! let (want, mut images) = (ChannelSet { rgb: true, ..ChannelSet::NONE }, RenderedImages::default());
//! CpuRenderer::new(scene.into(), style)?.render(&view, want, &mut images)?;
//! // The only Gaussian is on the axis, has the middle grey, and covers half of the black behind it.
//! assert_eq!(images.rgb.ok_or("no colours")?.pixels()[4 * 9 + 4], [0.25; 3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod backend;
pub mod centre;
pub mod cpu;
pub mod differentiable;
pub mod doubt;
mod dual;
pub mod flow;
mod gpu_error;
pub mod lens;
pub mod lights;
pub mod near;
pub mod objects;
pub mod points;
pub mod reference;
pub mod sample;
pub mod shared;

pub use gpu_error::GpuError;

use gs2e_image::Image;
use gs2e_num::se3::Se3;
use gs2e_scene::Gaussians;
use gs2e_scene::camera::Camera;
use gs2e_scene::camera::view::CameraView;
use sample::TileSample;
use serde::{Deserialize, Serialize};
use shared::MAX_EDGE;
use std::sync::Arc;

/// The renderer whose conventions decide extents, culling and early stops (constants in
/// `render/shared.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RenderRules {
    /// The published CUDA rasteriser: 3-sigma extents, rounded out to tiles.
    Official,
    /// Every pixel at which a layer's opacity reaches 1/255.
    Exact,
    /// The conventions of gsplat.
    Gsplat,
    /// As `exact`, but layers fade in, so that opacity is a continuous function of the view.
    Soft,
}

/// The order of layers at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LayerOrder {
    /// By the depth of their means.
    #[default]
    Depth,
    /// Layers cover each other in part; with the rules `soft` only.
    Blended,
}

impl LayerOrder {
    /// Returns true if this is the default.
    #[must_use]
    pub(crate) fn is_depth(&self) -> bool {
        *self == Self::Depth
    }
}

/// Parameters that define the image, and so enter the key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RenderStyle {
    /// Rendering rules.
    pub rules: RenderRules,
    /// Order of layers.
    pub order: LayerOrder,
    /// True if opacity is compensated for the screen-space dilation.
    pub antialiased: bool,
    /// Colour behind the scene, 0..1.
    pub background: [f32; 3],
}

impl RenderStyle {
    /// The published rules over a black background.
    pub const OFFICIAL: Self = Self {
        rules: RenderRules::Official,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
}

/// The rendering of a recipe: a [`RenderStyle`] in which antialiasing may depend on the scene file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RenderChoice {
    /// Rendering rules.
    pub rules: RenderRules,
    /// Order of layers.
    #[serde(skip_serializing_if = "LayerOrder::is_depth")]
    pub order: LayerOrder,
    /// Antialiasing.
    pub antialiased: AntialiasMode,
    /// Colour behind the scene, 0..1.
    pub background: [f64; 3],
    /// Depth of the plane whose Gaussians are hidden along a path, in scale distances, if some are: see
    /// [`near::hide_near`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near: Option<f64>,
}

/// The choice of the antialiased rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AntialiasMode {
    /// As the scene file says; off if it does not say.
    Auto,
    /// On.
    On,
    /// Off.
    Off,
}

impl RenderChoice {
    /// The choice for single views, which have no path.
    #[must_use]
    pub fn of_views(self) -> Self {
        Self { near: None, ..self }
    }

    /// The style for a scene that was, or was not, trained with antialiasing.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "colours are blended in 32 bits")]
    pub fn resolve(&self, scene_antialiased: Option<bool>) -> RenderStyle {
        let antialiased = match self.antialiased {
            AntialiasMode::Auto => scene_antialiased.unwrap_or(false),
            AntialiasMode::On => true,
            AntialiasMode::Off => false,
        };
        RenderStyle {
            rules: self.rules,
            order: self.order,
            antialiased,
            background: self.background.map(|c| c as f32),
        }
    }
}

/// Work that a renderer may leave out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OmissionPolicy {
    /// Work that changes no bit of an image: Gaussians that no promised view can see, harmonics
    /// that are zero in the whole scene, layers behind finished pixels.
    #[default]
    Needless,
    /// Nothing. The back end computes everything it can, so that [`Self::Needless`] can be compared
    /// with it.
    Nothing,
}

impl OmissionPolicy {
    /// Returns true if this is the default.
    #[must_use]
    pub fn is_needless(&self) -> bool {
        *self == Self::Needless
    }
}

/// Requested images. Only requested images cost time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelSet {
    /// Colour.
    pub rgb: bool,
    /// Luminance: one blended channel, where colour needs three.
    pub luminance: bool,
    /// Accumulated opacity.
    pub alpha: bool,
    /// Depth.
    pub depth: bool,
    /// Optical flow, from depth and the velocity of the view.
    pub flow: bool,
    /// Rate of the luminance for the velocity of the view.
    pub luminance_rate: bool,
    /// Share of each pixel that comes from Gaussians too deep for their distance.
    pub doubtful: bool,
    /// The moving object that each pixel shows.
    pub segmentation: bool,
    /// Velocity of the Gaussians that each pixel shows, of a scene that changes with time.
    pub drift: bool,
}

impl ChannelSet {
    /// No image: [`Default`] as a constant.
    pub const NONE: Self = Self {
        rgb: false,
        luminance: false,
        alpha: false,
        depth: false,
        flow: false,
        luminance_rate: false,
        doubtful: false,
        segmentation: false,
        drift: false,
    };

    /// All images of a still scene for a camera at rest.
    pub const AT_REST: Self =
        Self { rgb: true, luminance: true, alpha: true, depth: true, doubtful: true, ..Self::NONE };

    /// The moving objects and the velocities of a scene that has them.
    pub(crate) fn of_motion(scene: &Gaussians) -> Self {
        Self { segmentation: scene.object_count() > 0, drift: scene.dynamics().is_some(), ..Self::NONE }
    }

    /// Returns true if no image is requested.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::NONE
    }

    /// The images of this set and of another one. The values of an image do not depend on the others
    /// that are requested with it.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self {
            rgb: self.rgb || other.rgb,
            luminance: self.luminance || other.luminance,
            alpha: self.alpha || other.alpha,
            depth: self.depth || other.depth,
            flow: self.flow || other.flow,
            luminance_rate: self.luminance_rate || other.luminance_rate,
            doubtful: self.doubtful || other.doubtful,
            segmentation: self.segmentation || other.segmentation,
            drift: self.drift || other.drift,
        }
    }
}

/// The requested images; the others are `None`.
#[derive(Debug, Clone, Default)]
pub struct RenderedImages {
    /// Encoded colour, nominally 0..1, not clamped.
    pub rgb: Option<Image<[f32; 3]>>,
    /// Luminance of the unclamped colour, 0..1.
    pub luminance: Option<Image<f32>>,
    /// `1 - T`.
    pub alpha: Option<Image<f32>>,
    /// `sum(w z) / sum(w)`, scene units along the optical axis. NaN where alpha is below 0.5.
    pub depth: Option<Image<f32>>,
    /// Image velocity of the point at each pixel's depth, px/s. NaN where depth is NaN.
    pub flow: Option<Image<[f32; 2]>>,
    /// Time derivative of [`Self::luminance`], 1/s.
    pub luminance_rate: Option<Image<f32>>,
    /// Blended weight, 0..1, of the Gaussians counted by [`RenderWork::affine_doubtful`].
    pub doubtful: Option<Image<f32>>,
    /// The moving object with the largest blended weight, from 1; 0 where what is still and what is behind
    /// have more.
    pub segmentation: Option<Image<u8>>,
    /// `sum(w v) / sum(w)` of the velocities of the means, without the motion of the camera: camera axes,
    /// scene units per second. NaN where alpha is below 0.5.
    pub drift: Option<Image<[f32; 3]>>,
}

impl RenderedImages {
    /// Removes the images that were not requested.
    pub fn clear_all_but(&mut self, want: ChannelSet) {
        let Self { rgb, luminance, alpha, depth, flow, luminance_rate, doubtful, segmentation, drift } = self;
        rgb.take_if(|_| !want.rgb);
        flow.take_if(|_| !want.flow);
        luminance.take_if(|_| !want.luminance);
        alpha.take_if(|_| !want.alpha);
        depth.take_if(|_| !want.depth);
        luminance_rate.take_if(|_| !want.luminance_rate);
        doubtful.take_if(|_| !want.doubtful);
        segmentation.take_if(|_| !want.segmentation);
        drift.take_if(|_| !want.drift);
    }
}

/// Counts of one rendering: what was done, and what was left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderWork {
    /// Gaussians in the scene.
    pub gaussians: u64,
    /// Gaussians left out because no promised view can see them ([`Renderer::keep_to`]).
    pub unseen: u64,
    /// Gaussians left out because they are not in front of the near plane.
    pub behind: u64,
    /// Gaussians left out because a field, or a projected value, is not finite.
    pub degenerate: u64,
    /// Gaussians left out because they touch no tile of the image, or are too transparent.
    pub outside: u64,
    /// Harmonics of drawn Gaussians that were not evaluated, because they are zero in the whole
    /// scene.
    pub zero_harmonics: u64,
    /// (Gaussian, tile) pairs listed.
    pub tile_pairs: u64,
    /// Listed pairs that were skipped, because every pixel of the tile was finished.
    pub hidden: u64,
    /// (Gaussian, pixel) pairs whose alpha was blended.
    pub blended: u64,
    /// Pixels at which blending stopped early.
    pub stopped: u64,
    /// Drawn Gaussians with a depth deviation above 0.1 of the depth, for which the affine
    /// approximation is doubtful.
    pub affine_doubtful: u64,
    /// Drawn Gaussians with a depth deviation above 0.3 of the depth, for which the affine
    /// approximation is invalid.
    pub affine_invalid: u64,
}

impl RenderWork {
    /// Number of Gaussians that were drawn.
    #[must_use]
    pub fn drawn(&self) -> u64 {
        // A Gaussian is left out for one reason only, so no two of these counts overlap.
        self.gaussians - self.unseen - self.behind - self.degenerate - self.outside
    }
}

impl std::ops::AddAssign for RenderWork {
    fn add_assign(&mut self, o: Self) {
        self.gaussians += o.gaussians;
        self.unseen += o.unseen;
        self.behind += o.behind;
        self.degenerate += o.degenerate;
        self.outside += o.outside;
        self.zero_harmonics += o.zero_harmonics;
        self.tile_pairs += o.tile_pairs;
        self.hidden += o.hidden;
        self.blended += o.blended;
        self.stopped += o.stopped;
        self.affine_doubtful += o.affine_doubtful;
        self.affine_invalid += o.affine_invalid;
    }
}

/// The reason why an image could not be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The view has a value that cannot be rendered.
    #[error("the view cannot be rendered: {0}")]
    View(String),
    /// The back end cannot hold the scene.
    #[error("the scene cannot be rendered: {0}")]
    Scene(String),
    /// A parameter has a value that cannot be rendered.
    #[error("the style cannot be rendered: {0}")]
    Style(String),
    /// The GPU failed or is out of memory.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// A back end that holds one scene and renders its views.
pub trait Renderer {
    /// The numerical class: everything other than inputs and parameters on which pixels depend.
    /// Enters the key.
    fn fingerprint(&self) -> &str;

    /// Sets the work to leave out from now on. A back end without a choice ignores it: the
    /// reference leaves out nothing, and a GPU only pairs behind finished tiles.
    fn omit(&mut self, omit: OmissionPolicy) {
        let _ = omit;
    }

    /// Promises that later frames show only these poses of this camera. Gaussians that none of them
    /// can see may be left out, which changes no pixel. A view outside the promise may lack
    /// Gaussians. A later promise replaces an earlier one; an empty promise leaves nothing out.
    fn keep_to(&mut self, camera: &Camera, poses: &[Se3]) {
        let _ = (camera, poses);
    }

    /// Promises that the next frames of one of several readers show only these poses, which may lie
    /// outside the promise of [`Renderer::keep_to`]: that one is extended, and the counts of frames
    /// within it stay as they are. A later promise of this kind replaces an earlier one.
    fn keep_also(&mut self, camera: &Camera, poses: &[Se3]) {
        let _ = (camera, poses);
    }

    /// The counts of the last rendering, `work`, as they would be if the promise of
    /// [`Renderer::keep_also`] had been the only one.
    fn work_within(&self, work: RenderWork) -> RenderWork {
        work
    }

    /// Promises that of later frames of this size only the pixels of a sample are read; with `None`, all
    /// pixels. The others may have any value. The values of the sample's pixels do not change.
    fn sample(&mut self, sample: Option<Arc<TileSample>>) {
        let _ = sample;
    }

    /// The images that say how the points of an image move, in addition to depth and the views of
    /// [`Renderer::object_views`]; none if the scene is still.
    fn motion_channels(&self) -> ChannelSet {
        ChannelSet::NONE
    }

    /// A view as it looks from what is still, and then from the axes of each moving object of the scene, in
    /// order: with the pose and the velocity of the camera in those axes.
    fn object_views(&self, view: &CameraView) -> Vec<CameraView> {
        vec![*view]
    }

    /// Announces a view. Views are rendered in the order in which they are announced. An
    /// asynchronous back end may start the view now. Failures are reported by `render`.
    fn expect(&mut self, view: &CameraView, want: ChannelSet) {
        let _ = (view, want);
    }

    /// Renders one view into `out`, and reuses its images if their size fits.
    ///
    /// # Errors
    /// The view is not finite, or its camera has no pixels.
    fn render(
        &mut self,
        view: &CameraView,
        want: ChannelSet,
        out: &mut RenderedImages,
    ) -> Result<RenderWork, RenderError>;
}

/// Checks that the style can be rendered.
///
/// # Errors
/// The background is not finite, or the order of the layers does not fit the rules.
pub fn check_style(style: &RenderStyle) -> Result<(), RenderError> {
    if !style.background.iter().all(|v| v.is_finite()) {
        return Err(RenderError::Style(format!("background {:?} is not finite", style.background)));
    }
    // The cut of the other rules would keep the jumps that a blended order is meant to remove. The
    // CPU's pass therefore has the constants of `soft` built in.
    if style.order == LayerOrder::Blended && style.rules != RenderRules::Soft {
        let because = format!("a blended order needs the rules soft, found {:?}", style.rules);
        return Err(RenderError::Style(because.to_lowercase()));
    }
    Ok(())
}

/// Checks that the view can be rendered.
///
/// # Errors
/// A value is not finite, or the camera has no pixels or a focal length that is not positive.
pub fn check_view(view: &CameraView) -> Result<(), RenderError> {
    let camera = view.camera;
    let fail = |because: String| Err(RenderError::View(because));
    if let Some(lens) = camera.lens {
        return fail(format!("a pinhole camera is wanted, found the lens {lens}"));
    }
    let [w, h] = [camera.size.width, camera.size.height];
    if w == 0 || h == 0 || w > MAX_EDGE || h > MAX_EDGE {
        return fail(format!("image size {}, wanted 1 to {MAX_EDGE} px along each edge", camera.size));
    }
    let focal_is_good = |f: f64| f.is_finite() && f > 0.0;
    if !(focal_is_good(camera.fx) && focal_is_good(camera.fy)) {
        return fail(format!("focal lengths {}, {} px, wanted finite positive values", camera.fx, camera.fy));
    }
    if !(camera.cx.is_finite() && camera.cy.is_finite()) {
        return fail(format!("principal point ({}, {}) is not finite", camera.cx, camera.cy));
    }
    let pose = view.world_from_camera;
    if !(pose.rotation.is_finite() && pose.translation.is_finite()) {
        return fail(format!("pose {pose:?} is not finite"));
    }
    let velocity = view.velocity;
    if !(velocity.linear.is_finite() && velocity.angular.is_finite()) {
        return fail(format!("velocity {velocity:?} is not finite"));
    }
    if !view.seconds.is_finite() {
        return fail(format!("the time {} s is not finite", view.seconds));
    }
    Ok(())
}
