//! Philox4x32-10: 128 random bits as a function of a 128-bit counter and a 64-bit key.
//!
//! Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011; reference
//! implementation Random123. Integer arithmetic only, so it is the same on every machine.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::philox::philox_block;
//!
//! // The known answer of Random123 for zeros.
//! let block = philox_block([0; 4], [0; 2]);
//! assert_eq!(block, [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
//! // Another counter gives another block, without the blocks in between.
//! assert_ne!(philox_block([1_000_000, 0, 0, 0], [0; 2]), block);
//! ```
#![expect(clippy::cast_possible_truncation, reason = "the low halves of products are what the rounds take")]

use fearless_simd::{Simd, SimdBase as _, u64x8};

// From `philox.h` of Random123. The steps of the key are those of Weyl sequences: the golden ratio, and
// `sqrt(3) - 1`.
const MULTIPLIERS: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const KEY_STEPS: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
const ROUNDS: usize = 10;

/// The block at `counter` of the sequence `key`.
#[must_use]
#[inline]
pub fn philox_block(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let (mut c, mut k) = (counter, key);
    for _ in 0..ROUNDS {
        let left = u64::from(MULTIPLIERS[0]) * u64::from(c[0]);
        let right = u64::from(MULTIPLIERS[1]) * u64::from(c[2]);
        c = [
            (right >> 32) as u32 ^ c[1] ^ k[0],
            right as u32,
            (left >> 32) as u32 ^ c[3] ^ k[1],
            left as u32,
        ];
        k = [k[0].wrapping_add(KEY_STEPS[0]), k[1].wrapping_add(KEY_STEPS[1])];
    }
    c
}

/// The lower half of 64 bits.
pub(crate) const LOW: u64 = 0xffff_ffff;

/// Eight blocks, each word in the lower half of a lane.
#[inline(always)]
pub(crate) fn philox_eight<S: Simd>(counter: [u64x8<S>; 4], key: [u32; 2]) -> [u64x8<S>; 4] {
    let (mut c, mut k) = (counter, key);
    let times = MULTIPLIERS.map(|m| u64x8::splat(counter[0].simd, m.into()));
    for _ in 0..ROUNDS {
        // The masks let the compiler use a multiplication of 32-bit factors.
        let left = (c[0] & LOW) * times[0];
        let right = (c[2] & LOW) * times[1];
        c = [
            (right >> 32) ^ c[1] ^ u64::from(k[0]),
            right & LOW,
            (left >> 32) ^ c[3] ^ u64::from(k[1]),
            left & LOW,
        ];
        k = [k[0].wrapping_add(KEY_STEPS[0]), k[1].wrapping_add(KEY_STEPS[1])];
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines `philox4x32 10` of Random123's `kat_vectors`.
    #[test]
    fn known_answers() {
        let t =
            |counter, key, answer| assert_eq!(philox_block(counter, key), answer, "{counter:x?} {key:x?}");
        t([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        t([!0; 4], [!0; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        t(
            [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
            [0xa409_3822, 0x299f_31d0],
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
        );
    }
}
