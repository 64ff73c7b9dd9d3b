//! Eight draws at a time, with the same bits as `Seed::draws` one by one.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::eight::SeedCells;
//! use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
//!
//! let cells = SeedCells { seed: Seed(7), space: DrawSpace::Leak, level: 0, index: 4 };
//! // Pixels (3, 5) and (4, 5), as `y << 16 | x`.
//! let mut normals = Vec::new();
//! cells.first_normals(&[5 << 16 | 3, 5 << 16 | 4], &mut normals);
//! // The same bits as one by one.
//! let one = |x| Seed(7).draws(SeedCell { x, y: 5, level: 0, index: 4 }, DrawSpace::Leak).normal();
//! assert_eq!(normals, [one(3), one(4)]);
//! ```

use super::{CellDraws, DrawSpace, Seed, SeedCell, normal, philox, space_tag};
use crate::elementary::{self, load_eight, mask_bits, set_lanes, store_eight, to_float};
use fearless_simd::{Level, Simd, SimdBase as _, SimdFloat as _, dispatch, f64x8, u64x8};

/// Cells of eight pixels that differ in the pixel only.
#[derive(Debug, Clone, Copy)]
pub struct SeedCells {
    /// Seed of the stream.
    pub seed: Seed,
    /// Purpose of the draws.
    pub space: DrawSpace,
    /// As in [`SeedCell`].
    pub level: u8,
    /// As in [`SeedCell`].
    pub index: u64,
}

impl SeedCells {
    /// Draws `2 block` and `2 block + 1` for the cells of these pixels (`y << 16 | x`).
    #[inline(always)]
    pub fn pair<S: Simd>(self, pixels: u64x8<S>, block: u32) -> [u64x8<S>; 2] {
        let all = |v: u64| u64x8::splat(pixels.simd, v);
        // The same fields as in `block_counter`, so that both ways give the same bits.
        let third = u64::from(space_tag(self.level, self.space)) << 24 | self.index >> 32;
        let counter = [pixels, all(self.index & philox::LOW), all(third), all(block.into())];
        let [a, b, c, d] = philox::philox_eight(counter, self.seed.key());
        // Low word first, as in `half_block`.
        [b << 32 | a, d << 32 | c]
    }

    /// The first draw of each of these pixels as a standard normal deviate, with the bits of
    /// [`CellDraws::normal`].
    pub fn first_normals(self, pixels: &[u64], normals: &mut Vec<f64>) {
        #[inline(always)]
        fn fill<S: Simd>(simd: S, cells: SeedCells, pixels: &[u64], normals: &mut [f64]) {
            for (i, pixels) in (0..).step_by(8).zip(pixels.chunks(8)) {
                // Lanes beyond the last pixel repeat it.
                let place = |lane: usize| pixels[lane.min(pixels.len() - 1)];
                let [draw, _] = cells.pair(u64x8::from_fn(simd, place), 0);
                store_eight(uniform_eight(draw), normals, i);
            }
            normal_deviates(simd, normals);
        }
        normals.clear();
        normals.resize(pixels.len().next_multiple_of(8), 0.0);
        dispatch!(Level::new(), simd => fill(simd, self, pixels, normals));
        normals.truncate(pixels.len());
    }

    /// The draws of one of these cells, with the first four computed in advance.
    #[inline(always)]
    pub fn go_on(self, pixel: u64, first: [u64; 4]) -> CellDraws {
        let Self { seed, space, level, index } = self;
        let cell = SeedCell { x: (pixel & 0xffff) as u16, y: (pixel >> 16 & 0xffff) as u16, level, index };
        CellDraws { first, known: 4, ..seed.draws(cell, space) }
    }
}

/// The upper 52 bits as numbers strictly between 0 and 1.
#[inline(always)]
pub fn uniform_eight<S: Simd>(draws: u64x8<S>) -> f64x8<S> {
    (to_float(draws >> 12) + 0.5) * super::STEP
}

/// Number of deviates from which the tails are gathered at once.
const CHUNK: usize = 64;

/// Turns uniforms into standard normal deviates in place. The length is a multiple of 8.
#[inline(always)]
pub fn normal_deviates<S: Simd>(simd: S, values: &mut [f64]) {
    for chunk in values.chunks_mut(CHUNK) {
        chunk_of_normals(simd, chunk);
    }
}

/// The middle of the distribution needs no logarithm. The tails, a seventh of all draws, are
/// processed separately.
#[expect(clippy::cast_possible_truncation, reason = "places in a chunk of 64")]
#[inline(always)]
fn chunk_of_normals<S: Simd>(simd: S, values: &mut [f64]) {
    // Eight more places than values, because a compressed vector is stored whole.
    let (mut tail_places, mut tails, mut count) = ([0; CHUNK + 8], [0.5; CHUNK + 8], 0);
    let lanes = u64x8::from_fn(simd, |lane| lane as u64);
    for start in (0..values.len()).step_by(8) {
        let p = load_eight(simd, values, start);
        let q = p - 0.5;
        let far = q.abs().simd_gt(normal::CENTRE);
        // Without a branch, because a processor would mispredict it often.
        simd.compress_u64x8(lanes + start as u64, far).store_slice(&mut tail_places[count..count + 8]);
        store_eight(simd.compress_f64x8(p, far), &mut tails, count);
        count += mask_bits(far).count_ones() as usize;
        // For all lanes. The tails among them are overwritten below.
        let r = f64x8::splat(simd, normal::CENTRE_SQUARE) - q * q;
        let z = q * normal::polynomial_eight(&normal::CENTRE_NUMERATOR, r)
            / normal::polynomial_eight(&normal::CENTRE_DENOMINATOR, r);
        store_eight(z, values, start);
    }
    // Padding after the last tail. The value 1/2 takes no rare branch.
    store_eight(f64x8::splat(simd, 0.5), &mut tails, count);
    for start in (0..count).step_by(8) {
        let z = tail_eight(load_eight(simd, &tails, start));
        for i in start..count.min(start + 8) {
            values[tail_places[i] as usize] = z[i - start];
        }
    }
}

#[inline(always)]
fn tail_eight<S: Simd>(p: f64x8<S>) -> f64x8<S> {
    let q = p - 0.5;
    let nearer = p.min(f64x8::splat(p.simd, 1.0) - p);
    let r = (-elementary::ln_eight(nearer)).sqrt();
    let s = r - normal::FAR_CENTRE[0];
    let z = normal::polynomial_eight(&normal::MIDDLE_NUMERATOR, s)
        / normal::polynomial_eight(&normal::MIDDLE_DENOMINATOR, s);
    let mut z = z.copysign(q);
    // Three draws in 10^11, so each is computed alone.
    for i in set_lanes(mask_bits(r.simd_gt(normal::FAR))) {
        z[i] = normal::normal_quantile(p[i]);
    }
    z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_normals_are_those_of_one_at_a_time() {
        let cells = SeedCells { seed: Seed(9), space: DrawSpace::Leak, level: 0, index: 70_000_000_000 };
        for count in [0, 1, 8, 700] {
            let pixels: Vec<u64> = (0..count).map(|i| (i % 41) << 16 | i).collect();
            let mut found = vec![1.0; 3];
            cells.first_normals(&pixels, &mut found);
            let cell = |pixel: &u64| {
                let [x, y] = [pixel & 0xffff, pixel >> 16].map(|v| u16::try_from(v).expect("small"));
                SeedCell { x, y, level: 0, index: cells.index }
            };
            let one = |pixel: &u64| cells.seed.draws(cell(pixel), cells.space).normal();
            assert_eq!(found, pixels.iter().map(one).collect::<Vec<f64>>());
        }
    }

    #[test]
    fn draws_are_those_of_one_at_a_time() {
        let (level, index) = (3, 0x0012_3456_789a);
        for space in [DrawSpace::Tree, DrawSpace::Leaf] {
            let cells = SeedCells { seed: Seed(0xfeed_0123_4567), space, level, index };
            let pixels: [u64; 8] = [0, 1, 0xffff, 0xffff_ffff, 7 << 16, 0x1234_5678, 42, 3];
            let pairs: [[[u64; 8]; 2]; 2] = dispatch!(Level::new(), simd => {
                let pixels = u64x8::from_slice(simd, &pixels);
                [0, 1].map(|block| cells.pair(pixels, block).map(Into::into))
            });
            for (i, pixel) in pixels.into_iter().enumerate() {
                let cell =
                    SeedCell { x: (pixel & 0xffff) as u16, y: (pixel >> 16 & 0xffff) as u16, level, index };
                let mut draws = cells.seed.draws(cell, space);
                let first = pairs.as_flattened().iter().map(|draw| draw[i]).collect::<Vec<_>>();
                let mut going_on = cells.go_on(pixel, first.clone().try_into().unwrap());
                for number in 0..9 {
                    let wanted = draws.bits();
                    assert_eq!((going_on.bits(), *first.get(number).unwrap_or(&wanted)), (wanted, wanted));
                }
            }
        }
    }

    #[test]
    fn normals_are_those_of_one_at_a_time() {
        let least = 0.5 * super::super::STEP;
        let even = (0..4000u32).map(|i| (f64::from(i) + 0.5) / 4000.0);
        let all: Vec<f64> = even.chain([least, 1.0 - least, 1e-12, 0.075, 0.925, 0.5, 1e-4, 1e-9]).collect();
        let mut found = all.clone();
        dispatch!(Level::new(), simd => normal_deviates(simd, &mut found));
        for (p, found) in all.into_iter().zip(found) {
            assert_eq!(found.to_bits(), normal::normal_quantile(p).to_bits(), "{p:e}");
        }
    }
}
