//! Pass 2: one front-to-back order for the whole frame.
//!
//! The order of the frame before is of no help. At 2,400 frames a second and 0.3 rad/s around 500,000 Gaussians each
//! moves by 10 places, and mending that (insertion) takes three times as long as ordering from nothing; where few
//! enough move, with tens of thousands of Gaussians, both take less than a hundredth of the frame.

#![expect(clippy::cast_possible_truncation, reason = "keys are taken apart into 32-bit halves and digits")]

use super::project::{CHUNK, Projected};
use super::splat::Splat;
use rayon::prelude::*;

/// The most bits of a digit: its counts stay in the nearest cache, and two digits hold the depths of most frames.
const DIGIT_BITS: u32 = 13;

/// Orders splats by the bits of their depth, ties by their place in the file.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    /// Depth bits above the splat's place.
    keys: Vec<u64>,
    spare: Vec<u64>,
}

impl Sorter {
    /// The order of the splats that the projection left: one key each, its low half the splat's place.
    pub(super) fn run(&mut self, splats: &[Splat], chunks: &[Projected]) -> &[u64] {
        let [low, high] = self.lay_down(splats, chunks);
        let bits = u32::BITS - high.saturating_sub(low).leading_zeros();
        let passes = bits.div_ceil(DIGIT_BITS);
        self.spare.resize(self.keys.len(), 0);
        for pass in 0..passes {
            let width = bits.div_ceil(passes);
            self.by_digit(|key| (((key >> 32) as u32 - low) >> (width * pass)) as usize & ((1 << width) - 1));
        }
        &self.keys
    }

    /// Lays down the keys in file order; returns the bits of the least and the largest depth.
    fn lay_down(&mut self, splats: &[Splat], chunks: &[Projected]) -> [u32; 2] {
        self.keys.resize(chunks.iter().map(|chunk| chunk.drawn).sum(), 0);
        let mut rest = self.keys.as_mut_slice();
        let keys = chunks.iter().map(|c| rest.split_off_mut(..c.drawn).expect("as many as are drawn"));
        let keys: Vec<&mut [u64]> = keys.collect();
        let lay = |(k, keys): (usize, &mut [u64])| {
            let mut ends = [u32::MAX, 0];
            for ((place, splat), key) in splats.iter().enumerate().skip(k * CHUNK).zip(keys) {
                let depth = splat.depth.to_bits();
                ends = [ends[0].min(depth), ends[1].max(depth)];
                *key = u64::from(depth) << 32 | place as u64;
            }
            ends
        };
        let ends = keys.into_par_iter().enumerate().map(lay);
        ends.reduce(|| [u32::MAX, 0], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// One stable counting sort. Depths are positive, so their bits are in the order of their values; and as keys
    /// were laid down in file order, a stable sort by depth alone leaves ties in it.
    fn by_digit(&mut self, digit: impl Fn(u64) -> usize) {
        let mut starts = [0_u32; 1 << DIGIT_BITS];
        for &key in &self.keys {
            starts[digit(key)] += 1;
        }
        let mut start = 0;
        for count in &mut starts {
            (*count, start) = (start, start + *count);
        }
        for &key in &self.keys {
            let place = &mut starts[digit(key)];
            self.spare[*place as usize] = key;
            *place += 1;
        }
        std::mem::swap(&mut self.keys, &mut self.spare);
    }
}

/// The splat's place that a key ends in.
pub(super) fn place(key: u64) -> u32 {
    key as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(depths: &[f32]) {
        let splats: Vec<Splat> = depths.iter().map(|&depth| Splat { depth, ..Splat::default() }).collect();
        // the last of each chunk is not drawn
        let chunks: Vec<Projected> = splats
            .chunks(CHUNK)
            .map(|chunk| Projected { drawn: chunk.len() - 1, ..Projected::default() })
            .collect();
        let drawn = |i: &usize| i % CHUNK + 1 < CHUNK && i + 1 < depths.len();
        let mut wanted: Vec<usize> = (0..depths.len()).filter(drawn).collect();
        wanted.sort_by(|&a, &b| depths[a].total_cmp(&depths[b]));
        let mut sorter = Sorter::default();
        // twice, since buffers are used again
        for _ in 0..2 {
            let order = sorter.run(&splats, &chunks);
            let order: Vec<usize> = order.iter().map(|&key| place(key) as usize).collect();
            assert!(order == wanted, "not as std's stable sort has it");
        }
    }

    #[test]
    fn depths_ascend_and_ties_follow_the_file() {
        // few distinct values over all magnitudes, so that many tie
        let draw = |i: u32| i.wrapping_mul(2_654_435_761);
        let n = 10_000;
        check(&(0..n).map(|i| 2.0_f32.powi((draw(i) >> 26) as i32 - 2) * 1.5).collect::<Vec<_>>());
        // one octave; all equal; at both ends of what is positive; none
        check(&(0..n).map(|i| f32::from_bits(1.0_f32.to_bits() + (draw(i) >> 9))).collect::<Vec<_>>());
        check(&[0.2; 5000]);
        check(&[f32::MAX, 0.2, f32::MIN_POSITIVE, 1.0, 0.0]);
        check(&[1.0]);
    }
}
