//! Logarithm and exponential of eight numbers at a time, without branches. No operations are fused,
//! so the bits are the same on every machine and with every instruction set.
//!
//! Algorithms and constants are those of FreeBSD's msun (`e_log.c`, `e_exp.c`; Sun Microsystems
//! 1993, freely distributable). `libm` follows them too, so results agree to the bit where both are
//! defined. Errors are below 1 ulp.
//!
//! # Examples
//!
//! ```
//! use fearless_simd::{Level, dispatch};
//! use gs2e_num::elementary::{exp_eight, ln_each, load_eight, store_eight};
//! use std::f64::consts::LN_2;
//!
//! let powers = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0];
//! let mut values = powers;
//! ln_each(&mut values);
//! assert!(values.iter().zip(0..).all(|(ln, n)| (ln - f64::from(n) * LN_2).abs() < 1e-14));
//!
//! // The exponential leads back.
//! dispatch!(Level::new(), simd => store_eight(exp_eight(load_eight(simd, &values, 0)), &mut values, 0));
//! assert!(values.iter().zip(powers).all(|(found, power)| (found / power - 1.0).abs() < 1e-14));
//! ```
#![expect(clippy::excessive_precision, clippy::unreadable_literal, reason = "constants as published")]

use fearless_simd::{
    Level, Select as _, Simd, SimdBase as _, SimdFloat as _, SimdMask as _, dispatch, f64x8, u64x8,
};

const LN2_HIGH: f64 = 6.93147180369123816490e-01;
const LN2_LOW: f64 = 1.90821492927058770002e-10;

/// Coefficients of `(ln(1 + s) - ln(1 - s) - 2s) / s` in powers of `s^2`.
const LOG: [f64; 7] = [
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
];

/// `2^52`: its last bit has the value 1.
const UNIT_ULP: u64 = 0x4330_0000_0000_0000;
/// Upper half of the bits of `sqrt(1/2)`. Reduced arguments lie between it and twice its value.
const SQRT_HALF_BITS: u64 = 0x3fe6_a09e << 32;
const ONE: u64 = 0x3ff0_0000 << 32;
const MANTISSA: u64 = (1 << 52) - 1;

/// Natural logarithms of positive finite numbers.
#[inline(always)]
pub fn ln_eight<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let simd = x.simd;
    let all = |v: f64| f64x8::splat(simd, v);
    // A subnormal has no leading bit. Scaled by 2^54 it is normal, and the shift takes the 54 off
    // again.
    let subnormal = x.simd_lt(f64::MIN_POSITIVE);
    let x = subnormal.select(x * TWO_54, x);
    let shift = subnormal.select(all(TWO_52 + 1023.0 + 54.0), all(TWO_52 + 1023.0));
    // The sum carries into the exponent from the mantissa of `sqrt(2)` on, so `f` lies around 0.
    let bits = x.to_bits() + (ONE - SQRT_HALF_BITS);
    // The bits of `2^52 + exponent`. The difference is the exponent as a float, without a
    // conversion.
    let exponent = f64x8::from_bits((bits >> 52) | UNIT_ULP) - shift;
    let f = f64x8::from_bits((bits & MANTISSA) + SQRT_HALF_BITS) - 1.0;
    let half_square = f * 0.5 * f;
    let s = f / (f + 2.0);
    let z = s * s;
    let w = z * z;
    let [c1, c2, c3, c4, c5, c6, c7] = LOG;
    let even = w * (w * (w * c6 + c4) + c2);
    let odd = z * (w * (w * (w * c7 + c5) + c3) + c1);
    // From small terms to large ones, in the order of `e_log.c`: another order changes the last
    // bit.
    s * (half_square + (odd + even)) + exponent * LN2_LOW - half_square + f + exponent * LN2_HIGH
}

/// Replaces positive finite numbers by their natural logarithms.
pub fn ln_each(values: &mut [f64]) {
    #[inline(always)]
    fn eights<S: Simd>(simd: S, values: &mut [f64]) {
        for start in (0..values.len()).step_by(8) {
            store_eight(ln_eight(load_eight(simd, values, start)), values, start);
        }
    }
    let (whole, rest) = values.split_at_mut(values.len() / 8 * 8);
    dispatch!(Level::new(), simd => eights(simd, whole));
    // The bits are the same.
    rest.iter_mut().for_each(|value| *value = libm::log(*value));
}

/// Bound on `(b - a)/(b + a)` below which `ln` of a ratio is a series. Its first omitted term is
/// `NEAR^14/15` of the first term, 1e-18.
const NEAR: f64 = 1.0 / 16.0;
/// Coefficients of `atanh(q)/q` in powers of `q^2`.
const ATANH: [f64; 7] = [1.0, 1.0 / 3.0, 1.0 / 5.0, 1.0 / 7.0, 1.0 / 9.0, 1.0 / 11.0, 1.0 / 13.0];

/// `ln(b/a)` of positive finite numbers, as `2 atanh((b - a)/(b + a))` if they are close to each
/// other. The error is a few ulp of the result there, and a few ulp of the larger logarithm
/// elsewhere.
#[inline(always)]
pub fn ln_ratio<S: Simd>([a, b]: [f64x8<S>; 2]) -> f64x8<S> {
    let q = (b - a) / (b + a);
    let z = q * q;
    let w = z * z;
    let [c0, c1, c2, c3, c4, c5, c6] = ATANH;
    let low = (z * c1 + c0) + (z * c3 + c2) * w;
    let series = (q + q) * (low + ((z * c5 + c4) + w * c6) * (w * w));
    let near = q.abs().simd_lt(NEAR);
    // The logarithms of both are needed only if some ratio is far from 1.
    if near.all_true() { series } else { near.select(series, ln_eight(b) - ln_eight(a)) }
}

const TWO_52: f64 = 4_503_599_627_370_496.0;
const TWO_54: f64 = 18_014_398_509_481_984.0;

/// Coefficients of `x^2` to `x^10` in `x (e^x + 1)/(e^x - 1) - 2`, from `e_exp.c`.
const EXP: [f64; 5] = [
    1.66666666666666019037e-01,
    -2.77777777770155933842e-03,
    6.61375632143793436117e-05,
    -1.65339022054652515390e-06,
    4.13813679705723846039e-08,
];
const INVERSE_LN2: f64 = std::f64::consts::LOG2_E;
/// Adding `1.5 * 2^52` rounds to an integer and leaves it in the low bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;
/// Arguments are clamped to this, so that results are neither infinite nor subnormal.
const MAX_EXPONENT: f64 = 708.0;

/// Exponentials of numbers clamped to -708..708.
#[inline(always)]
pub fn exp_eight<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let simd = x.simd;
    let all = |v: f64| f64x8::splat(simd, v);
    let x = x.max(-MAX_EXPONENT).min(MAX_EXPONENT);
    let shifted = x * INVERSE_LN2 + ROUNDER;
    let k = shifted - ROUNDER;
    // The product with `LN2_HIGH` is exact, because the lower bits of that number are 0.
    let (high, low) = (x - k * LN2_HIGH, k * LN2_LOW);
    let r = high - low;
    let z = r * r;
    let [c1, c2, c3, c4, c5] = EXP;
    let c = r - z * (z * (z * (z * (z * c5 + c4) + c3) + c2) + c1);
    // In the order of `e_exp.c`, so that the bits are those of `libm`: small terms first, the 1 last.
    let y = (r * c / (all(2.0) - c) - low + high) + 1.0;
    // The low bits of `shifted` are `k`, which is added to the exponent. `MAX_EXPONENT` keeps the sum
    // within the exponents of normal numbers.
    f64x8::from_bits(y.to_bits() + (shifted.to_bits() << 52))
}

/// Eight numbers of a slice, from `start` on.
#[inline(always)]
pub fn load_eight<S: Simd>(simd: S, from: &[f64], start: usize) -> f64x8<S> {
    f64x8::from_slice(simd, &from[start..start + 8])
}

/// Stores eight numbers in a slice, from `start` on.
#[inline(always)]
pub fn store_eight<S: Simd>(value: f64x8<S>, to: &mut [f64], start: usize) {
    value.store_slice(&mut to[start..start + 8]);
}

/// Indices of the set bits, lowest first.
#[inline(always)]
pub fn set_lanes(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = bits.trailing_zeros() as usize;
        // `wrapping_sub`, because the iterator is also asked when no bit is left.
        bits &= bits.wrapping_sub(1);
        (place < 64).then_some(place)
    })
}

/// [`fearless_simd::mask64x8`] as bits, the first lane lowest.
#[inline(always)]
pub fn mask_bits<S: Simd>(mask: fearless_simd::mask64x8<S>) -> u64 {
    mask.to_bitmask()
}

/// Whole numbers below `2^52` as floating point.
#[inline(always)]
pub(crate) fn to_float<S: Simd>(x: u64x8<S>) -> f64x8<S> {
    f64x8::from_bits(x | UNIT_ULP) - TWO_52
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(
        wide: impl Fn([f64; 8]) -> [f64; 8],
        library: fn(f64) -> f64,
        arguments: impl Iterator<Item = f64>,
    ) {
        let all: Vec<f64> = arguments.collect();
        for eight in all.chunks_exact(8) {
            let found = wide(eight.try_into().unwrap());
            for (x, found) in eight.iter().zip(found) {
                let wanted = library(*x);
                assert_eq!(found.to_bits(), wanted.to_bits(), "{x:e}: {found:e}, wanted {wanted:e}");
            }
        }
    }

    /// Deterministic numbers that fill their range evenly.
    fn spread(low: f64, high: f64) -> impl Iterator<Item = f64> {
        (1..=1u32 << 16).map(move |i| low + (high - low) * (f64::from(i) * std::f64::consts::SQRT_2).fract())
    }

    #[test]
    fn logarithms_are_those_of_the_library() {
        let ln = |x: [f64; 8]| -> [f64; 8] {
            dispatch!(Level::new(), simd => ln_eight(f64x8::from_slice(simd, &x)).into())
        };
        check(ln, libm::log, spread(0.0, 300.0));
        check(ln, libm::log, spread(0.5, 1.5));
        check(ln, libm::log, spread(-700.0, 700.0).map(libm::exp));
        check(ln, libm::log, spread(1.0, f64::from(1 << 20)).map(|i| i * f64::from_bits(1)));
    }

    #[test]
    fn a_slice_of_any_length_gets_its_logarithms() {
        for len in [0, 1, 7, 8, 9, 23] {
            let values: Vec<f64> = spread(0.0, 300.0).take(len).collect();
            let mut found = values.clone();
            ln_each(&mut found);
            assert_eq!(found, values.into_iter().map(libm::log).collect::<Vec<_>>());
        }
    }

    #[test]
    fn logarithms_of_ratios_round_relative_to_themselves() {
        let found = |a: f64, b: f64| -> f64 {
            dispatch!(Level::new(), simd => {
                let pair = [a, b].map(|v| f64x8::from_slice(simd, &[1.0, v, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]));
                ln_ratio(pair)[1]
            })
        };
        for near in [1e-17, 1e-9, 1e-3, 0.05, 0.1, 0.13, 0.14, 0.9].into_iter().flat_map(|d| [d, -d]) {
            for a in [1e-300, 0.3, 20.0, 3e38] {
                let b = a * (1.0 + near);
                // Neighbours have an exact difference, so this is an independent answer, good to 2
                // ulp.
                let wanted = libm::log1p((b - a) / a);
                let error = (found(a, b) - wanted).abs();
                // In the series, 5 roundings. Beyond it, those of two logarithms of at most 700.
                let limit = if near.abs() < 0.1 { 4.0 * f64::EPSILON * wanted.abs() } else { 4e-13 };
                assert!(error <= limit, "{a:e} {near}: {error:e}");
            }
        }
        assert_eq!(found(5.0, 5.0).to_bits(), 0);
        assert!(
            (found(f64::MIN_POSITIVE, 3e38) - (88.596_845_822_441_85 + 708.396_418_532_264_1)).abs() < 1e-12
        );
    }

    #[test]
    fn exponentials_are_those_of_the_library() {
        let exp = |x: [f64; 8]| -> [f64; 8] {
            dispatch!(Level::new(), simd => exp_eight(f64x8::from_slice(simd, &x)).into())
        };
        check(exp, libm::exp, spread(-700.0, 700.0));
        check(exp, libm::exp, spread(-1.0, 1.0));
        check(exp, libm::exp, spread(-1e-3, 1e-3));
    }
}
