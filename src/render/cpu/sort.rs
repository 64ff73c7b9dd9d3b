//! Pass 2: one front-to-back order for the whole frame.

#![expect(clippy::cast_possible_truncation, reason = "keys are taken apart into 32-bit halves and digits")]

use super::project::{CHUNK, Projected};
use super::splat::Splat;

const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Enough digits for 32 bits.
const PASSES: usize = 3;

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
        self.keys.clear();
        for (k, chunk) in chunks.iter().enumerate() {
            let places = k * CHUNK..k * CHUNK + chunk.drawn;
            self.keys.extend(places.map(|i| u64::from(splats[i].depth.to_bits()) << 32 | i as u64));
        }
        self.spare.resize(self.keys.len(), 0);
        for pass in 0..PASSES {
            self.by_digit(pass);
        }
        &self.keys
    }

    /// One stable counting sort. Depths are positive, so their bits are in the order of their values; and as keys
    /// were laid down in file order, a stable sort by depth alone leaves ties in it.
    fn by_digit(&mut self, pass: usize) {
        let digit = |key: u64| (key >> (32 + DIGIT_BITS * pass as u32)) as usize & (DIGITS - 1);
        let mut starts = [0_u32; DIGITS];
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

    #[test]
    fn depths_ascend_and_ties_follow_the_file() {
        // depths of few distinct values over all magnitudes, so that many tie
        let depths: Vec<f32> = (0..10_000_u32)
            .map(|i| 2.0_f32.powi((i.wrapping_mul(2_654_435_761) >> 26) as i32 - 2) * 1.5)
            .collect();
        let splats: Vec<Splat> = depths.iter().map(|&depth| Splat { depth, ..Splat::default() }).collect();
        let drawn = |n| Projected { drawn: n, ..Projected::default() };
        let chunks = [drawn(CHUNK), drawn(CHUNK), drawn(10_000 - 2 * CHUNK)];
        let mut sorter = Sorter::default();
        let order: Vec<usize> = sorter.run(&splats, &chunks).iter().map(|&key| place(key) as usize).collect();
        assert_eq!(order.len(), 10_000);
        let mut wanted: Vec<usize> = (0..10_000).collect();
        wanted.sort_by(|&a, &b| depths[a].total_cmp(&depths[b]));
        assert_eq!(order, wanted, "std's stable sort");
    }
}
