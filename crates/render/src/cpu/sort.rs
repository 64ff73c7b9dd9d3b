//! Pass 2: one front-to-back order of all splats of a frame.
//!
//! The order of the previous frame does not help. At 2,400 frames per second, 0.3 rad/s and 500,000
//! Gaussians, each moves by about 10 places, and repairing the order by insertion takes three times
//! as long as sorting from scratch. With tens of thousands of Gaussians, few move, but both methods
//! take less than a hundredth of the frame.

#![expect(clippy::cast_possible_truncation, reason = "keys are taken apart into 32-bit halves and digits")]

use super::project::{CHUNK, ProjectedChunk};
use rayon::prelude::*;

/// Bits of the digit by which keys are distributed. Its counters stay in the first-level cache.
const DIGIT_BITS: u32 = 13;
/// Number of keys that one task counts, at least.
const COUNTED: usize = 1 << 16;
/// Number of buckets that one task sorts, at least.
const SORTED: usize = 1 << 7;

/// Sorts splats by the bits of their depth; ties keep the order of the file.
#[derive(Debug, Default)]
pub(super) struct DepthSorter {
    /// Bits of the depth in the high half, the splat's place in the low half.
    keys: Vec<u64>,
    spare: Vec<u64>,
}

impl DepthSorter {
    /// The order of the projected splats: one key each, with the splat's place in its low half.
    pub(super) fn run(&mut self, depths: &[f32], chunks: &[ProjectedChunk]) -> &[u64] {
        let [low, high] = self.lay_down(depths, chunks);
        // Relative to the smallest depth, keys have fewer bits than a float, and fill more buckets.
        // Without splats `low` is above `high`.
        let bits = u32::BITS - high.saturating_sub(low).leading_zeros();
        let shift = bits.saturating_sub(DIGIT_BITS);
        let buckets = self.distribute(|key| (((key >> 32) as u32 - low) >> shift) as usize);
        if shift > 0 {
            self.sort_buckets(&buckets);
        }
        &self.keys
    }

    /// Writes the keys in file order, and returns the bits of the smallest and largest depth.
    fn lay_down(&mut self, depths: &[f32], chunks: &[ProjectedChunk]) -> [u32; 2] {
        self.keys.resize(chunks.iter().map(|chunk| chunk.drawn).sum(), 0);
        // Each chunk writes to its own part of the keys, so chunks run in parallel.
        let mut rest = self.keys.as_mut_slice();
        let keys = chunks.iter().map(|c| rest.split_off_mut(..c.drawn).expect("as many as are drawn"));
        let keys: Vec<&mut [u64]> = keys.collect();
        let lay = |(k, keys): (usize, &mut [u64])| {
            let mut ends = [u32::MAX, 0];
            // The splats of a chunk begin at a multiple of `CHUNK`; the places between chunks are
            // unused.
            for ((place, depth), key) in depths.iter().enumerate().skip(k * CHUNK).zip(keys) {
                let depth = depth.to_bits();
                ends = [ends[0].min(depth), ends[1].max(depth)];
                *key = u64::from(depth) << 32 | place as u64;
            }
            ends
        };
        let ends = keys.into_par_iter().enumerate().map(lay);
        ends.reduce(|| [u32::MAX, 0], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// One stable counting sort by the high bits. Returns the number of keys of each bucket. Depths are
    /// positive, so their bits sort as their values do.
    fn distribute(&mut self, digit: impl Fn(u64) -> usize + Sync) -> Vec<u32> {
        let none = || vec![0_u32; 1 << DIGIT_BITS];
        let count = |mut counts: Vec<u32>, &key: &u64| {
            counts[digit(key)] += 1;
            counts
        };
        let add = |mut a: Vec<u32>, b: Vec<u32>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let counts = self.keys.par_iter().with_min_len(COUNTED).fold(none, count).reduce(none, add);
        let mut sum = 0;
        let start = |count: &u32| {
            sum += count;
            sum - count
        };
        let mut starts: Vec<u32> = counts.iter().map(start).collect();
        self.spare.resize(self.keys.len(), 0);
        for &key in &self.keys {
            let place = &mut starts[digit(key)];
            self.spare[*place as usize] = key;
            *place += 1;
        }
        std::mem::swap(&mut self.keys, &mut self.spare);
        counts
    }

    /// Sorts each bucket. The low halves of the keys ascend in file order and differ, so that no other order
    /// is possible, and ties stay in the order of the file.
    fn sort_buckets(&mut self, counts: &[u32]) {
        let mut rest = self.keys.as_mut_slice();
        let buckets: Vec<&mut [u64]> = counts
            .iter()
            .map(|count| rest.split_off_mut(..*count as usize).expect("the counts add up to all keys"))
            .filter(|bucket| bucket.len() > 1)
            .collect();
        buckets.into_par_iter().with_min_len(SORTED).for_each(|bucket| bucket.sort_unstable());
    }
}

/// The splat's place, from the low half of a key.
pub(super) fn key_place(key: u64) -> u32 {
    key as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(depths: &[f32]) {
        // The last splat of each chunk is not drawn.
        let chunks: Vec<ProjectedChunk> = depths
            .chunks(CHUNK)
            .map(|chunk| ProjectedChunk { drawn: chunk.len() - 1, ..ProjectedChunk::default() })
            .collect();
        let drawn = |i: &usize| i % CHUNK + 1 < CHUNK && i + 1 < depths.len();
        let mut wanted: Vec<usize> = (0..depths.len()).filter(drawn).collect();
        wanted.sort_by(|&a, &b| depths[a].total_cmp(&depths[b]));
        let mut sorter = DepthSorter::default();
        // Twice, because buffers are reused.
        for _ in 0..2 {
            let order = sorter.run(depths, &chunks);
            let order: Vec<usize> = order.iter().map(|&key| key_place(key) as usize).collect();
            assert!(order == wanted, "not as std's stable sort has it");
        }
    }

    #[test]
    fn depths_ascend_and_ties_follow_the_file() {
        // Few distinct values over all magnitudes, so that many tie.
        let draw = |i: u32| i.wrapping_mul(2_654_435_761);
        let n = 10_000;
        check(&(0..n).map(|i| 2.0_f32.powi((draw(i) >> 26) as i32 - 2) * 1.5).collect::<Vec<_>>());
        // One octave; all equal; both ends of the positive range; none.
        check(&(0..n).map(|i| f32::from_bits(1.0_f32.to_bits() + (draw(i) >> 9))).collect::<Vec<_>>());
        check(&[0.2; 5000]);
        check(&[f32::MAX, 0.2, f32::MIN_POSITIVE, 1.0, 0.0]);
        check(&[1.0]);
    }
}
