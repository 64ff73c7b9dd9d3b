//! Rendering Gaussians: the trait that back ends implement, the rules they share, what they count.

pub mod centre;
pub mod cpu;
pub mod flow;
pub mod shared;

use crate::camera::Camera;
use crate::image::Image;
use crate::se3::Se3;
use serde::{Deserialize, Serialize};

/// Which renderer's conventions decide extents, culling and stops (numbers in `render/shared.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rules {
    /// graphdeco-inria/diff-gaussian-rasterization: 3-sigma square extents rounded out to 16x16 tiles.
    Official,
    /// Every pixel where alpha reaches 1/255.
    Exact,
}

/// Parameters of a rendering that are part of its meaning, and so of its key.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Style {
    /// Conventions.
    pub rules: Rules,
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
        Style { rules: self.rules, antialiased, background: self.background.map(|c| c as f32) }
    }
}

/// Where from and through which camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Intrinsics and size.
    pub camera: Camera,
    /// Pose, OpenCV camera axes.
    pub world_from_camera: Se3,
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
}

/// What one rendering did and what it left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// Gaussians in the scene.
    pub gaussians: u64,
    /// Left out: not in front of the near plane.
    pub behind: u64,
    /// Left out: a field, or what is projected from it, is not finite.
    pub degenerate: u64,
    /// Left out: touches no tile of the image, or too transparent to count.
    pub outside: u64,
    /// (Gaussian, tile) pairs sorted and blended.
    pub tile_pairs: u64,
    /// (Gaussian, pixel) pairs whose alpha was blended.
    pub blended: u64,
    /// Pixels whose blend stopped early.
    pub stopped: u64,
    /// Of those drawn: depth deviation above 0.1 of the depth, so the affine approximation is doubtful.
    pub affine_doubtful: u64,
    /// The same, above 0.3.
    pub affine_invalid: u64,
}

impl std::ops::AddAssign for Work {
    fn add_assign(&mut self, o: Self) {
        self.gaussians += o.gaussians;
        self.behind += o.behind;
        self.degenerate += o.degenerate;
        self.outside += o.outside;
        self.tile_pairs += o.tile_pairs;
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
}

/// A back end that holds one scene and renders views of it.
pub trait Renderer {
    /// The numerical class: what, beside inputs and parameters, the pixels depend on. Enters the key.
    fn fingerprint(&self) -> &str;

    /// Renders one view into `out`, reusing its images where their size fits.
    ///
    /// # Errors
    /// When the view is not finite or its camera has no pixels.
    fn render(&mut self, view: &View, want: Channels, out: &mut Rendered) -> Result<Work, RenderError>;
}
