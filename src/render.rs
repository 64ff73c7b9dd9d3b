//! Rendering Gaussians: the trait that back ends implement, the rules they share, what they count.

pub mod backend;
pub mod centre;
pub mod cpu;
pub mod doubt;
mod dual;
pub mod fidelity;
pub mod flow;
pub mod gpu;
pub mod reference;
pub mod shared;

use crate::camera::Camera;
use crate::image::Image;
use crate::se3::Se3;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use shared::MAX_EDGE;

/// Which renderer's conventions decide extents, culling and stops (numbers in `render/shared.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rules {
    /// graphdeco-inria/diff-gaussian-rasterization: 3-sigma square extents rounded out to 16x16 tiles.
    Official,
    /// Every pixel where alpha reaches 1/255.
    Exact,
    /// nerfstudio-project/gsplat: its culling, its clamp of the projection's derivative, its stop; each
    /// axis by itself.
    Gsplat,
    /// As [`Self::Exact`], but a layer fades in between half and one and a half grey steps instead of
    /// appearing at one: opacity is a continuous function of the view.
    Soft,
}

/// In which order layers lie at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layering {
    /// By the depth of their means; two that pass each other change places at once.
    #[default]
    Depth,
    /// As [`Self::Depth`], but two layers of nearly the same depth each cover the other in part, so that
    /// the picture is a continuous function of the view (docs/design/numerics-rendering.md, "Blended
    /// order"). For references: it costs more than twice the time.
    Blended,
}

impl Layering {
    /// Whether it is the order of every recipe that does not name one.
    #[must_use]
    pub fn is_depth(&self) -> bool {
        *self == Self::Depth
    }
}

/// Parameters of a rendering that are part of its meaning, and so of its key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Style {
    /// Conventions.
    pub rules: Rules,
    /// Layering of the layers.
    pub order: Layering,
    /// Whether opacity is compensated for the screen-space dilation.
    pub antialiased: bool,
    /// Colour behind the scene, on the scale 0..1.
    pub background: [f32; 3],
}

/// A recipe's rendering: a [`Style`] that may leave antialiasing to the scene file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RenderChoice {
    /// Conventions.
    pub rules: Rules,
    /// Layering of the layers.
    #[serde(skip_serializing_if = "Layering::is_depth")]
    pub order: Layering,
    /// Antialiasing.
    pub antialiased: Antialiased,
    /// Colour behind the scene, 0..1.
    pub background: [f64; 3],
}

/// Whether the antialiased rule is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Antialiased {
    /// As the scene file says; off where it cannot say.
    Auto,
    /// On.
    On,
    /// Off.
    Off,
}

impl RenderChoice {
    /// The style for a scene that says of itself that it was, or was not, trained antialiased.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "colours are blended in 32 bits")]
    pub fn resolve(&self, scene_antialiased: Option<bool>) -> Style {
        let antialiased = match self.antialiased {
            Antialiased::Auto => scene_antialiased.unwrap_or(false),
            Antialiased::On => true,
            Antialiased::Off => false,
        };
        Style {
            rules: self.rules,
            order: self.order,
            antialiased,
            background: self.background.map(|c| c as f32),
        }
    }
}

/// What a renderer leaves out of its own accord.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Omit {
    /// What changes no bit of an image: Gaussians that no promised view can see, harmonics that are zero in
    /// the whole scene, layers behind what is finished.
    #[default]
    Needless,
    /// Nothing: all is computed, as far as the back end can, so that [`Self::Needless`] can be held against
    /// it.
    Nothing,
}

impl Omit {
    /// Whether it is what every rendering does that is not told otherwise.
    #[must_use]
    pub fn is_needless(&self) -> bool {
        *self == Self::Needless
    }
}

/// Where from and through which camera, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Intrinsics and size.
    pub camera: Camera,
    /// Pose, OpenCV camera axes.
    pub world_from_camera: Se3,
    /// What channels that are rates are asked for.
    pub velocity: Velocity,
}

/// How a camera moves, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Velocity {
    /// Scene units a second.
    pub linear: DVec3,
    /// Radians a second.
    pub angular: DVec3,
}

impl View {
    /// The view of a camera at rest.
    #[must_use]
    pub fn still(camera: Camera, world_from_camera: Se3) -> Self {
        Self { camera, world_from_camera, velocity: Velocity::default() }
    }
}

/// Which images are wanted; each is paid for only when asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Channels {
    /// Colour.
    pub rgb: bool,
    /// Luminance alone: one channel blended in place of three.
    pub luminance: bool,
    /// Accumulated opacity.
    pub alpha: bool,
    /// Depth.
    pub depth: bool,
    /// Optical flow, from depth and the view's velocity.
    pub flow: bool,
    /// How fast luminance changes while the camera moves with the view's velocity.
    pub luminance_rate: bool,
    /// How much of each pixel comes from Gaussians too deep for their distance.
    pub doubtful: bool,
}

impl Channels {
    /// No image; [`Default`] for constants.
    pub const NONE: Self = Self {
        rgb: false,
        luminance: false,
        alpha: false,
        depth: false,
        flow: false,
        luminance_rate: false,
        doubtful: false,
    };
}

/// The images asked for; the others are `None`.
#[derive(Debug, Clone, Default)]
pub struct Rendered {
    /// Encoded colour, nominally 0..1, unclamped.
    pub rgb: Option<Image<[f32; 3]>>,
    /// Luminance of the unclamped colour on the scale 0..1.
    pub luminance: Option<Image<f32>>,
    /// `1 - T`.
    pub alpha: Option<Image<f32>>,
    /// `sum(w z) / sum(w)`, scene units along the optical axis; NaN where alpha is below 0.5.
    pub depth: Option<Image<f32>>,
    /// Image velocity of the point at each pixel's depth, px/s; NaN where depth is.
    pub flow: Option<Image<[f32; 2]>>,
    /// Time derivative of [`Self::luminance`], 1/s.
    pub luminance_rate: Option<Image<f32>>,
    /// Blended weight, 0..1, of the Gaussians that [`Work::affine_doubtful`] counts.
    pub doubtful: Option<Image<f32>>,
}

/// What one rendering did and what it left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Gaussians in the scene.
    pub gaussians: u64,
    /// Left out: no view that was promised can see it ([`Renderer::keep_to`]).
    pub unseen: u64,
    /// Left out: not in front of the near plane.
    pub behind: u64,
    /// Left out: a field, or what is projected from it, is not finite.
    pub degenerate: u64,
    /// Left out: touches no tile of the image, or too transparent to count.
    pub outside: u64,
    /// Of those drawn: harmonics not evaluated, since they are zero in the whole scene.
    pub zero_harmonics: u64,
    /// (Gaussian, tile) pairs listed.
    pub tile_pairs: u64,
    /// Of those, left out: every pixel of the tile was finished before.
    pub hidden: u64,
    /// (Gaussian, pixel) pairs whose alpha was blended.
    pub blended: u64,
    /// Pixels whose blend stopped early.
    pub stopped: u64,
    /// Of those drawn: depth deviation above 0.1 of the depth, so the affine approximation is doubtful.
    pub affine_doubtful: u64,
    /// The same, above 0.3.
    pub affine_invalid: u64,
}

impl Work {
    /// Gaussians that were drawn.
    #[must_use]
    pub fn drawn(&self) -> u64 {
        self.gaussians - self.unseen - self.behind - self.degenerate - self.outside
    }
}

impl std::ops::AddAssign for Work {
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

/// Why an image could not be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The view has a value that no image can be made of.
    #[error("the view cannot be rendered: {0}")]
    View(String),
    /// The back end cannot hold the scene.
    #[error("the scene cannot be rendered: {0}")]
    Scene(String),
    /// A parameter has a value that no image can be made with.
    #[error("the style cannot be rendered: {0}")]
    Style(String),
    /// The GPU failed, or has no room.
    #[error(transparent)]
    Gpu(#[from] gpu::GpuError),
}

/// A back end that holds one scene and renders views of it.
pub trait Renderer {
    /// The numerical class: what, beside inputs and parameters, the pixels depend on. Enters the key.
    fn fingerprint(&self) -> &str;

    /// Leaves out this from now on. A back end that has no other way of rendering goes on as before: the
    /// reference leaves nothing out, and a GPU no more than pairs behind finished tiles.
    fn omit(&mut self, omit: Omit) {
        let _ = omit;
    }

    /// Promises that from now on only these poses of this camera are rendered: what none of them can see
    /// may be left out, which changes no pixel. A view that was not promised is rendered too, but may lack
    /// Gaussians. A later promise takes the place of an earlier one; one of no pose leaves nothing out.
    fn keep_to(&mut self, camera: &Camera, poses: &[Se3]) {
        let _ = (camera, poses);
    }

    /// Says that this view is going to be rendered, after those said before: a back end that works beside
    /// the program may begin it now. What fails is told when it is rendered.
    fn expect(&mut self, view: &View, want: Channels) {
        let _ = (view, want);
    }

    /// Renders one view into `out`, reusing its images where their size fits.
    ///
    /// # Errors
    /// When the view is not finite or its camera has no pixels.
    fn render(&mut self, view: &View, want: Channels, out: &mut Rendered) -> Result<Work, RenderError>;
}

/// Whether an image can be made in this style.
fn check_style(style: &Style) -> Result<(), RenderError> {
    if !style.background.iter().all(|v| v.is_finite()) {
        return Err(RenderError::Style(format!("background {:?} is not finite", style.background)));
    }
    if style.order == Layering::Blended && style.rules != Rules::Soft {
        let because = format!("a blended order is of the rules soft, found {:?}", style.rules);
        return Err(RenderError::Style(because.to_lowercase()));
    }
    Ok(())
}

/// Whether an image can be made of the view.
fn check_view(view: &View) -> Result<(), RenderError> {
    let camera = view.camera;
    let fail = |because: String| Err(RenderError::View(because));
    let [w, h] = [camera.size.width, camera.size.height];
    if w == 0 || h == 0 || w > MAX_EDGE || h > MAX_EDGE {
        return fail(format!("image size {}, wanted 1 to {MAX_EDGE} px along each edge", camera.size));
    }
    let focal_is_good = |f: f64| f.is_finite() && f > 0.0;
    if !(focal_is_good(camera.fx) && focal_is_good(camera.fy)) {
        return fail(format!("focal lengths {}, {} px, wanted finite positive ones", camera.fx, camera.fy));
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
    Ok(())
}
