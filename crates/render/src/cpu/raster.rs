//! Pass 4: blends each tile's splats, front to back.
//!
//! ```text
//! tile of 16x16 px       batch of 64 splats          block of 4x4 px
//! +---+---+---+---+      fill:  copy the splats      16 lanes: light, sums, rates
//! |   |   |   |   |      cover: one mask per block   blend: one splat after the other
//! +---+---+---+---+             bit i = splat i      store: back to the tile's planes
//! |   | # | # |   |
//! +---+---+---+---+      # blocks that splat i may touch
//! ```
//!
//! A splat's list entry says only that it touches the tile. Most splats are smaller than a tile, so
//! a mask per block saves most of the work: a block visits the splats of its own mask and skips the
//! others without loading them. The state of a block (position, light, sums) stays in vector
//! registers for a whole batch. That is one register per value with AVX-512, and several with
//! narrower sets, where the independent halves hide each other's latency.
//!
//! The order of operations at a pixel does not depend on tiles, batches or the instruction set, so
//! the image is the same on every machine.

mod blended;
pub(super) mod block;
pub(super) mod cover;

use super::bin::{TileGrid, TileLists};
use super::splat::{Splat, SplatRates};
use crate::dual::DualNumber;
use crate::sample::TileSample;
use crate::shared::TILE;
use crate::{LayerOrder, OmissionPolicy, RenderRules, RenderWork};
use block::TilePixels;
use cover::BatchEllipses;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

/// Pixels of a tile.
pub(super) const PIXELS: usize = TILE * TILE;

/// Edge of a block, px.
const SIDE: usize = 4;

/// Pixels of a block.
pub(super) const LANES: usize = SIDE * SIDE;

/// Blocks of a tile.
pub(super) const BLOCKS: usize = PIXELS / LANES;

/// Number of splats in a batch: the bits of a mask. A tile checks after each batch whether all its
/// pixels are finished.
pub(super) const BATCH: usize = 64;

/// The input of the pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct RasterInput<'a> {
    /// Projected Gaussians.
    pub(super) splats: &'a [Splat],
    /// The splats' rates. If rates were not requested, it is empty or that of an earlier frame.
    pub(super) rates: &'a [SplatRates],
    /// The lists of the tiles.
    pub(super) lists: &'a TileLists,
    /// The tiles.
    pub(super) grid: TileGrid,
    /// The tiles that are read, if not all are.
    pub(super) sample: Option<&'a TileSample>,
    /// The rules.
    pub(super) rules: RenderRules,
    /// The order in which layers are blended.
    pub(super) order: LayerOrder,
    /// Work that the pass may skip.
    pub(super) omit: OmissionPolicy,
    /// The instruction set.
    pub(super) level: Level,
}

/// Number of planes of a tile: one per feature, the transmittance, and two rates if they are
/// wanted.
pub(super) fn plane_count(features: usize, rate: bool) -> usize {
    features + 1 + 2 * usize::from(rate)
}

/// Blends every tile with `N` features per splat. `SOFT` fades layers in, `RATE` computes the rate
/// of the luminance. A tile's part of `out` is [`plane_count`] of [`PIXELS`] values: the sums of
/// weight times feature, the transmittance, then the rates of luminance and transmittance.
pub(super) fn raster_tiles<const N: usize, const SOFT: bool, const RATE: bool>(
    frame: RasterInput<'_>,
    out: &mut Vec<f32>,
) -> RenderWork {
    let stride = plane_count(N, RATE) * PIXELS;
    let blend = |index: usize, out: &mut [f32]| match (frame.order, RATE) {
        (LayerOrder::Depth, _) => {
            dispatch!(frame.level, simd => blend_tile::<_, N, SOFT, RATE, false>(simd, frame, index, out))
        }
        (LayerOrder::Blended, false) => {
            dispatch!(frame.level, simd => blended::blend_tile_smoothly::<_, f32, N>(simd, frame, index, out))
        }
        (LayerOrder::Blended, true) => {
            dispatch!(frame.level, simd => blended::blend_tile_smoothly::<_, DualNumber<f32>, N>(simd, frame, index, out))
        }
    };
    each_tile(frame, stride, out, blend)
}

/// Planes of a traced tile: the three colours, the transmittance, and the number of entries of the
/// tile's list up to the last one that was blended at the pixel.
pub(super) const TRACED_PLANES: usize = 5;

/// [`raster_tiles`] of three colours in order of depth, with the same bits, and the trace that the
/// gradients need ([`TRACED_PLANES`]).
pub(super) fn raster_traced(frame: RasterInput<'_>, out: &mut Vec<f32>) -> RenderWork {
    let soft = frame.rules == RenderRules::Soft;
    let blend = |index: usize, out: &mut [f32]| {
        if soft {
            dispatch!(frame.level, simd => blend_tile::<_, 3, true, false, true>(simd, frame, index, out))
        } else {
            dispatch!(frame.level, simd => blend_tile::<_, 3, false, false, true>(simd, frame, index, out))
        }
    };
    each_tile(frame, TRACED_PLANES * PIXELS, out, blend)
}

/// Blends every tile of the band. A tile's part of `out` has `stride` values.
fn each_tile(
    frame: RasterInput<'_>,
    stride: usize,
    out: &mut Vec<f32>,
    blend: impl Fn(usize, &mut [f32]) -> RenderWork + Sync + Send,
) -> RenderWork {
    // Every tile of a band is stored as a whole, so old values need no clearing.
    out.resize(frame.grid.len() * stride, 0.0);
    let band = frame.lists.band();
    out.par_chunks_mut(stride)
        .enumerate()
        .skip(band.start)
        .take(band.len())
        .map(|(index, out)| match frame.sample.is_none_or(|sample| sample.has(index)) {
            true => blend(index, out),
            false => {
                // Its pixels are not read, but images are checked for values that are not finite.
                out.fill(0.0);
                RenderWork::default()
            }
        })
        // The counts are integers, so the order in which tasks are joined does not show.
        .reduce(RenderWork::default, |mut a, b| {
            a += b;
            a
        })
}

/// The next splats of a tile, copied out of the frame's array.
struct SplatBatch {
    /// Place of the first one in the tile's list.
    first: usize,
    splats: [Splat; BATCH],
    rates: [SplatRates; BATCH],
    shapes: BatchEllipses,
}

impl SplatBatch {
    /// Copies the splats at `places`. Most of these reads miss the cache; a plain copy loop lets
    /// them overlap, where the blending loop would wait for each.
    #[inline(always)]
    fn fill<const RATE: bool>(&mut self, frame: RasterInput<'_>, places: &[u32]) {
        for (near, &place) in self.splats.iter_mut().zip(places) {
            *near = frame.splats[place as usize];
        }
        // Without rates, their array may be empty or that of an earlier frame.
        if RATE {
            for (near, &place) in self.rates.iter_mut().zip(places) {
                *near = frame.rates[place as usize];
            }
        }
        self.shapes.fill(&self.splats[..places.len()]);
    }
}

/// Blends one tile. This function and all that it calls are inlined into one copy per instruction
/// set.
#[inline(always)]
fn blend_tile<S: Simd, const N: usize, const SOFT: bool, const RATE: bool, const TRACE: bool>(
    simd: S,
    frame: RasterInput<'_>,
    index: usize,
    out: &mut [f32],
) -> RenderWork {
    let corner = [index % frame.grid.columns * TILE, index / frame.grid.columns * TILE];
    let mut pixels = TilePixels::<N>::new(corner, frame.grid.size, frame.rules);
    let mut batch = SplatBatch {
        first: 0,
        splats: [Splat::default(); BATCH],
        rates: [SplatRates::default(); BATCH],
        shapes: BatchEllipses::default(),
    };
    let mut work = RenderWork::default();
    // With nothing to omit, finished blocks are blended too. Their pixels stay as they are.
    let whole = frame.omit == OmissionPolicy::Nothing;
    let (mut batches, mut room) = (frame.lists.batches(index), [0; BATCH]);
    while let Some(places) = batches.next(&mut room) {
        // Nothing behind an opaque tile can change it, so the rest of the list is only counted.
        if pixels.is_finished() && !whole {
            work.hidden += places.len() as u64;
            batch.first += places.len();
            continue;
        }
        batch.fill::<RATE>(frame, places);
        let masks = batch.shapes.cover::<S>(simd, corner);
        for (b, &mask) in masks.iter().enumerate() {
            if mask != 0 && (whole || pixels.is_open(b)) {
                pixels.blend::<S, SOFT, RATE, TRACE>(simd, b, &batch, mask);
            }
        }
        batch.first += places.len();
    }
    pixels.store::<TRACE>(out);
    pixels.count(&mut work);
    work
}
