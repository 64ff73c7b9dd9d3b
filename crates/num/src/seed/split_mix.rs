//! The parts of SplitMix64 (Steele, Lea and Flood 2014), for patterns that need no independent draws.

/// Increment of the state.
pub const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser, which makes a number of the state. It maps 0 to 0.
#[must_use]
pub fn finalise_bits(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
