//! `2^-q` for the opacity of a layer: the same bits on every machine and for any number of lanes.

use fearless_simd::{Bytes as _, Simd, SimdBase as _, f32x16, u32x16};

/// Minimax polynomial of `2^f` over [-1/2, 1/2] with constant term 1: coefficients of `f` to `f^5`,
/// each rounded to 32 bits before the next was fitted. Relative error 9.2e-8 before rounding.
#[expect(clippy::approx_constant, reason = "fitted: six units in the last place below ln 2")]
const POWER: [f32; 5] = [0.693_147, 0.240_222_47, 0.055_507_11, 0.009_671_291, 0.001_326_952_1];

/// Adding `1.5 * 2^23` rounds to an integer (ties to even) and leaves it in the low bits.
const ROUNDER: f32 = 12_582_912.0;

/// Larger arguments are replaced by this one. Their layers are far below the smallest opacity that
/// is blended.
const MAX_EXPONENT: f32 = 125.0;

/// `2^-q` for `q >= 0`. The relative error is at most 2e-7 (tested) up to `q = 125`; beyond, the
/// result is `2^-125`. `q = 0` gives exactly 1.
#[inline(always)]
pub(super) fn exp2_neg<S: Simd>(simd: S, q: f32x16<S>) -> f32x16<S> {
    let all = |v: f32| f32x16::splat(simd, v);
    let [c1, c2, c3, c4, c5] = POWER;
    let q = q.min(MAX_EXPONENT);
    let shifted = all(ROUNDER) - q;
    // The fraction is negated: the signs of the odd terms turn, and no rounding changes.
    let g = q + (shifted - ROUNDER);
    let p = all(1.0) - g * (all(c1) - g * (all(c2) - g * (all(c3) - g * (all(c4) - g * c5))));
    // The integer in the low bits of `shifted` is `-round(q)`. Added to the exponent, it multiplies
    // by a power of two; [`MAX_EXPONENT`] keeps the result a normal number.
    // `bitcast` and not `from_bits`, which the compiler may leave as a call: all registers would be
    // saved around it.
    let [p, shifted]: [u32x16<S>; 2] = [p.bitcast(), shifted.bitcast()];
    (p + (shifted << 23)).bitcast()
}

/// [`exp2_neg`] for one value.
#[cfg(test)]
pub(super) fn of_one(q: f32) -> f32 {
    #[inline(always)]
    fn first<S: Simd>(simd: S, q: f32) -> f32 {
        exp2_neg(simd, f32x16::splat(simd, q))[0]
    }
    fearless_simd::dispatch!(fearless_simd::Level::new(), simd => first(simd, q))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_stays_within_the_bound() {
        let mut worst = 0.0_f64;
        // Every 1/8192: all fractions that the reduction can leave near its ends, and many in
        // between.
        for k in 0..(125 * 8192) {
            let q = k as f32 / 8192.0 + 1e-5 * (k % 7) as f32;
            let exact = libm::exp2(-f64::from(q));
            worst = worst.max((f64::from(of_one(q)) / exact - 1.0).abs());
        }
        assert!(worst <= 2e-7, "largest relative error {worst:e}");
    }

    #[test]
    fn powers_of_two_are_exact_and_no_value_exceeds_one() {
        for n in 0..=125_u32 {
            assert_eq!(of_one(n as f32).to_bits(), (127 - n) << 23, "2^-{n}");
        }
        for q in [0.0, f32::MIN_POSITIVE, 1e-9, 1e-7, 1e-3, 0.49, 0.51] {
            assert!(of_one(q) <= 1.0, "{q}");
        }
    }

    #[test]
    fn huge_arguments_give_next_to_nothing() {
        for q in [125.5, 1e30, f32::INFINITY] {
            assert_eq!(of_one(q).to_bits(), 2.0_f32.powi(-125).to_bits(), "{q}");
        }
    }
}
