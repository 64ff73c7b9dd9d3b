//! Pass 4: blends each tile's splats, front to back.
//!
//! A tile is cut into blocks of 4x4 pixels. Splats come in batches: `cover` says which of a batch may touch which
//! block, and `block` blends those of one block while its pixels stay in registers: in one of AVX-512, in several of
//! the others, whose operations then need not wait for one another.

mod blended;
mod block;
mod cover;

use super::bin::{Grid, Lists};
use super::splat::{Rates, Splat};
use crate::render::dual::Dual;
use crate::render::shared::TILE;
use crate::render::{Layering, Omit, Rules, Work};
use block::Pixels;
use cover::Shapes;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

/// Pixels of a tile.
pub(super) const PIXELS: usize = TILE * TILE;

/// Edge of a block, px.
const SIDE: usize = 4;

/// Pixels of a block.
const LANES: usize = SIDE * SIDE;

/// Blocks of a tile.
const BLOCKS: usize = PIXELS / LANES;

/// Splats between two looks at whether a tile is finished: as many as a mask has bits.
const BATCH: usize = 64;

/// What the pass reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    /// Projected Gaussians.
    pub(super) splats: &'a [Splat],
    /// Their rates, where they are asked for.
    pub(super) rates: &'a [Rates],
    /// The lists of the tiles.
    pub(super) lists: &'a Lists,
    /// The tiles.
    pub(super) grid: Grid,
    /// The rules.
    pub(super) rules: Rules,
    /// How layers lie.
    pub(super) order: Layering,
    /// What is left out.
    pub(super) omit: Omit,
    /// The instruction set.
    pub(super) level: Level,
}

/// Planes of a tile with so many features, and the rates of luminance and of the light behind, or without.
pub(super) fn planes(features: usize, rate: bool) -> usize {
    features + 1 + 2 * usize::from(rate)
}

/// Blends every tile with `N` features a splat; `SOFT` where layers fade in, `RATE` where luminance's rate is wanted. A
/// tile's part of `out` is [`planes`] of [`PIXELS`] values: the sums of weight times feature, what is left of the light
/// behind, then the rates of luminance and of that.
pub(super) fn run<const N: usize, const SOFT: bool, const RATE: bool>(
    frame: Frame<'_>,
    out: &mut Vec<f32>,
) -> Work {
    let stride = planes(N, RATE) * PIXELS;
    out.resize(frame.grid.len() * stride, 0.0);
    let band = frame.lists.band();
    out.par_chunks_mut(stride)
        .enumerate()
        .skip(band.start)
        .take(band.len())
        .map(|(index, out)| match (frame.order, RATE) {
            (Layering::Depth, _) => {
                dispatch!(frame.level, simd => blend::<_, N, SOFT, RATE>(simd, frame, index, out))
            }
            (Layering::Blended, false) => {
                dispatch!(frame.level, simd => blended::one::<_, f32, N>(simd, frame, index, out))
            }
            (Layering::Blended, true) => {
                dispatch!(frame.level, simd => blended::one::<_, Dual<f32>, N>(simd, frame, index, out))
            }
        })
        .reduce(Work::default, |mut a, b| {
            a += b;
            a
        })
}

/// The splats of a tile that are blended next.
struct Batch {
    splats: [Splat; BATCH],
    rates: [Rates; BATCH],
    shapes: Shapes,
}

impl Batch {
    /// Takes the next splats of a list. Copied at once: reads that do not wait for one another overlap, and most of
    /// them miss the cache.
    #[inline(always)]
    fn fill<const RATE: bool>(&mut self, frame: Frame<'_>, places: &[u32]) {
        for (near, &place) in self.splats.iter_mut().zip(places) {
            *near = frame.splats[place as usize];
        }
        if RATE {
            for (near, &place) in self.rates.iter_mut().zip(places) {
                *near = frame.rates[place as usize];
            }
        }
        self.shapes.fill(&self.splats[..places.len()]);
    }
}

/// One tile. Inlined, as is all that it calls, into a function for each instruction set.
#[inline(always)]
fn blend<S: Simd, const N: usize, const SOFT: bool, const RATE: bool>(
    simd: S,
    frame: Frame<'_>,
    index: usize,
    out: &mut [f32],
) -> Work {
    let corner = [index % frame.grid.columns * TILE, index / frame.grid.columns * TILE];
    let mut pixels = Pixels::<N>::new(corner, frame.grid.size, frame.rules);
    let mut batch = Batch {
        splats: [Splat::default(); BATCH],
        rates: [Rates::default(); BATCH],
        shapes: Shapes::default(),
    };
    let mut work = Work::default();
    let whole = frame.omit == Omit::Nothing;
    for run in frame.lists.of(index) {
        for places in run.chunks(BATCH) {
            if pixels.is_finished() && !whole {
                work.hidden += places.len() as u64;
                continue;
            }
            batch.fill::<RATE>(frame, places);
            let masks = batch.shapes.cover::<S>(simd, corner);
            for (b, &mask) in masks.iter().enumerate() {
                if mask != 0 && (whole || pixels.is_open(b)) {
                    pixels.blend::<S, SOFT, RATE>(simd, b, &batch, mask);
                }
            }
        }
    }
    pixels.store(out);
    pixels.count(&mut work);
    work
}
