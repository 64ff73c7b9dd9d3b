//! The parts of SplitMix64 (Steele, Lea and Flood 2014), for patterns that need no independent draws.
//!
//! ```
//! use gs2e_num::seed::split_mix::{STEP, finalise_bits};
//!
//! // The first number of the generator with the seed 0.
//! assert_eq!(finalise_bits(STEP), 0xe220_a839_7b1d_cdaf);
//! ```

/// Increment of the state.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser, which makes a number of the state. It maps 0 to 0.
#[must_use]
pub fn finalise_bits(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
