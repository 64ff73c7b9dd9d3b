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

/// Voltages of a pixel, without its noise, after a long time in constant light.
///
/// A pair of events moves the reference by the difference of the thresholds, and the leak moves it too. So
/// the voltage walks: it stays where pairs are rare, and hurries where they are frequent. It walks in a
/// circle, because a pixel at one end of the range makes the same pairs as one at the other, one event later.
/// The circle has [`PHASES`] places. The walk from place to place is a Markov chain in continuous time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingVoltages {
    range: [f64; 2],
    /// Share of the time up to the end of each place.
    below: [f64; PHASES],
    /// Mean rate of pairs.
    pub pairs: f64,
}

/// Places of the circle. The mean rate of a noise from 0.15 to 0.3 of the thresholds is 0.3 % off.
pub const PHASES: usize = 32;

impl ReceptorRate {
    /// The voltages of a pixel with this leak, thresholds per unit of time. The thresholds may differ by a
    /// small share; where they differ much, events do not come in pairs.
    #[must_use]
    pub fn at_rest(self, leak: f64) -> RestingVoltages {
        let Self { deviation, theta, up, down } = self;
        let half = 0.5 * (up + down);
        let distance = leak_distance(deviation, theta, leak).min(0.5 * half);
        let range = if leak == 0.0 {
            [-0.5 * down, 0.5 * up]
        } else if leak > 0.0 {
            [-distance, up - distance]
        } else {
            [distance - down, distance]
        };
        let step = (range[1] - range[0]) / PHASES as f64;
        let pairs: [f64; PHASES] =
            std::array::from_fn(|place| self.pairs(range[0] + (place as f64 + 0.5) * step));
        // Without a leak, the time at each place is that of a pair, whatever a pair moves.
        let moved = if leak == 0.0 { 1.0 } else { down - up };
        let towards = |sign: f64| {
            // A voltage without any noise stays where it is.
            pairs.map(|pairs| {
                let moved = (sign * moved).max(0.0) * pairs.max(f64::MIN_POSITIVE);
                ((sign * leak).max(0.0) + moved) / step
            })
        };
        let mut below = time_on_a_circle(towards(1.0), towards(-1.0));
        let mean = pairs.iter().zip(&below).map(|(pairs, share)| pairs * share).sum();
        let mut sum = 0.0;
        for share in &mut below {
            sum += *share;
            *share = sum;
        }
        RestingVoltages { range, below, pairs: mean }
    }
}

impl RestingVoltages {
    /// The quantile `u` of the voltage.
    #[must_use]
    pub fn quantile(&self, u: f64) -> f64 {
        let place = self.below.partition_point(|&below| below <= u).min(PHASES - 1);
        let before = if place == 0 { 0.0 } else { self.below[place - 1] };
        let within = ((u - before) / (self.below[place] - before)).clamp(0.0, 1.0);
        self.range[0] + (self.range[1] - self.range[0]) * (place as f64 + within) / PHASES as f64
    }
}

/// Shares of the time that a walk on a circle spends at its places, from its rates to the next and to the
/// previous place. Places are eliminated from the last on, without a subtraction (Grassmann, Taksar and
/// Heyman, Operations Research 33, 1985).
fn time_on_a_circle(mut next: [f64; PHASES], mut previous: [f64; PHASES]) -> [f64; PHASES] {
    // The rates at which each eliminated place was entered from the place before it, and from place 0.
    let mut entered = [[0.0; 2]; PHASES];
    for last in (2..PHASES).rev() {
        entered[last] = [next[last - 1], previous[0]];
        // What a walk does in the place is a step between its neighbours, or none.
        let leaving = next[last] + previous[last];
        next[last - 1] *= next[last] / leaving;
        previous[0] *= previous[last] / leaving;
    }
    // Two places are left, with two ways between them.
    let mut shares = [0.0; PHASES];
    [shares[0], shares[1]] = [next[1] + previous[1], next[0] + previous[0]];
    for place in 2..PHASES {
        let [from_before, from_first] = entered[place];
        let entering = shares[place - 1] * from_before + shares[0] * from_first;
        shares[place] = entering / (next[place] + previous[place]);
    }
    let sum: f64 = shares.iter().sum();
    shares.map(|share| share / sum)
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
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

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

    /// Events and voltages by a walk that is played out: the phase moves with the leak, and jumps by the
    /// difference of the thresholds at every pair.
    fn played([up, down]: [f64; 2], deviation: f64, leak: f64) -> (f64, [f64; 3]) {
        let noise = ReceptorRate { deviation, theta: 190.0, up, down };
        let mut draws = Seed(3).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Leaf);
        let (mut x, mut pairs, step) = (0.0f64, 0.0, 0.02);
        let resting = noise.at_rest(leak);
        let [low, high] = resting.range;
        let mut at = Vec::new();
        for _ in 0..400_000 {
            if draws.uniform() < noise.pairs(x) * step {
                x += down - up;
                pairs += 1.0;
            }
            x = low + (x + leak * step - low).rem_euclid(high - low);
            at.push(x);
        }
        at.sort_by(f64::total_cmp);
        (pairs / (400_000.0 * step), [0.1, 0.5, 0.9].map(|u| at[(u * 400_000.0) as usize]))
    }

    #[test]
    fn voltages_at_rest_are_those_of_a_walk() {
        // The difference of the thresholds acts alone, helps the leak, and holds it off.
        for (thresholds, deviation, leak) in
            [([1.02, 0.98], 0.25, 0.0), ([0.97, 1.03], 0.25, 0.05), ([1.03, 0.97], 0.25, 0.05)]
        {
            let (pairs, wanted) = played(thresholds, deviation, leak);
            let [up, down] = thresholds;
            let found = ReceptorRate { deviation, theta: 190.0, up, down }.at_rest(leak);
            let quantiles = [0.1, 0.5, 0.9].map(|u| found.quantile(u));
            println!(
                "{thresholds:?} {leak}: pairs {:.3} {pairs:.3}, {quantiles:.3?} {wanted:.3?}",
                found.pairs
            );
            assert!((found.pairs / pairs - 1.0).abs() < 0.1);
            for (found, wanted) in quantiles.into_iter().zip(wanted) {
                // A place is 1/32 wide.
                assert!((found - wanted).abs() < 0.05);
            }
        }
    }

    /// Few places are enough: the harmonic mean over 32 is that over 4096.
    #[test]
    fn rates_at_rest_need_few_places() {
        for deviation in [0.15, 0.2, 0.3] {
            let noise = ReceptorRate { deviation, theta: 1.0, up: 1.0, down: 1.0 };
            let n = 4096;
            let inverse = (0..n).map(|i| 1.0 / noise.pairs((f64::from(i) + 0.5) / f64::from(n) - 0.5));
            let wanted = f64::from(n) / inverse.sum::<f64>();
            let found = noise.at_rest(0.0).pairs;
            println!("{deviation}: {:.3}", found / wanted);
            assert!((found / wanted - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn a_leak_without_noise_passes_all_voltages() {
        let still = ReceptorRate { deviation: 0.0, theta: 190.0, up: 1.2, down: 0.7 };
        let [leaks, rests] = [0.1, 0.0].map(|leak| still.at_rest(leak));
        assert!((leaks.quantile(0.25) - 0.3).abs() < 1e-9 && leaks.pairs == 0.0);
        assert!(rests.quantile(0.5).is_finite() && rests.pairs == 0.0);
    }
}
