//! Sums over pixels whose thresholds differ by a known law.
//!
//! A pixel of threshold `t` makes `U / t` events on a way `U`. With a spread, the mean number of
//! events is that of the harmonic mean of the thresholds, and the numbers scatter by the relative
//! variance of `1 / t`. Both follow from the law, so sums over many pixels stay accurate.

use gs2e_num::seed::normal::normal_quantile;

/// Largest relative spread for which sums are used. Beyond it the lowest thresholds, which the
/// sensor cuts off, dominate them.
pub(in crate::event_frame) const MAX_SPREAD: f64 = 0.3;
/// Smallest threshold of a pixel, relative to the nominal one, as the sensors draw it.
pub(super) const LEAST_THRESHOLD: f64 = 0.01;
/// Number of quantiles of the law.
const QUANTILES: u32 = 400;

/// The law of unequal thresholds, as sums over pixels see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct UnequalLaw {
    /// Thresholds at which the sum of all events is that of the drift.
    pub(super) even: [f64; 2],
    /// Variance of a pixel's sum, relative to the square of the sum of its events of a polarity.
    variance: [f64; 2],
}

impl UnequalLaw {
    pub(super) fn new(thresholds: [f64; 2], spread: f64) -> Self {
        // With equal pixels, every value stays what it is, to the last bit.
        if spread <= 0.0 {
            return Self { even: thresholds, variance: [0.0; 2] };
        }
        let of = thresholds.map(|threshold| {
            let inverse = |i: u32| {
                let place = (f64::from(i) + 0.5) / f64::from(QUANTILES);
                1.0 / (1.0 + spread / threshold * normal_quantile(place)).max(LEAST_THRESHOLD)
            };
            let [mut mean, mut square] = [0.0; 2];
            for value in (0..QUANTILES).map(inverse) {
                mean += value / f64::from(QUANTILES);
                square += value * value / f64::from(QUANTILES);
            }
            // `n = U / t` has the mean square `U^2 square`.
            [threshold / mean, (square - mean * mean) / square]
        });
        Self { even: of.map(|[even, _]| even), variance: of.map(|[_, variance]| variance) }
    }

    /// `A on - B off`, whose mean over the pixels is their drift.
    pub(super) fn sum(&self, [on, off]: [u32; 2]) -> f64 {
        self.even[0] * f64::from(on) - self.even[1] * f64::from(off)
    }

    /// Variance of `A on - B off` of one pixel by its own thresholds.
    pub(super) fn variance(&self, counts: [u32; 2]) -> f64 {
        let part = |side: usize| {
            let said = self.even[side] * f64::from(counts[side]);
            self.variance[side] * said * said
        };
        part(0) + part(1)
    }
}
