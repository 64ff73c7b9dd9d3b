//! The pixels that a projected Gaussian may touch, under each of the rules.

use super::splat::{clamp_pixel, edge_margin, pixels_within};
use crate::RenderRules;
use crate::shared::{EXTENT_ROOT_FLOOR, EXTENT_SIGMAS, GSPLAT_SIGMAS, TILE, least_alpha};

/// The exponent `q` at which `opacity * 2^-q` falls to the smallest opacity that is blended, which
/// is `log2(255 opacity)` except under `soft`, plus a margin: the exponential has a relative error
/// of 2e-7, and `q` itself of some units of 2^-24.
pub(super) fn opacity_reach(rules: RenderRules, opacity: f32) -> f32 {
    // An opacity below the least one has reach 0. The projection culls it by a test of its own.
    libm::log2f(opacity / least_alpha(rules)).max(0.0) * (1.0 + 1e-5) + 1e-5
}

/// First and end columns and rows that a Gaussian of dilated covariance `[[a, b], [b, c]]`, px^2,
/// may touch. Empty ranges if it touches no pixel of the image. The function has no branch once the
/// rules are known, so the compiler processes several Gaussians at once.
///
/// Under `official` and `gsplat`, these are the pixels of the published tiles that overlap the
/// ellipse's bounding box. Pixels of a tile outside the box are skipped there because of their
/// opacity, so omitting them changes nothing.
#[inline(always)]
pub(super) fn touched_pixels(
    rules: RenderRules,
    mean: [f32; 2],
    [a, b, c]: [f32; 3],
    reach: f32,
    size: [f32; 2],
) -> [[u16; 2]; 2] {
    let longest = longest([a, b, c]);
    let side =
        |k: usize, variance: f32| ExtentSide { mean: mean[k], variance, longest, reach, size: size[k] };
    [side(0, a).pixels(rules), side(1, c).pixels(rules)]
}

/// Inputs of the extent along one image axis.
struct ExtentSide {
    mean: f32,
    /// Variance along the axis, px^2.
    variance: f32,
    /// Largest variance along any direction, px^2.
    longest: f32,
    reach: f32,
    size: f32,
}

impl ExtentSide {
    #[inline(always)]
    fn pixels(&self, rules: RenderRules) -> [u16; 2] {
        // q = log2(e)/2 * d^T S^-1 d, so the half-widths of the box are sqrt(2 ln 2 q S_ii).
        let half = (2.0 * std::f32::consts::LN_2 * self.reach * self.variance).sqrt();
        let wide = half + edge_margin(half);
        let within = pixels_within(self.mean - wide, self.mean + wide, self.size);
        match rules {
            RenderRules::Exact | RenderRules::Soft => within,
            RenderRules::Gsplat => {
                // 2 ln(255 opacity) is 2 ln 2 times the reach.
                let sigmas = (2.0 * std::f32::consts::LN_2 * self.reach).sqrt().min(GSPLAT_SIGMAS);
                let radius = (sigmas * self.variance.sqrt()).ceil();
                common(within, gsplat_extent(self.mean, radius, self.size))
            }
            RenderRules::Official => {
                let radius = (EXTENT_SIGMAS * self.longest.sqrt()).ceil();
                // The published program counts pixels by their index: the centre of pixel 0 is at
                // 0.
                common(within, official_extent(self.mean - 0.5, radius, self.size))
            }
        }
    }
}

/// The pixels that two ranges share.
#[inline(always)]
fn common([a0, a1]: [u16; 2], [b0, b1]: [u16; 2]) -> [u16; 2] {
    [a0.max(b0), a1.min(b1)]
}

/// The larger eigenvalue of the dilated covariance, with the published floor under its root, px^2.
#[inline(always)]
fn longest([a, b, c]: [f32; 3]) -> f32 {
    let (middle, half) = (0.5 * (a + c), 0.5 * (a - c));
    middle + (half * half + b * b).max(EXTENT_ROOT_FLOOR).sqrt()
}

/// The published square, rounded outwards to tiles, in pixels: `trunc((c - r) / 16)` to
/// `trunc((c + r + 15) / 16)`.
#[inline(always)]
fn official_extent(centre: f32, radius: f32, size: f32) -> [u16; 2] {
    let last = centre + radius + (TILE_PX - 1.0);
    tile_pixels([((centre - radius) / TILE_PX).trunc(), (last / TILE_PX).trunc()], size)
}

/// The published extent along one axis, rounded outwards to tiles, in pixels.
#[inline(always)]
fn gsplat_extent(centre: f32, radius: f32, size: f32) -> [u16; 2] {
    tile_pixels([((centre - radius) / TILE_PX).floor(), ((centre + radius) / TILE_PX).ceil()], size)
}

#[expect(clippy::cast_precision_loss, reason = "a tile's edge is small")]
const TILE_PX: f32 = TILE as f32;

/// First and end pixels of a range of whole tiles.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the values are whole, and clamped to the image first"
)]
#[inline(always)]
fn tile_pixels([first, end]: [f32; 2], size: f32) -> [u16; 2] {
    [clamp_pixel(first * TILE_PX, size) as u16, clamp_pixel(end * TILE_PX, size) as u16]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn official_squares_are_rounded_out_to_tiles() {
        // Variance 4 px^2: r = ceil(3 sqrt(4 + sqrt(.1))) = 7, from the pixel index of the mean.
        let t = |centre: f32, wanted: [u16; 2]| {
            assert_eq!(official_extent(centre, 7.0, 100.0), wanted, "{centre}")
        };
        t(24.0, [16, 32]); // 17..31
        t(23.0, [16, 32]); // 16..30
        t(22.9, [0, 32]); // reaches pixel 15
        t(25.0, [16, 32]); // (25 + 7 + 15) / 16 = 2.94
        t(26.0, [16, 48]); // = 3 exactly
        t(-6.9, [0, 0]); // (-6.9 + 22) / 16 < 1
        t(-6.0, [0, 16]);
        t(106.9, [96, 100]);
        t(1e30, [100, 100]);
    }

    #[test]
    fn exact_extents_hold_every_pixel_that_counts_and_few_others() {
        for (variance, opacity) in [(0.3, 1.0), (4.0, 0.5), (900.0, 0.99), (4.0, 0.004)] {
            let [columns, rows] = touched_pixels(
                RenderRules::Exact,
                [500.25, 300.375],
                [variance, 0.0, variance],
                opacity_reach(RenderRules::Exact, opacity),
                [1000.0, 600.0],
            );
            // alpha = opacity exp(-d^2 / 2 variance) >= 1/255.
            let radius = (2.0 * f64::from(variance) * (255.0 * f64::from(opacity)).ln()).sqrt();
            let counts = |k: u32, mean: f64| (f64::from(k) + 0.5 - mean).abs() <= radius;
            for (range, mean) in [(columns, 500.25), (rows, 300.375)] {
                let inside: Vec<u32> = (0..1000).filter(|&k| counts(k, mean)).collect();
                assert!(inside.iter().all(|&k| u32::from(range[0]) <= k && k < u32::from(range[1])));
                assert!(usize::from(range[1] - range[0]) <= inside.len() + 2, "{range:?} for {inside:?}");
            }
        }
    }
}
