//! First passages of a Brownian bridge: the barriers within reach, and the time of the first touch.
//!
//! Between fixed ends, the drift has no further influence: the path is a bridge from `x` to `y` of
//! variance `v`. It touches a barrier at distances `a` and `g` from its ends with probability
//! `exp(-2 a g / v)` (reflection principle). The ratio of the time before the touch to the time
//! after it is inverse Gaussian with mean `a/g` and shape `a^2/v`.

use fearless_simd::{Simd, SimdBase as _, f64x8, mask64x8};

/// A barrier counts as out of reach if the path touches it with a probability below `e^-40`, 4e-18.
pub(super) const NEGLIGIBLE: f64 = 40.0;

/// The two thresholds: an event happens where the voltage reaches `up` or `-down`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Barriers {
    /// Threshold of ON events, above 0.
    pub up: f64,
    /// Threshold of OFF events, above 0.
    pub down: f64,
}

/// The barriers that a path may touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LiveBarriers {
    Neither,
    Up,
    Down,
    Both,
}

impl Barriers {
    /// The barriers that a path from `x` to `y` with variance `v` may touch.
    pub(super) fn live(self, x: f64, y: f64, v: f64) -> LiveBarriers {
        match (within_reach(self.up - x, self.up - y, v), within_reach(self.down + x, self.down + y, v)) {
            (false, false) => LiveBarriers::Neither,
            (true, false) => LiveBarriers::Up,
            (false, true) => LiveBarriers::Down,
            (true, true) => LiveBarriers::Both,
        }
    }

    /// The barrier that a path from `x` to `y` touches with the larger probability.
    pub(super) fn likelier(self, x: f64, y: f64) -> BarrierSide {
        // The touch probability `exp(-2 a g / v)` falls with the product of the distances.
        // If the path ends beyond a barrier, that product is negative and the smaller one.
        if (self.up - x) * (self.up - y) <= (self.down + x) * (self.down + y) {
            BarrierSide::Up
        } else {
            BarrierSide::Down
        }
    }
}

/// The thresholds of eight pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct WideBarriers<S: Simd> {
    pub(super) up: f64x8<S>,
    pub(super) down: f64x8<S>,
}

impl<S: Simd> WideBarriers<S> {
    /// The thresholds of one pixel for all eight.
    #[inline(always)]
    pub(super) fn splat(simd: S, Barriers { up, down }: Barriers) -> Self {
        Self { up: f64x8::splat(simd, up), down: f64x8::splat(simd, down) }
    }

    /// Returns true if any barrier is within reach of paths from `x` to `y` with variance `v` that
    /// may differ from the straight line by `straying`. This is [`Barriers::live`] for eight
    /// pixels, with the barriers moved nearer by `straying`.
    #[inline(always)]
    pub(super) fn reached(self, [x, y]: [f64x8<S>; 2], v: f64x8<S>, straying: f64x8<S>) -> mask64x8<S> {
        let (up, down) = (self.up - straying, self.down - straying);
        is_within_reach([up - x, up - y], v) | is_within_reach([down + x, down + y], v)
    }
}

/// [`within_reach`] for eight pixels. A function and not a closure: a closure that the compiler leaves as a
/// call is compiled without the instruction set in use, and each operation in it becomes a call.
#[inline(always)]
fn is_within_reach<S: Simd>([a, g]: [f64x8<S>; 2], v: f64x8<S>) -> mask64x8<S> {
    // Without a division or an exponential: the probability is above `e^-40` where this holds.
    // It needs no case of its own for `v = 0`: then only barriers that the path passes are within reach.
    a.simd_le(0.0) | g.simd_le(0.0) | (a * g * 2.0).simd_lt(v * NEGLIGIBLE)
}

/// Returns true if a barrier at distances `a` and `g` from the ends (negative beyond the barrier)
/// is within reach.
fn within_reach(a: f64, g: f64, v: f64) -> bool {
    a <= 0.0 || g <= 0.0 || 2.0 * a * g < NEGLIGIBLE * v
}

/// One of the two barriers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BarrierSide {
    Up,
    Down,
}

impl BarrierSide {
    /// Distance of a voltage from the barrier; negative beyond it.
    pub(super) fn distance(self, barriers: Barriers, voltage: f64) -> f64 {
        match self {
            Self::Up => barriers.up - voltage,
            Self::Down => barriers.down + voltage,
        }
    }

    /// The voltage that an event subtracts from all later voltages.
    pub(super) fn step(self, barriers: Barriers) -> f64 {
        match self {
            Self::Up => barriers.up,
            Self::Down => -barriers.down,
        }
    }
}

/// Probability that the path touches a barrier at distances `a > 0` and `g` from its ends.
pub(super) fn touch_probability(a: f64, g: f64, v: f64) -> f64 {
    // The path crosses the barrier to reach its end. The formula would exceed 1.
    if g <= 0.0 { 1.0 } else { libm::exp(-2.0 * a * g / v) }
}

/// The time of the first touch, given that the path touches the barrier, as a share of the path's
/// length in 0..=1. `a > 0` and `g >= 0` are the distances of the ends from the barrier, on either
/// side; `z` is a standard normal deviate and `u` a uniform one.
///
/// Inverse Gaussian by Michael, Schucany and Haas (The American Statistician 30, 1976), in a form
/// that adds only numbers of like sign. It therefore holds for every `phi = a g / v`; at `phi = 0`
/// it is the Lévy distribution.
pub fn touch_time(a: f64, g: f64, v: f64, z: f64, u: f64) -> f64 {
    const HUGE: f64 = 1e290;
    let (shape, phi) = (a * a / v, a * g / v);
    // Without noise, or with next to none, the path is straight. Larger numbers would overflow
    // below.
    let noisy = v > 0.0 && shape < HUGE && phi < HUGE;
    if !noisy {
        return a / (a + g);
    }
    // The transform depends on `z^2` only. With a positive `z` no difference is taken.
    let z = z.abs();
    let q = phi + 0.5 * z * z + z * (0.25 * z * z + phi).sqrt();
    // The roots of the transform are `shape/q` and the square of the mean over it. The first is
    // taken with probability mean / (mean + root), here without a division.
    // With `g = 0`, `phi` is 0 and the condition always holds, so the second form never divides by 0.
    let ratio = if u * (q + phi) <= q { shape / q } else { a / g * (q / phi) };
    // An infinite ratio is a touch at the end. The quotient would be NaN.
    if ratio.is_finite() { ratio / (1.0 + ratio) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell, ks};
    use gs2e_testing::rival;
    use std::f64::consts::{PI, SQRT_2};

    fn draws(index: u64) -> CellDraws {
        Seed(7).draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Leaf)
    }

    /// Distribution function of the inverse Gaussian of mean `mean` (infinite: the Lévy
    /// distribution) and shape `shape`. With `w = sqrt(shape/t)(t/mean + 1)`, its second term is
    /// `exp(-e) Phi(-w) exp(w^2/2)`, which does not overflow.
    fn inverse_gaussian(t: f64, mean: f64, shape: f64) -> f64 {
        let root = (shape / t).sqrt();
        let (below, above) = (root * (t / mean - 1.0), root * (t / mean + 1.0));
        let tail = if above < 20.0 {
            0.5 * libm::erfc(above / SQRT_2) * (0.5 * above * above).exp()
        } else {
            // Asymptotic series. The next term is 15/w^6 = 2e-7 of it.
            (1.0 - 1.0 / above.powi(2) + 3.0 / above.powi(4)) / (above * (2.0 * PI).sqrt())
        };
        0.5 * libm::erfc(-below / SQRT_2) + (-0.5 * below * below).exp() * tail
    }

    /// KS distance of touch times from their law for ends at distances 1 and `g` and variance 1.
    /// `defect` distorts the times.
    fn touch_time_distance(g: f64, defect: fn(f64) -> f64) -> f64 {
        let mut draws = draws(0);
        let times = (0..20_000).map(|_| {
            let share = touch_time(1.0, g, 1.0, draws.normal(), draws.uniform());
            assert!(share > 0.0 && share <= 1.0, "g = {g:e}: {share:e}");
            defect(share / (1.0 - share))
        });
        ks::scaled_distance(
            times.collect(),
            |t| if t < 1e300 { inverse_gaussian(t, 1.0 / g, 1.0) } else { 1.0 },
        )
    }

    #[test]
    fn touch_times_have_the_law_of_the_bridge() {
        // Mean over shape from 1e-9 to 1e18, and the Lévy distribution.
        for g in [1e9, 1e6, 1e3, 10.0, 1.0, 0.1, 1e-3, 1e-6, 1e-12, 1e-18, 0.0] {
            let distance = touch_time_distance(g, |t| t);
            println!("phi = {g:e}: KS {distance:.3} (alpha 1e-6: 2.69)");
            assert!(distance < 2.69);
        }
    }

    /// The time before the touch over the time after it is inverse Gaussian of mean `a / g` and
    /// shape `a^2 / v`.
    #[test]
    fn touch_times_are_distributed_as_those_of_rand_distr() {
        for (index, [a, g, v]) in [
            [1.0, 1.0, 1.0],
            [0.3, 1.2, 0.5],
            [2.0, 0.5, 1.0],
            [1.0, 5.0, 0.2],
            [0.1, 0.1, 1.0],
            [3.0, 2.0, 0.1],
        ]
        .into_iter()
        .enumerate()
        {
            let mut draws = draws(100 + index as u64);
            let ratio = |share: f64| share / (1.0 - share);
            let ours: Vec<f64> =
                (0..rival::N).map(|_| ratio(touch_time(a, g, v, draws.normal(), draws.uniform()))).collect();
            let law = rand_distr::InverseGaussian::new(a / g, a * a / v).unwrap();
            rival::compare(&format!("bridge {a} {g} {v}"), &ours, &rival::theirs(&law), |t| 1.1 * t);
        }
    }

    #[test]
    fn times_twice_too_long_are_noticed() {
        // This is the defect of the published program where the drift is 0.
        let distance = touch_time_distance(0.0, |t| 2.0 * t);
        println!("KS {distance:.3} (alpha 1e-6: 2.69)");
        assert!(distance > 2.69);
    }

    #[test]
    fn no_magnitude_makes_a_time_outside_the_span() {
        let magnitudes = [1e-300, 1e-150, 1e-12, 1.0, 1e12, 1e150, 1e300];
        let mut draws = draws(1);
        for a in magnitudes {
            for g in magnitudes.into_iter().chain([0.0]) {
                for v in magnitudes.into_iter().chain([0.0]) {
                    let share = touch_time(a, g, v, draws.normal(), draws.uniform());
                    assert!((0.0..=1.0).contains(&share), "{a:e} {g:e} {v:e}: {share}");
                }
            }
        }
    }

    #[test]
    fn without_noise_the_path_is_straight() {
        assert!((touch_time(0.25, 0.75, 0.0, 1.3, 0.2) - 0.25).abs() < 1e-16);
    }

    #[test]
    fn barriers_within_reach() {
        let unit = Barriers { up: 1.0, down: 1.0 };
        let t = |x, y, v, live| assert_eq!(unit.live(x, y, v), live, "{x} {y} {v}");
        t(0.0, 0.0, 0.0, LiveBarriers::Neither);
        t(0.0, 1.0, 0.0, LiveBarriers::Up);
        t(0.0, -1.5, 0.0, LiveBarriers::Down);
        t(0.0, 0.0, 0.049, LiveBarriers::Neither);
        t(0.0, 0.0, 0.051, LiveBarriers::Both);
        t(0.9, 0.9, 0.001, LiveBarriers::Up);
    }
}
