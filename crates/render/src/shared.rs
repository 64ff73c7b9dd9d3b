//! Constants of all back ends, each defined once. Sources:
//! graphdeco-inria/diff-gaussian-rasterization, `cuda_rasterizer/forward.cu` and `auxiliary.h`.
//!
//! # Examples
//!
//! ```
//! use gs2e_render::RenderRules;
//! use gs2e_render::shared::{MIN_ALPHA, least_alpha};
//!
//! // The smallest opacity that is drawn is a step of an 8-bit picture, and half of it where layers fade in.
//! assert_eq!(MIN_ALPHA, 1.0 / 255.0);
//! assert_eq!(least_alpha(RenderRules::Exact), MIN_ALPHA);
//! assert_eq!(least_alpha(RenderRules::Soft), MIN_ALPHA / 2.0);
//! ```

use super::RenderRules;

/// Edge of a square tile, px.
pub const TILE: usize = 16;

/// Depth below which a Gaussian is culled, scene units.
pub const NEAR: f32 = 0.2;

/// Added to both variances of a projected Gaussian, px^2.
pub const DILATION: f32 = 0.3;

/// The affine approximation is taken at directions clamped to this multiple of half the field of
/// view.
pub(crate) const FRUSTUM_SLACK: f64 = 1.3;

/// Largest opacity of one layer at one pixel.
pub const MAX_ALPHA: f32 = 0.99;

/// Opacity below which a layer is skipped.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;

/// Opacity below which a layer is skipped under the rules `soft`, where layers fade in.
pub(crate) const SOFT_MIN_ALPHA: f32 = 0.5 / 255.0;

/// Opacity below which a layer is skipped under these rules.
#[must_use]
pub fn least_alpha(rules: RenderRules) -> f32 {
    match rules {
        RenderRules::Official | RenderRules::Exact | RenderRules::Gsplat => MIN_ALPHA,
        RenderRules::Soft => SOFT_MIN_ALPHA,
    }
}

/// Blended order: relative difference of depth below which two layers cover each other in part.
pub(crate) const BLENDED_DEPTHS: f64 = 5e-4;

/// A pixel stops before the layer that would reduce its transmittance below this.
pub const STOP: f32 = 1e-4;

/// Smallest ratio of the determinants without and with dilation for which the antialiased rule
/// compensates.
pub const COMPENSATION_FLOOR: f32 = 2.5e-5;

/// Rules `official`: half a Gaussian's square extent, in standard deviations along its longer axis.
pub const EXTENT_SIGMAS: f32 = 3.0;

/// Rules `official`: smallest value under the root of the larger eigenvalue in the extent, px^4.
pub const EXTENT_ROOT_FLOOR: f32 = 0.1;

/// Accumulated opacity below which depth is undefined.
pub const DEPTH_MIN_ALPHA: f32 = 0.5;

/// Depth deviation over depth above which the affine approximation is doubtful.
pub const AFFINE_DOUBTFUL: f32 = 0.1;

/// Depth deviation over depth above which the affine approximation is invalid.
pub const AFFINE_INVALID: f32 = 0.3;

/// Largest image edge, px: pixel coordinates inside the back ends have 16 bits.
pub const MAX_EDGE: u32 = 65_535;

/// Rules `gsplat`: smallest and largest depth, scene units.
pub const GSPLAT_NEAR: f32 = 0.01;
/// See [`GSPLAT_NEAR`].
pub const GSPLAT_FAR: f32 = 1e10;

/// Rules `gsplat`: the affine approximation is taken at directions within the image extended by
/// this share of its edges.
pub(crate) const GSPLAT_SLACK: f64 = 0.15;

/// Rules `gsplat`: largest half extent along an axis, in standard deviations.
pub const GSPLAT_SIGMAS: f32 = 3.33;
