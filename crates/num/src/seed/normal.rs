//! Standard normal deviates from uniforms, by the inverse of the distribution function.
//!
//! Wichura, "Algorithm AS 241: the percentage points of the normal distribution", Applied
//! Statistics 37 (1988), routine PPND16: relative error about 1e-16. One uniform gives one deviate,
//! and the map is monotonic. The logarithm in the tails is `libm`'s, so the result is the same on
//! every machine.
//!
//! # Examples
//!
//! ```
//! use gs2e_num::seed::normal::normal_quantile;
//! use std::f64::consts::SQRT_2;
//!
//! // Half of all deviates are below 0, and both tails are alike.
//! assert_eq!(normal_quantile(0.5), 0.0);
//! assert_eq!(normal_quantile(0.25), -normal_quantile(0.75));
//! // The inverse of the distribution function `erfc(-z / sqrt(2)) / 2`.
//! let below = |z: f64| 0.5 * libm::erfc(-z / SQRT_2);
//! assert!((normal_quantile(below(-1.5)) + 1.5).abs() < 1e-14);
//! ```
#![expect(clippy::excessive_precision, clippy::unreadable_literal, reason = "coefficients as published")]

use fearless_simd::{Simd, f64x8};

pub(super) const CENTRE_NUMERATOR: [f64; 8] = [
    3.3871328727963666080,
    1.3314166789178437745e2,
    1.9715909503065514427e3,
    1.3731693765509461125e4,
    4.5921953931549871457e4,
    6.7265770927008700853e4,
    3.3430575583588128105e4,
    2.5090809287301226727e3,
];
pub(super) const CENTRE_DENOMINATOR: [f64; 8] = [
    1.0,
    4.2313330701600911252e1,
    6.8718700749205790830e2,
    5.3941960214247511077e3,
    2.1213794301586595867e4,
    3.9307895800092710610e4,
    2.8729085735721942674e4,
    5.2264952788528545610e3,
];
pub(super) const MIDDLE_NUMERATOR: [f64; 8] = [
    1.42343711074968357734,
    4.63033784615654529590,
    5.76949722146069140550,
    3.64784832476320460504,
    1.27045825245236838258,
    2.41780725177450611770e-1,
    2.27238449892691845833e-2,
    7.74545014278341407640e-4,
];
pub(super) const MIDDLE_DENOMINATOR: [f64; 8] = [
    1.0,
    2.05319162663775882187,
    1.67638483018380384940,
    6.89767334985100004550e-1,
    1.48103976427480074590e-1,
    1.51986665636164571966e-2,
    5.47593808499534494600e-4,
    1.05075007164441684324e-9,
];
pub(super) const FAR_NUMERATOR: [f64; 8] = [
    6.65790464350110377720,
    5.46378491116411436990,
    1.78482653991729133580,
    2.96560571828504891230e-1,
    2.65321895265761230930e-2,
    1.24266094738807843860e-3,
    2.71155556874348757815e-5,
    2.01033439929228813265e-7,
];
pub(super) const FAR_DENOMINATOR: [f64; 8] = [
    1.0,
    5.99832206555887937690e-1,
    1.36929880922735805310e-1,
    1.48753612908506148525e-2,
    7.86869131145613259100e-4,
    1.84631831751005468180e-5,
    1.42151175831644588870e-7,
    2.04426310338993978564e-15,
];

// In the published routine: SPLIT1, CONST1, then CONST2 and SPLIT2, which is also the border.

/// Distance from 1/2 beyond which a uniform is in a tail.
pub(super) const CENTRE: f64 = 0.425;
/// The square of that distance.
pub(super) const CENTRE_SQUARE: f64 = 0.180625;
/// Centres of the two expansions of the tails, in `sqrt(-ln p)`.
pub(super) const FAR_CENTRE: [f64; 2] = [1.6, 5.0];
/// Border between the two expansions.
pub(super) const FAR: f64 = 5.0;

/// The deviate `z` with `Phi(z) = p`, for `0 < p < 1`.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= CENTRE {
        let r = CENTRE_SQUARE - q * q;
        return q * estrin_polynomial(&CENTRE_NUMERATOR, r) / estrin_polynomial(&CENTRE_DENOMINATOR, r);
    }
    // The difference is exact, because `p` is above 1/2 here.
    let tail = if q < 0.0 { p } else { 1.0 - p };
    tail_quantile(tail).copysign(q)
}

fn tail_quantile(tail: f64) -> f64 {
    // The published expansions of the tails are in `sqrt(-ln p)`.
    let r = (-libm::log(tail)).sqrt();
    let [middle, far] = FAR_CENTRE.map(|centre| r - centre);
    if r <= FAR {
        estrin_polynomial(&MIDDLE_NUMERATOR, middle) / estrin_polynomial(&MIDDLE_DENOMINATOR, middle)
    } else {
        estrin_polynomial(&FAR_NUMERATOR, far) / estrin_polynomial(&FAR_DENOMINATOR, far)
    }
}

/// Estrin's scheme: pairs are independent, so a processor evaluates them in parallel.
fn estrin_polynomial(c: &[f64; 8], x: f64) -> f64 {
    let square = x * x;
    let low = (c[0] + c[1] * x) + (c[2] + c[3] * x) * square;
    let high = (c[4] + c[5] * x) + (c[6] + c[7] * x) * square;
    low + high * (square * square)
}

/// [`estrin_polynomial`] for eight numbers.
#[inline(always)]
pub(super) fn polynomial_eight<S: Simd>(c: &[f64; 8], x: f64x8<S>) -> f64x8<S> {
    let square = x * x;
    let low = (x * c[1] + c[0]) + (x * c[3] + c[2]) * square;
    let high = (x * c[5] + c[4]) + (x * c[7] + c[6]) * square;
    low + high * (square * square)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{DrawSpace, Seed, SeedCell};
    use gs2e_testing::rival;

    #[test]
    fn it_inverts_the_distribution_function() {
        // Phi by libm's complementary error function is an independent answer, good to a few ulp.
        // An error e of z appears as e*phi(z)/Phi(-z), at most 9 e in this range.
        for i in 1..=820 {
            let z = -8.2 + f64::from(i) * 0.01;
            let p = 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2);
            assert!((normal_quantile(p) - z).abs() < 5e-15 * z.abs().max(1.0), "{z}: {}", normal_quantile(p));
        }
    }

    #[test]
    fn normal_draws_are_distributed_as_those_of_rand_distr() {
        let mut draws = Seed(3).draws(SeedCell { x: 1, y: 2, level: 0, index: 3 }, DrawSpace::Leaf);
        let ours: Vec<f64> = (0..rival::N).map(|_| draws.normal()).collect();
        rival::compare("normal", &ours, &rival::theirs(&rand_distr::StandardNormal), |z| 1.1 * z);
    }

    #[test]
    fn ends_and_middle() {
        assert_eq!(normal_quantile(0.5).to_bits(), 0.0f64.to_bits());
        let least = 0.5 / (1u64 << 52) as f64;
        assert!((normal_quantile(least) + 8.209_536_151_601_387).abs() < 1e-14, "{}", normal_quantile(least));
        assert_eq!(normal_quantile(1.0 - least).to_bits(), (-normal_quantile(least)).to_bits());
    }
}
