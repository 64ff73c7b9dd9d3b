//! Speed as a list of levels over equal parts of time, blended so that it is twice differentiable.
//!
//! With `L` levels `r`, segments of length `1/L` and `tau = blend / L`:
//!
//! ```text
//! v(t) = r_0 + sum over k = 1..L-1 of (r_k - r_(k-1)) H((t - k/L) / tau)
//! ```
//! `H` is the integral of the quadratic B-spline with knots -1, -1/3, 1/3, 1: a C2 step with slope
//! 9/8 at 0. Each window is `2 tau` wide and centred on its boundary. With `blend <= 1/2` no two
//! windows overlap, so `v` lies between neighbouring levels, and its integral over [0, 1] is the
//! mean of the levels.

use super::{SpeedLaw, SpeedMeaning};
use gs2e_num::se3::sum::NeumaierSum;
use serde::Serialize;

/// Positive levels and the width of the blend between them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpeedLevels {
    multipliers: Vec<f64>,
    blend: f64,
    meaning: SpeedMeaning,
}

/// The reason why levels are not a speed law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ListError {
    /// There are no levels.
    #[error("the list of multipliers is empty, wanted at least 1")]
    Empty,
    /// A level is not positive and finite.
    #[error("multiplier {index} (from 0) is {value}, wanted a positive finite number")]
    Level {
        /// Its index in the list, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The blend is out of range.
    #[error("blend is {value}, wanted a number from 0 to 0.5 (wider windows would overlap)")]
    Blend {
        /// Its value.
        value: f64,
    },
}

impl SpeedLevels {
    /// The law of `multipliers`. Each window extends over `blend` of a segment on both sides of its
    /// boundary.
    ///
    /// # Errors
    /// There are no levels, one is not positive and finite, or `blend` is not in [0, 0.5].
    pub fn new(multipliers: Vec<f64>, blend: f64, meaning: SpeedMeaning) -> Result<Self, ListError> {
        if multipliers.is_empty() {
            return Err(ListError::Empty);
        }
        if let Some((index, value)) =
            multipliers.iter().copied().enumerate().find(|(_, r)| !(*r > 0.0 && r.is_finite()))
        {
            return Err(ListError::Level { index, value });
        }
        if !(0.0..=0.5).contains(&blend) {
            return Err(ListError::Blend { value: blend });
        }
        Ok(Self { multipliers, blend, meaning })
    }

    /// The effect of large multipliers.
    #[must_use]
    pub fn meaning(&self) -> SpeedMeaning {
        self.meaning
    }

    /// The integral of the speed over [0, t], in closed form. `t` is clamped to [0, 1].
    #[must_use]
    pub fn distance(&self, t: f64) -> f64 {
        let t = t.clamp(0.0, 1.0);
        let segments = self.multipliers.len() as f64;
        let Some(k) = self.boundary(t) else { return self.multipliers[0] * t };
        let (before, after) = (self.multipliers[k - 1], self.multipliers[k]);
        // Before the middle of the previous segment, all windows are complete and count as plain
        // steps.
        let whole = NeumaierSum::sum_of(self.multipliers[..k - 1].iter().copied()) + before / 2.0;
        let from_boundary = t - k as f64 / segments;
        let tau = self.blend / segments;
        // Without a blend the step is a jump, and the quotient would be NaN at the boundary.
        let blended =
            if tau > 0.0 { tau * step_integral(from_boundary / tau) } else { from_boundary.max(0.0) };
        whole / segments + before * (from_boundary + 0.5 / segments) + (after - before) * blended
    }

    /// Index of the boundary nearest to `t`, 1 to L-1; `None` for a single level.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to 1..L before the cast"
    )]
    fn boundary(&self, t: f64) -> Option<usize> {
        let last = self.multipliers.len() - 1;
        (last > 0).then(|| (t * self.multipliers.len() as f64).round().clamp(1.0, last as f64) as usize)
    }
}

impl SpeedLaw for SpeedLevels {
    fn speed(&self, t: f64) -> f64 {
        let Some(k) = self.boundary(t) else { return self.multipliers[0] };
        let segments = self.multipliers.len() as f64;
        let from_boundary = t - k as f64 / segments;
        let tau = self.blend / segments;
        let h = if tau > 0.0 { blend_step(from_boundary / tau) } else { f64::from(from_boundary >= 0.0) };
        // A mean of two positive levels is positive for any ratio between them.
        self.multipliers[k - 1] * (1.0 - h) + self.multipliers[k] * h
    }

    fn distances(&self, steps: usize) -> Vec<f64> {
        (0..=steps).map(|k| self.distance(k as f64 / steps as f64)).collect()
    }

    fn roughness(&self) -> Option<String> {
        (self.blend == 0.0 && self.multipliers.len() > 1).then(|| "its levels are not blended".to_owned())
    }
}

/// The C2 step from 0 at -1 to 1 at 1.
fn blend_step(x: f64) -> f64 {
    // In `w` the knots of the B-spline are 0, 1, 2 and 3.
    let w = (1.5 * (x + 1.0)).clamp(0.0, 3.0);
    if w < 1.0 {
        w * w * w / 6.0
    } else if w < 2.0 {
        let r = w - 1.0;
        1.0 / 6.0 + r / 2.0 + r * r / 2.0 - r * r * r / 3.0
    } else {
        let r = 3.0 - w;
        1.0 - r * r * r / 6.0
    }
}

/// The integral of [`blend_step`] from -1 to `x`; for `x` beyond 1 it is `x`.
fn step_integral(x: f64) -> f64 {
    // No upper limit as in `blend_step`: beyond the last knot the integral goes on rising.
    let w = (1.5 * (x + 1.0)).max(0.0);
    let in_w = if w < 1.0 {
        w * w * w * w / 24.0
    } else if w < 2.0 {
        let r = w - 1.0;
        1.0 / 24.0 + r / 6.0 + r * r / 4.0 + r * r * r / 6.0 - r * r * r * r / 12.0
    } else {
        let r = (3.0 - w).max(0.0);
        // The step is point-symmetric, so its integral over the window (0 to 3 in `w`) is 1.5.
        w - 1.5 + r * r * r * r / 24.0
    };
    in_w / 1.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn list(multipliers: &[f64], blend: f64) -> SpeedLevels {
        SpeedLevels::new(multipliers.to_vec(), blend, SpeedMeaning::Speed).unwrap()
    }

    #[test]
    fn levels_are_reached_and_boundaries_are_half_way() {
        let law = list(&[1.0, 0.5, 2.0], 0.1);
        // 0.1 of a segment around 1/3 and 2/3 is blended; everything else is a level.
        for (t, want) in [(0.0, 1.0), (0.29, 1.0), (0.5, 0.5), (0.6, 0.5), (0.75, 2.0), (1.0, 2.0)] {
            assert!((law.speed(t) - want).abs() < 1e-15, "{t}");
        }
        assert!((law.speed(1.0 / 3.0) - 0.75).abs() < 1e-14);
        assert!((law.speed(2.0 / 3.0) - 1.25).abs() < 1e-14);
        // Slope 9/8 of the jump over tau = 1/30, at the boundary.
        let slope = (law.speed(2.0 / 3.0 + 1e-7) - law.speed(2.0 / 3.0 - 1e-7)) / 2e-7;
        assert!((slope - 1.5 * 9.0 / 8.0 * 30.0).abs() < 1e-5, "{slope}");
    }

    #[test]
    fn the_step_is_twice_differentiable_with_the_knots_that_it_claims() {
        // The second derivative of a quadratic B-spline's integral is piecewise linear: 0, 9/4,
        // -9/4, 0 at the knots.
        let h = 1e-4;
        let bend = |x: f64| (blend_step(x + h) - 2.0 * blend_step(x) + blend_step(x - h)) / (h * h);
        for (x, want) in
            [(-1.0, 0.0), (-1.0 / 3.0, 2.25), (0.0, 0.0), (1.0 / 3.0, -2.25), (1.0, 0.0), (-0.5, 1.6875)]
        {
            // Differences of a function with a third derivative up to 27/4 over 1e-4, and rounding
            // of 1e-16 over 1e-8.
            assert!((bend(x) - want).abs() < 2e-3, "{x}: {}", bend(x));
        }
        for x in [-1.0f64, -1.0 / 3.0, 1.0 / 3.0, 1.0] {
            assert!((blend_step(x.next_up()) - blend_step(x.next_down())).abs() < 1e-15);
            assert!((step_integral(x.next_up()) - step_integral(x.next_down())).abs() < 1e-15);
        }
        assert!((step_integral(1.0) - 1.0).abs() < 1e-15 && (step_integral(2.5) - 2.5).abs() < 1e-15);
        // Half the mean absolute value of a sum of three uniform draws of width 2/3: 13/32 of that
        // width, halved.
        assert!(step_integral(-1.0).abs() < 1e-300 && (step_integral(0.0) - 13.0 / 96.0).abs() < 1e-15);
    }

    #[test]
    fn unblended_levels_are_steps() {
        let law = list(&[1.0, 3.0], 0.0);
        assert!((law.speed(0.5f64.next_down()) - 1.0).abs() < 1e-15 && (law.speed(0.5) - 3.0).abs() < 1e-15);
        assert!((law.distance(0.75) - 1.25).abs() < 1e-15);
        assert!(law.roughness().is_some() && list(&[1.0], 0.0).roughness().is_none());
        assert!(list(&[1.0, 2.0], 0.1).roughness().is_none());
    }

    #[test]
    fn what_is_no_law_is_refused() {
        assert_eq!(SpeedLevels::new(vec![], 0.1, SpeedMeaning::Speed), Err(ListError::Empty));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                SpeedLevels::new(vec![1.0, bad], 0.1, SpeedMeaning::Speed),
                Err(ListError::Level { index: 1, .. })
            ));
        }
        for bad in [-0.1, 0.500_001, f64::NAN] {
            assert!(matches!(
                SpeedLevels::new(vec![1.0], bad, SpeedMeaning::Speed),
                Err(ListError::Blend { .. })
            ));
        }
    }

    proptest! {
        #[test]
        fn distance_is_the_integral_of_speed(
            exponents in prop::collection::vec(-6.0..6.0f64, 1..8),
            blend in 0.01..=0.5f64,
            t in 0.0..=1.0f64,
        ) {
            let levels: Vec<f64> = exponents.iter().map(|e| 10f64.powf(*e)).collect();
            let law = list(&levels, blend);
            let largest = levels.iter().copied().fold(0.0, f64::max);
            let smallest = levels.iter().copied().fold(f64::INFINITY, f64::min);
            prop_assert!(law.speed(t) >= smallest * (1.0 - 1e-15) && law.speed(t) <= largest * (1.0 + 1e-15));
            // The midpoint rule on 20,000 cells has an error of h^2/24 of the change of slope, at
            // most 2 * 9/8 * L/blend times the jumps: under 2e-6 of the largest level.
            let cells = 20_000;
            let width = t / f64::from(cells);
            let sum: f64 = (0..cells).map(|k| law.speed((f64::from(k) + 0.5) * width) * width).sum();
            prop_assert!((law.distance(t) - sum).abs() < 2e-6 * largest, "{} {sum}", law.distance(t));
            let mean = levels.iter().sum::<f64>() / levels.len() as f64;
            prop_assert!((law.distance(1.0) - mean).abs() <= 1e-14 * mean);
        }
    }
}
