//! The blocks of a tile that each splat of a batch may touch.
//!
//! ```text
//!   row y  ----(  middle - reached ... middle + reached  )----
//! ```
//!
//! On one row of pixels an ellipse covers an interval. A splat may touch a block if the union of
//! the intervals of the block's four rows meets the block's columns. The test is conservative:
//! rounding may add a block, and a margin makes sure that it never drops one. Lanes are splats, so
//! one pass over the rows serves a full vector of them.

#![expect(clippy::cast_precision_loss, reason = "pixel coordinates are small")]

use super::{BATCH, BLOCKS, SIDE};
use crate::cpu::splat::{MARGIN, Splat};
use crate::shared::TILE;
use fearless_simd::{Select as _, Simd, SimdBase as _, SimdFloat as _, SimdMask as _};

/// The ellipses of a batch, one array per parameter.
pub(in crate::cpu) struct BatchEllipses {
    mean: [[f32; BATCH]; 2],
    w: [[f32; BATCH]; 3],
    reach: [f32; BATCH],
}

impl Default for BatchEllipses {
    fn default() -> Self {
        // Unused places are divided by `w1` too. With 1 their values stay finite.
        Self { mean: [[0.0; BATCH]; 2], w: [[1.0; BATCH]; 3], reach: [-1.0; BATCH] }
    }
}

impl BatchEllipses {
    /// Copies the ellipses of a batch. Unused places get a negative reach, which touches nothing.
    #[inline(always)]
    pub(in crate::cpu) fn fill(&mut self, splats: &[Splat]) {
        // The pixel ranges of the rules are not needed: they hold the whole ellipse, or end at the
        // edges of tiles, which the lists observe already.
        for (i, splat) in splats.iter().enumerate() {
            [self.mean[0][i], self.mean[1][i]] = splat.mean;
            [self.w[0][i], self.w[1][i], self.w[2][i]] = splat.w;
            self.reach[i] = splat.reach;
        }
        self.reach[splats.len()..].fill(-1.0);
    }

    /// For each block of the tile at `corner`, a mask of the splats that may touch it: bit `i`
    /// belongs to splat `i`.
    #[inline(always)]
    pub(in crate::cpu) fn cover<S: Simd>(&self, simd: S, corner: [usize; 2]) -> [u64; BLOCKS] {
        let mut masks = [0; BLOCKS];
        // `BATCH` is a multiple of every vector's length.
        for first in (0..BATCH).step_by(S::f32s::LEN) {
            self.cover_some::<S>(simd, corner, first, &mut masks);
        }
        masks
    }

    /// Does the work of [`Self::cover`] for one vector of splats, from `first` on. The interval on
    /// a row is [`Splat::chord`].
    #[inline(always)]
    fn cover_some<S: Simd>(&self, simd: S, corner: [usize; 2], first: usize, masks: &mut [u64; BLOCKS]) {
        let load = |from: &[f32; BATCH]| S::f32s::from_slice(simd, &from[first..first + S::f32s::LEN]);
        let [mean_x, mean_y] = [load(&self.mean[0]), load(&self.mean[1])];
        let [w1, w2, w3] = [load(&self.w[0]), load(&self.w[1]), load(&self.w[2])];
        let reach = load(&self.reach);
        // One division serves all rows.
        let inverse = S::f32s::splat(simd, 1.0) / w1;
        let slope = w2 * inverse;
        let (zero, nothing) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, f32::NEG_INFINITY));
        for (k, masks) in masks.chunks_exact_mut(TILE / SIDE).enumerate() {
            let [mut begin, mut end] = [-nothing, nothing];
            for y in k * SIDE..(k + 1) * SIDE {
                let dy = S::f32s::splat(simd, (corner[1] + y) as f32 + 0.5) - mean_y;
                let e2 = w3 * dy;
                let room = reach - e2 * e2;
                let half = room.max(zero).sqrt() * inverse;
                let shift = slope * dy;
                let reached = half + (half + shift.abs()) * MARGIN[1] + MARGIN[0];
                // The ellipse misses this row: an interval of minus infinity cannot widen the
                // union.
                let reached = room.simd_ge(zero).select(reached, nothing);
                let middle = mean_x - shift;
                begin = begin.min(middle - reached);
                end = end.max(middle + reached);
            }
            for (j, mask) in masks.iter_mut().enumerate() {
                let left = (corner[0] + j * SIDE) as f32 + 0.5;
                let right = left + (SIDE - 1) as f32;
                let hit = begin.simd_le(right) & end.simd_ge(left);
                *mask |= hit.to_bitmask() << first;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::InstructionSet;
    use crate::cpu::raster::PIXELS;
    use crate::cpu::splat::tests::{EDGE, counts, planted};
    use fearless_simd::dispatch;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::array::from_fn;

    /// The bits of the blocks by every instruction set.
    fn by_each(shapes: &BatchEllipses, corner: [usize; 2]) -> Vec<[u64; BLOCKS]> {
        let sets = InstructionSet::available_sets();
        sets.iter().map(|set| dispatch!(set.level, simd => shapes.cover(simd, corner))).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            rng_seed: RngSeed::Fixed(8),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// No block is left out that has a pixel that counts, and no splat takes the bit of
        /// another.
        #[test]
        fn every_block_with_a_pixel_that_counts(found in prop::collection::vec(planted(), 20)) {
            let splats: Vec<Splat> = found.into_iter().flatten().collect();
            let mut shapes = BatchEllipses::default();
            shapes.fill(&splats);
            for corner in [[0, 0], [TILE, 2 * TILE], [usize::from(EDGE) - TILE, TILE]] {
                for masks in by_each(&shapes, corner) {
                    prop_assert!(masks.iter().all(|mask| mask >> splats.len() == 0));
                    for (i, splat) in splats.iter().enumerate() {
                        for (x, y) in (0..PIXELS).map(|k| (k % TILE, k / TILE)) {
                            let covered = masks[y / SIDE * (TILE / SIDE) + x / SIDE] >> i & 1 == 1;
                            let [px, py] = [corner[0] + x, corner[1] + y].map(|v| u16::try_from(v).expect("small"));
                            prop_assert!(covered || !counts(splat, px, py), "{splat:?} at ({px}, {py})");
                        }
                    }
                }
            }
        }
    }

    /// A dot of half a pixel in the middle of a block touches no other.
    #[test]
    fn a_dot_touches_one_block() {
        let dot = Splat { mean: [18.0, 22.0], w: [2.0, 0.0, 2.0], reach: 4.0, ..Splat::default() };
        let mut shapes = BatchEllipses::default();
        shapes.fill(&[dot]);
        for masks in by_each(&shapes, [TILE, TILE]) {
            // a reach of 1 px: columns 17 and 18, rows 21 and 22, all in the first column and the
            // second row of blocks
            assert_eq!(masks.map(|mask| mask == 1), from_fn(|b| b == 4), "{masks:?}");
        }
    }
}
