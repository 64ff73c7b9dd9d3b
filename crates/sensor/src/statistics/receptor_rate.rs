//! Events of the photoreceptor's noise at constant light: an Ornstein-Uhlenbeck voltage between two
//! thresholds.
//!
//! With time in units of `1 / theta` and voltages in deviations, the generator is `f'' - z f'`. From `r`, the
//! process leaves `(l, h)` upwards with probability `(S(r) - S(l)) / (S(h) - S(l))`, after the mean time `q
//! G(l) + p G(h) - G(r)`, where `S(z)` is the integral of `exp(w^2/2)` and `G(z)` that of `exp(y^2/2)
//! sqrt(pi/2) erf(y/sqrt 2)` (Siegert, Physical Review 81, 1951).
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::statistics::receptor_rate::ReceptorRate;
//!
//! // A noise of a fifth of the thresholds, and a bandwidth of 60 Hz.
//! let noise = ReceptorRate { deviation: 0.2, theta: 377.0, up: 1.0, down: 1.0 };
//! // Rarely does it go five deviations away.
//! assert!((noise.pairs(0.0) - 0.0054).abs() < 1e-4);
//! // A pixel whose mean voltage lies nearer to a threshold makes more events.
//! assert!(noise.pairs(0.4) > 50.0 * noise.pairs(0.0));
//! ```

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places in a table of a few thousand entries"
)]

use std::f64::consts::{FRAC_PI_2, SQRT_2, TAU};
use std::sync::LazyLock;

/// The noise of a pixel, with thresholds in the same unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceptorRate {
    /// Standard deviation.
    pub deviation: f64,
    /// Rate of return `theta`, per unit of time.
    pub theta: f64,
    /// Threshold of ON events.
    pub up: f64,
    /// Threshold of OFF events.
    pub down: f64,
}

/// Farthest voltage of the tables, in deviations. An exit beyond it takes `e^36` units of time.
const FARTHEST: f64 = 8.5;
/// Entries of a table per deviation. Between them, the error of a line is below 1e-5 of the value.
const PER_UNIT: usize = 1024;

/// `S` and `G` at multiples of `1 / PER_UNIT`.
static INTEGRALS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let slopes = |z: f64| {
        let weight = libm::exp(0.5 * z * z);
        [weight, weight * FRAC_PI_2.sqrt() * libm::erf(z / SQRT_2)]
    };
    let h = 1.0 / PER_UNIT as f64;
    let mut sums = vec![[0.0; 2]];
    for i in 0..=(FARTHEST * PER_UNIT as f64) as usize {
        let z = i as f64 * h;
        let [from, middle, to] = [z, z + 0.5 * h, z + h].map(slopes);
        let before = sums[i];
        sums.push([0, 1].map(|k| before[k] + h * (from[k] + 4.0 * middle[k] + to[k]) / 6.0));
    }
    sums
});

/// `S` and `G`: one is odd, the other even.
fn integrals(z: f64) -> [f64; 2] {
    let at = z.abs().min(FARTHEST) * PER_UNIT as f64;
    let (i, share) = (at as usize, at.fract());
    let [from, to] = [INTEGRALS[i], INTEGRALS[i + 1]];
    let [s, g] = [0, 1].map(|k| from[k] + (to[k] - from[k]) * share);
    [s.copysign(z), g]
}

impl ReceptorRate {
    /// Rate of ON events, and of OFF events, of a pixel whose voltage is `mean` without this noise. Nearly
    /// every event comes in a pair: an excursion to a threshold, and the way back.
    #[must_use]
    pub fn pairs(self, mean: f64) -> f64 {
        let Self { deviation, theta, up, down } = self;
        if deviation <= 0.0 {
            return 0.0;
        }
        let (time, on) = self.exit(0.0, [-down - mean, up - mean]);
        // After an event, the noise at that event is the new reference.
        let (after_on, _) = self.exit(up - mean, [up - mean - down, 2.0 * up - mean]);
        let (after_off, _) = self.exit(-down - mean, [-2.0 * down - mean, up - down - mean]);
        theta / (time + on * after_on + (1.0 - on) * after_off)
    }

    /// Mean time until the noise leaves an interval, in units of `1 / theta`, and the probability that it
    /// does so upwards.
    fn exit(self, from: f64, ends: [f64; 2]) -> (f64, f64) {
        let [low, high] = ends.map(|end| integrals(end / self.deviation));
        let at = integrals(from / self.deviation);
        let whole = high[0] - low[0];
        // Each share by itself: a small one would be lost in the difference from 1.
        let (up, down) = ((at[0] - low[0]) / whole, (high[0] - at[0]) / whole);
        if whole <= 0.0 { (f64::INFINITY, 0.5) } else { (down * low[1] + up * high[1] - at[1], up) }
    }
}

/// How far from a threshold the noise makes the events of a pixel that leaks towards it, instead of the leak.
///
/// At a distance `d` it does so at the rate `theta d/s / sqrt(2 pi) exp(-(d/s)^2 / 2)`, that of crossings of
/// a high level. The leak comes nearer by `leak` per time, so the expected number of events reaches 1 where
/// `exp((d/s)^2 / 2)` is `theta s / (leak sqrt(2 pi))`.
#[must_use]
pub fn leak_distance(deviation: f64, theta: f64, leak: f64) -> f64 {
    let crossings = theta * deviation / (leak.abs() * TAU.sqrt());
    deviation * (2.0 * libm::log(crossings.max(1.0))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean exit times from (-1, 1): 1/2 for a deviation that is large beside it (a Brownian motion of
    /// variance 2 deviation^2), and the asymptote `sqrt(pi/2) e^(z^2/2) / z` of a high level.
    #[test]
    fn exits_have_their_limits() {
        let noise = |deviation| ReceptorRate { deviation, theta: 1.0, up: 1.0, down: 1.0 };
        let (time, up) = noise(20.0).exit(0.0, [-1.0, 1.0]);
        assert!((time * 2.0 * 400.0 - 1.0).abs() < 2e-3 && (up - 0.5).abs() < 1e-12, "{time}");
        let (time, _) = noise(1.0 / 7.0).exit(0.0, [-1.0, 1.0]);
        let asymptote = FRAC_PI_2.sqrt() * libm::exp(0.5 * 49.0) / 7.0;
        // The next term of the series is 1/z^2.
        assert!((time / asymptote - 1.0 - 1.0 / 49.0).abs() < 2e-3, "{time} {asymptote}");
        // Mirrored, an exit upwards is one downwards.
        let ups = [-0.9, 0.9].map(|from| noise(0.3).exit(from, [-1.0, 1.0]).1);
        assert!((ups[0] + ups[1] - 1.0).abs() < 1e-12 && ups[0] < ups[1], "{ups:?}");
    }
}
