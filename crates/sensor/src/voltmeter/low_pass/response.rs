//! The answer of one or two equal low-pass stages to a cubic.
//!
//! Over a piece of `T` time constants, with `s` from 0 to 1, a stage at rest answers the input `s^k` with
//!
//! ```text
//! I_k = T integral of e^(-T (1 - s)) s^k ds       I_k = 1 - (k/T) I_(k-1)       I_0 = 1 - e^-T
//! ```
//!
//! at the end, and two stages in a row with `J_k = T (I_k - I_(k+1)) = I_k - (k/T) J_(k-1)`. Forwards, the
//! recursions lose all digits for small `T`. There, `I_4` is a series of falling terms, and the recursion
//! runs backwards, which adds no error.

use fearless_simd::{Select as _, Simd, SimdBase as _, SimdMask as _, f64x8};
use gs2e_num::elementary::exp_eight;

/// The answers at the end of a piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct Response<S: Simd> {
    /// Length of the piece in time constants.
    pub(super) turns: f64x8<S>,
    /// Share of a deviation that a stage keeps over the piece.
    pub(super) decay: f64x8<S>,
    /// Answers of one stage to `s`, `s^2` and `s^3`.
    pub(super) one: [f64x8<S>; 3],
    /// Answers of two stages.
    pub(super) two: [f64x8<S>; 3],
}

/// Length from which the recursions run forwards. Their error there is below `6 / T^3` ulp.
const LONG: f64 = 1.0;
/// Inverses of the numbers by which a term of the series is divided to give the next, from the last to the
/// first. The term that is left out is below `24/19!`, 2e-16.
const INVERSES: [f64; 13] = [
    1.0 / 18.0,
    1.0 / 17.0,
    1.0 / 16.0,
    1.0 / 15.0,
    1.0 / 14.0,
    1.0 / 13.0,
    1.0 / 12.0,
    1.0 / 11.0,
    1.0 / 10.0,
    1.0 / 9.0,
    1.0 / 8.0,
    1.0 / 7.0,
    1.0 / 6.0,
];

impl<S: Simd> Response<S> {
    /// The answers of pieces with these lengths.
    #[inline(always)]
    pub(super) fn new(turns: f64x8<S>) -> Self {
        let short = Self::short(turns);
        let is_long = turns.simd_ge(LONG);
        if !is_long.any_true() {
            return short;
        }
        let long = Self::long(turns);
        let mut out = Self { turns, decay: is_long.select(long.decay, short.decay), ..short };
        for k in 0..3 {
            out.one[k] = is_long.select(long.one[k], short.one[k]);
            out.two[k] = is_long.select(long.two[k], short.two[k]);
        }
        out
    }

    #[inline(always)]
    fn short(turns: f64x8<S>) -> Self {
        let mut nested = f64x8::splat(turns.simd, 1.0);
        for inverse in INVERSES {
            nested = 1.0 - turns * inverse * nested;
        }
        let i4 = turns * 0.2 * nested;
        let i3 = turns * 0.25 * (1.0 - i4);
        let i2 = turns * (1.0 / 3.0) * (1.0 - i3);
        let i1 = turns * 0.5 * (1.0 - i2);
        let i0 = turns * (1.0 - i1);
        let two = [turns * (i1 - i2), turns * (i2 - i3), turns * (i3 - i4)];
        Self { turns, decay: 1.0 - i0, one: [i1, i2, i3], two }
    }

    #[inline(always)]
    fn long(turns: f64x8<S>) -> Self {
        let decay = exp_eight(-turns);
        let part = 1.0 / turns;
        let i0 = 1.0 - decay;
        let i1 = 1.0 - part * i0;
        let i2 = 1.0 - part * 2.0 * i1;
        let i3 = 1.0 - part * 3.0 * i2;
        let j0 = i0 - turns * decay;
        let j1 = i1 - part * j0;
        let j2 = i2 - part * 2.0 * j1;
        let j3 = i3 - part * 3.0 * j2;
        Self { turns, decay, one: [i1, i2, i3], two: [j1, j2, j3] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    /// Decay, answers of one stage, and answers of two.
    fn response(turns: f64) -> [f64; 7] {
        dispatch!(Level::new(), simd => {
            let Response { decay, one, two, .. } = Response::new(f64x8::splat(simd, turns));
            let [a, b, c] = one.map(|v| v[2]);
            let [d, e, f] = two.map(|v| v[5]);
            [decay[0], a, b, c, d, e, f]
        })
    }

    /// Gauss-Legendre quadrature of five points, exact to degree 9.
    fn integral(f: impl Fn(f64) -> f64, panels: u32) -> f64 {
        let nodes = [
            (0.0, 128.0 / 225.0),
            (0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let width = 1.0 / f64::from(panels);
        let panel = |i: u32| {
            let middle = (f64::from(i) + 0.5) * width;
            let pair = |&(x, w): &(f64, f64)| {
                let both = f(middle + 0.5 * width * x) + f(middle - 0.5 * width * x);
                if x == 0.0 { 0.5 * w * both } else { w * both }
            };
            0.5 * width * nodes.iter().map(pair).sum::<f64>()
        };
        (0..panels).map(panel).sum()
    }

    #[test]
    fn answers_are_their_integrals() {
        for turns in [1e-9f64, 1e-4, 0.03, 0.25, 0.7, 1.0 - 1e-12, 1.0, 1.7, 8.0, 60.0] {
            let found = response(turns);
            let kernel = |s: f64| turns * libm::exp(-turns * (1.0 - s));
            let mut wanted = [libm::exp(-turns); 7];
            for k in 0..3 {
                let power = |s: f64| s.powi(1 + i32::try_from(k).unwrap());
                wanted[1 + k] = integral(|s| kernel(s) * power(s), 400);
                wanted[4 + k] = integral(|s| kernel(s) * turns * (1.0 - s) * power(s), 400);
            }
            for (found, wanted) in found.into_iter().zip(wanted) {
                // Panels of 1/400 of 60 time constants: 0.15^10/10! of the integrand is 2e-15. The forward
                // recursion at 1 multiplies a rounding by up to 6 twice.
                let bound = 3e-14 * wanted.max(turns.min(1e-3));
                assert!((found - wanted).abs() < bound, "{turns}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn a_long_piece_follows_its_input() {
        for turns in [1e3, 1e6, 1e15] {
            let [decay, one @ .., _, _, _] = response(turns);
            // Two terms of `s^k - (k/T) s^(k-1)`: the answer is late by a time constant.
            for (k, found) in (1u8..).zip(one) {
                let k = f64::from(k);
                assert!((found - (1.0 - k / turns)).abs() <= k * k / (turns * turns) + 1e-15);
            }
            assert!(decay < 1e-300);
        }
    }
}
