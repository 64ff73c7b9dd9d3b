//! Raster pass backwards: from the gradient of the loss at each pixel to sums per splat and tile.
//!
//! ```text
//! alpha_i = min(0.99, o 2^-q) r,   q = e1^2 + e2^2,   e = W (pixel - mean)
//! colour  = sum_i T_i alpha_i c_i + T_end background,   T_{i+1} = T_i (1 - alpha_i)
//! dL/dalpha_i = T_i (g . c_i) - behind_i / (1 - alpha_i),
//! behind_i    = sum_{j > i} T_j alpha_j (g . c_j) + T_end (g . background)
//! ```
//!
//! `g` is the gradient of the loss at the pixel and `r` the ramp of the rules `soft`, else 1. The
//! light in front of a layer is recovered by division, from the light that the forward pass left.
//! The forward pass also left the place of the last layer, so no test of a stop is repeated.
//!
//! With `a = dL/d ln(o 2^-q)`, only moments of `a` over the tile's pixels leave this pass
//! ([`SplatMoments`]). They are taken of `e`, the offset from the splat's own mean in units of its
//! own width: for a needle, moments of the offset in pixels would cancel when they are turned into
//! the gradient of the covariance.
//!
//! One splat is taken over all blocks of the tile before the next, so its ten sums stay in
//! registers, and each is summed over its lanes once. Blocks and lanes are added in a fixed order
//! that does not depend on the instruction set.

#![expect(clippy::cast_precision_loss, reason = "pixel coordinates and places in a tile's list are small")]

use crate::RenderRules;
use crate::cpu::bin::TileGrid;
use crate::cpu::exp2::exp2_neg;
use crate::cpu::raster::block::{pixel_place, soft_ramp};
use crate::cpu::raster::cover::BatchEllipses;
use crate::cpu::raster::{BATCH, BLOCKS, LANES, PIXELS, TRACED_PLANES};
use crate::cpu::splat::Splat;
use crate::shared::{MAX_ALPHA, TILE, least_alpha};
use fearless_simd::{Select as _, Simd, SimdBase as _, f32x16};
use std::ops::AddAssign;

/// Number of sums per splat.
const SUMS: usize = 10;

/// Sums over pixels for one splat, with `a = dL/d ln(alpha before the cap and the ramp)`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SplatMoments<S = f32>(pub(super) [S; SUMS]);

impl<S: Copy> SplatMoments<S> {
    /// `sum a`.
    pub(super) fn total(&self) -> S {
        self.0[0]
    }

    /// `sum a e`.
    pub(super) fn first(&self) -> [S; 2] {
        [self.0[1], self.0[2]]
    }

    /// `sum a e1^2`, `sum a e1 e2`, `sum a e2^2`.
    pub(super) fn second(&self) -> [S; 3] {
        [self.0[3], self.0[4], self.0[5]]
    }

    /// `dL/dcolour`.
    pub(super) fn colour(&self) -> [S; 3] {
        [self.0[6], self.0[7], self.0[8]]
    }

    /// Sum of the blended weight times the pixel's score.
    pub(super) fn score(&self) -> S {
        self.0[9]
    }
}

impl AddAssign<&Self> for SplatMoments {
    #[inline(always)]
    fn add_assign(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, v)| *sum += v);
    }
}

/// Inputs of the pass, the same for all tiles.
#[derive(Debug, Clone, Copy)]
pub(super) struct BackwardInput<'a> {
    pub(super) splats: &'a [Splat],
    pub(super) rules: RenderRules,
    pub(super) background: [f32; 3],
    pub(super) grid: TileGrid,
    /// The traced tiles of the forward pass.
    pub(super) tiles: &'a [f32],
    /// `dL/dcolour` of each pixel, row by row.
    pub(super) gradient: &'a [[f32; 3]],
    /// A value per pixel that is shared out among its splats.
    pub(super) score: &'a [f32],
}

/// One value for each pixel of a tile, block by block.
type Plane = [f32; PIXELS];

/// The pixels of a tile while layers are taken away, back to front.
struct BackwardTile {
    x: Plane,
    y: Plane,
    /// Light behind the next layer; after the layer, in front of it.
    light: Plane,
    /// `g .` the light that comes from behind.
    behind: Plane,
    gradient: [Plane; 3],
    score: Plane,
    /// Number of entries of the list up to the last blended one.
    last: Plane,
    /// The largest of `last` in each block.
    block_last: [usize; BLOCKS],
}

impl BackwardTile {
    /// The state behind the last layer. `planes` are those of the forward pass.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places are whole and small")]
    fn new(input: &BackwardInput<'_>, corner: [usize; 2], planes: &[f32]) -> Self {
        let nothing = [0.0; PIXELS];
        let mut tile = Self {
            x: nothing,
            y: nothing,
            light: [1.0; PIXELS],
            behind: nothing,
            gradient: [nothing; 3],
            score: nothing,
            last: nothing,
            block_last: [0; BLOCKS],
        };
        let [width, height] = [input.grid.size.width as usize, input.grid.size.height as usize];
        for i in 0..PIXELS {
            let [column, row] = pixel_place(i);
            let [x, y] = [corner[0] + column, corner[1] + row];
            [tile.x[i], tile.y[i]] = [x as f32 + 0.5, y as f32 + 0.5];
            // Pixels outside the image keep `last` at 0, so no layer counts there.
            if x >= width || y >= height {
                continue;
            }
            let plane = |n: usize| planes[n * PIXELS + row * TILE + column];
            [tile.light[i], tile.last[i]] = [plane(3), plane(4)];
            let g = input.gradient[y * width + x];
            let [r, g, b] = g;
            let [br, bg, bb] = input.background;
            tile.behind[i] = tile.light[i] * (r * br + g * bg + b * bb);
            [tile.gradient[0][i], tile.gradient[1][i], tile.gradient[2][i]] = [r, g, b];
            tile.score[i] = input.score[y * width + x];
            let last = &mut tile.block_last[i / LANES];
            *last = (*last).max(tile.last[i] as usize);
        }
        tile
    }
}

/// The moments of each entry of a tile's list. `runs` are the parts of the list, front to back, and
/// `out` has one place per entry, zero at first.
#[inline(always)]
pub(super) fn backward_tile<S: Simd, const SOFT: bool>(
    simd: S,
    input: &BackwardInput<'_>,
    index: usize,
    runs: &[&[u32]],
    out: &mut [SplatMoments],
) {
    let corner = [index % input.grid.columns * TILE, index / input.grid.columns * TILE];
    let stride = TRACED_PLANES * PIXELS;
    let mut tile = BackwardTile::new(input, corner, &input.tiles[index * stride..][..stride]);
    let end = tile.block_last.iter().copied().max().unwrap_or(0);
    // The same batches as in the forward pass, so that the masks cover the same blocks.
    let mut batches = Vec::new();
    let mut first = 0;
    for places in runs.iter().flat_map(|run| run.chunks(BATCH)) {
        if first < end {
            batches.push((first, places));
        }
        first += places.len();
    }
    let mut splats = [Splat::default(); BATCH];
    let mut shapes = BatchEllipses::default();
    for &(first, places) in batches.iter().rev() {
        for (near, &place) in splats.iter_mut().zip(places) {
            *near = input.splats[place as usize];
        }
        shapes.fill(&splats[..places.len()]);
        let masks = shapes.cover::<S>(simd, corner);
        let masks = open_masks(masks, first, &tile.block_last);
        for i in (0..places.len()).rev() {
            let blocks = blocks_of(&masks, i);
            if blocks != 0 {
                let layer = BackwardLayer { splat: &splats[i], place: (first + i + 1) as f32 };
                out[first + i] = layer.moments::<S, SOFT>(simd, input.rules, &mut tile, blocks);
            }
        }
    }
}

/// Clears the bits of layers behind the last blended one of each block.
#[inline(always)]
fn open_masks(mut masks: [u64; BLOCKS], first: usize, block_last: &[usize; BLOCKS]) -> [u64; BLOCKS] {
    for (mask, &last) in masks.iter_mut().zip(block_last) {
        let open = last.saturating_sub(first);
        // A shift by 64 would overflow.
        *mask &= if open >= BATCH { u64::MAX } else { (1 << open) - 1 };
    }
    masks
}

/// The blocks that layer `i` of a batch may touch: bit `b` belongs to block `b`.
#[inline(always)]
fn blocks_of(masks: &[u64; BLOCKS], i: usize) -> u32 {
    let mut blocks = 0;
    for (b, mask) in masks.iter().enumerate() {
        blocks |= ((mask >> i & 1) as u32) << b;
    }
    blocks
}

/// A layer that is taken away.
struct BackwardLayer<'a> {
    splat: &'a Splat,
    /// Its place in the tile's list, counted from 1.
    place: f32,
}

impl BackwardLayer<'_> {
    /// The moments over these blocks. The light and what comes from behind move to the front of the
    /// layer.
    #[inline(always)]
    fn moments<S: Simd, const SOFT: bool>(
        &self,
        simd: S,
        rules: RenderRules,
        tile: &mut BackwardTile,
        mut blocks: u32,
    ) -> SplatMoments {
        let all = |v: f32| f32x16::splat(simd, v);
        let (zero, one) = (all(0.0), all(1.0));
        let Splat { mean, w: [w1, w2, w3], opacity, features, .. } = *self.splat;
        let least = least_alpha(rules);
        let mut sums = [zero; SUMS];
        while blocks != 0 {
            let block = blocks.trailing_zeros() as usize;
            blocks &= blocks - 1;
            let range = block * LANES..(block + 1) * LANES;
            let load = |plane: &Plane| f32x16::from_slice(simd, &plane[range.clone()]);
            // The operations of the forward pass in its order, so that the opacity has its bits.
            let (dx, dy) = (load(&tile.x) - mean[0], load(&tile.y) - mean[1]);
            let (e1, e2) = (dx * w1 + dy * w2, dy * w3);
            let free = exp2_neg(simd, e1 * e1 + e2 * e2) * opacity;
            let mut alpha = free.min(MAX_ALPHA);
            let counts = alpha.simd_ge(least) & load(&tile.last).simd_ge(self.place);
            alpha = counts.select(alpha, zero);
            // A capped opacity is constant.
            let mut slope = free.simd_lt(MAX_ALPHA).select(alpha, zero);
            if SOFT {
                let (ramp, ramp_slope) = soft_ramp(simd, alpha);
                // The derivative of `alpha ramp(alpha)` by `ln alpha`. That of a capped opacity stays 0.
                slope *= ramp + alpha * ramp_slope;
                alpha *= ramp;
            }
            // At most 0.99 is taken away, so the divisor is at least 0.01.
            let back = one / (one - alpha);
            let light = load(&tile.light) * back;
            let weight = light * alpha;
            let g = [load(&tile.gradient[0]), load(&tile.gradient[1]), load(&tile.gradient[2])];
            let lit = g[0] * features[0] + g[1] * features[1] + g[2] * features[2];
            let behind = load(&tile.behind);
            let a = (light * lit - behind * back) * slope;
            light.store_slice(&mut tile.light[range.clone()]);
            (behind + weight * lit).store_slice(&mut tile.behind[range.clone()]);
            let (a1, a2) = (a * e1, a * e2);
            let more = [
                a,
                a1,
                a2,
                a1 * e1,
                a1 * e2,
                a2 * e2,
                weight * g[0],
                weight * g[1],
                weight * g[2],
                weight * load(&tile.score),
            ];
            for (sum, more) in sums.iter_mut().zip(more) {
                *sum += more;
            }
        }
        SplatMoments::from_lanes(sums)
    }
}

impl SplatMoments {
    /// The sums over all lanes.
    #[inline(always)]
    fn from_lanes<S: Simd>(sums: [f32x16<S>; SUMS]) -> Self {
        let mut moments = Self::default();
        // Loops and no closures over arrays in this file: the compiler may leave those as calls, around
        // which all registers are saved.
        for (moment, sum) in moments.0.iter_mut().zip(sums) {
            *moment = lane_sum(sum);
        }
        moments
    }
}

/// The sum of the lanes, by halves: the same order for every instruction set.
#[inline(always)]
fn lane_sum<S: Simd>(lanes: f32x16<S>) -> f32 {
    let mut v = [0.0; LANES];
    lanes.store_slice(&mut v);
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            v[i] += v[i + half];
        }
        half /= 2;
    }
    v[0]
}
