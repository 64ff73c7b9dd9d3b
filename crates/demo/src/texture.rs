//! Patterns as functions of place: noise on a lattice, and edges and stripes filtered for wide
//! surfels.

use super::draw::unit_interval;
use glam::DVec3;
use gs2e_num::seed::split_mix::{STEP, finalise_bits};

/// A number from 0 to 1 for the lattice point `(x, y)`.
pub(super) fn lattice_value(seed: u64, x: i64, y: i64) -> f64 {
    // As in SplitMix64, an increment comes before the finaliser, which maps 0 to 0.
    let row = finalise_bits(seed.wrapping_add(STEP).wrapping_add(y.cast_unsigned().wrapping_mul(STEP)));
    unit_interval(finalise_bits(row ^ x.cast_unsigned().wrapping_mul(STEP)))
}

/// Smooth noise from 0 to 1 with features of size 1: the numbers of the lattice, blended by
/// quintics.
#[expect(clippy::cast_possible_truncation, reason = "coordinates of a scene a few units wide")]
pub(super) fn value_noise(seed: u64, x: f64, y: f64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let (i, j) = (x0 as i64, y0 as i64);
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (s, t) = (fade(x - x0), fade(y - y0));
    let low = mix_values(lattice_value(seed, i, j), lattice_value(seed, i + 1, j), s);
    let high = mix_values(lattice_value(seed, i, j + 1), lattice_value(seed, i + 1, j + 1), s);
    mix_values(low, high, t)
}

/// Three octaves of [`value_noise`], of 0 to 1.
pub(super) fn cloud_noise(seed: u64, x: f64, y: f64) -> f64 {
    (4.0 * value_noise(seed, x, y)
        + 2.0 * value_noise(seed.wrapping_add(1), 2.0 * x, 2.0 * y)
        + value_noise(seed.wrapping_add(2), 4.0 * x, 4.0 * y))
        / 7.0
}

/// From `a` at `t = 0` to `b` at `t = 1`.
pub(super) fn mix_values(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// From 0 below `low` to 1 above `high`, smoothly.
pub(super) fn smooth_step(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The share of a window of size `window` around `x` that lies in the stripes
/// `[k period, k period + width)`: a stripe pattern seen through a surfel of that size, so that
/// patterns finer than the surfels blur and do not alias.
pub(super) fn stripe_share(x: f64, period: f64, width: f64, window: f64) -> f64 {
    let covered = |x: f64| {
        // Whole periods before `x`, then the part of the stripe in the last one.
        let turns = (x / period).floor();
        turns * width + (x - turns * period).min(width)
    };
    (covered(x + window / 2.0) - covered(x - window / 2.0)) / window
}

/// A colour between two.
pub(super) fn blend_colours(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_stays_in_its_range_and_agrees_with_the_lattice() {
        for i in -20..20_i64 {
            let (x, y) = (i as f64 * 0.37, i as f64 * -1.13);
            assert!((0.0..1.0).contains(&value_noise(7, x, y)) && (0.0..1.0).contains(&cloud_noise(7, x, y)));
            assert!((value_noise(7, i as f64, -2.0) - lattice_value(7, i, -2)).abs() < 1e-15);
        }
    }

    /// Coverage by counting: a window of 100,000 points.
    #[test]
    fn stripes_are_seen_through_a_window() {
        for (x, window) in [(0.3, 0.05), (-0.71, 0.4), (2.0, 1.7), (0.0, 0.3)] {
            let inside = (0..100_000)
                .filter(|&i| (x + window * ((f64::from(i) + 0.5) / 1e5 - 0.5)).rem_euclid(0.5) < 0.2)
                .count() as f64
                / 1e5;
            assert!((stripe_share(x, 0.5, 0.2, window) - inside).abs() < 1e-4, "{x}, {window}");
        }
    }
}
