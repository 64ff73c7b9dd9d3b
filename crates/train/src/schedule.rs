//! Rates, sizes of the photos, degrees of the harmonics and numbers of Gaussians in the course of a
//! training.
//!
//! Rates are those of B. Kerbl et al. 2023 (GitHub graphdeco-inria/gaussian-splatting,
//! `arguments/__init__.py`) for 30,000 iterations, and larger for fewer:
//! `crates/lab/results/training.md` has the trials.

use gs2e_scene::sh;

/// Number of levels of the photos: full, half and quarter size.
pub(super) const LEVELS: usize = 3;
/// Shares of the training at which half and full size begin.
const LEVEL_STARTS: [f64; LEVELS - 1] = [0.15, 0.45];
/// Shares of the training between which Gaussians are placed, and at which the budget is reached.
const PLACE_FROM: f64 = 0.02;
const PLACE_UNTIL: f64 = 0.85;
const BUDGET_AT: f64 = 0.5;
/// Iterations between two placements, at most.
const PLACE_EVERY: u32 = 100;
/// Largest growth of one placement.
const MAX_GROWTH: f64 = 1.2;
/// Iterations after which the harmonics get another degree, at most.
const DEGREE_EVERY: u32 = 1000;
/// Iterations of a short training, for which the rates below were found.
const SHORT: f64 = 2000.0;
/// Least factor on the rates: that of the published ones.
const LEAST_FACTOR: f64 = 1.0 / 6.0;
/// Factor by which the rate of positions falls over the training.
const POSITION_FALL: f64 = 0.01;
/// Factor by which the other rates fall in the rest of the training, and the share at which they
/// begin to. Rates that do not fall end in noise: 0.5 dB on photos that are held out.
const FALL: f64 = 0.1;
const FALL_FROM: f64 = 0.5;

/// Time of a Gaussian in an iteration, in the time that a pixel takes; measured, see
/// `crates/lab/results/training.md`.
const PIXELS_A_GAUSSIAN: f64 = 2.0;

/// Step sizes of Adam, by group of parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LearningRates {
    /// Positions, scene units.
    pub(super) position: f32,
    /// Logarithms of scales.
    pub(super) log_scale: f32,
    /// Quaternions.
    pub(super) rotation: f32,
    /// Logits of opacities.
    pub(super) logit: f32,
    /// Harmonic of degree 0.
    pub(super) colour: f32,
    /// Higher harmonics.
    pub(super) harmonics: f32,
}

/// The course of a training.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrainingSchedule {
    /// Number of iterations.
    pub(super) iterations: u32,
    /// Number of Gaussians at the start, and at most.
    pub(super) gaussians: [usize; 2],
    /// Scene units in which positions are measured: 1.1 times the largest distance of a camera from
    /// the cameras' mean.
    pub(super) extent: f64,
    /// Mean number of pixels of a photo at the size of training.
    pub(super) pixels: f64,
}

impl TrainingSchedule {
    /// Share of the training that is over at an iteration.
    fn share(&self, iteration: u32) -> f64 {
        f64::from(iteration) / f64::from(self.iterations)
    }

    /// The level of the photos: 0 is full size.
    pub(super) fn level(&self, iteration: u32) -> usize {
        let share = self.share(iteration);
        LEVEL_STARTS.iter().filter(|start| share < **start).count()
    }

    /// The work of the iterations from `from` to `to`, in the time that a pixel takes.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from `from` to `to`")]
    pub(super) fn work(&self, from: u32, to: u32) -> f64 {
        const SAMPLES: u32 = 200;
        let count = to.saturating_sub(from);
        let width = f64::from(count) / f64::from(SAMPLES);
        let at = |k: u32| (f64::from(from) + (f64::from(k) + 0.5) * width) as u32;
        width * (0..SAMPLES).map(|k| self.work_of(at(k))).sum::<f64>()
    }

    fn work_of(&self, iteration: u32) -> f64 {
        let level = i32::try_from(self.level(iteration)).unwrap_or(0);
        // Each level halves both sides of a photo.
        PIXELS_A_GAUSSIAN * self.planned_count(iteration) + self.pixels / 4.0_f64.powi(level)
    }

    /// The highest degree of harmonics that is fitted.
    pub(super) fn degree(&self, iteration: u32) -> u8 {
        let every = (self.iterations / 10).clamp(1, DEGREE_EVERY);
        u8::try_from(iteration / every).unwrap_or(u8::MAX).min(sh::MAX_DEGREE)
    }

    /// The step sizes.
    #[expect(clippy::cast_possible_truncation, reason = "rounded once, after the arithmetic")]
    pub(super) fn rates(&self, iteration: u32) -> LearningRates {
        let first = libm::sqrt(SHORT / f64::from(self.iterations)).clamp(LEAST_FACTOR, 1.0);
        let share = self.share(iteration);
        let late = ((share - FALL_FROM) / (1.0 - FALL_FROM)).max(0.0);
        let factor = first * libm::pow(FALL, late);
        LearningRates {
            // Positions fall over the whole training, so the late fall of the other rates is not theirs.
            position: (1.28e-3 * first * self.extent * libm::pow(POSITION_FALL, share)) as f32,
            log_scale: (0.03 * factor) as f32,
            rotation: (0.006 * factor) as f32,
            logit: (0.1 * factor) as f32,
            colour: (0.015 * factor) as f32,
            harmonics: (0.001 * factor) as f32,
        }
    }

    /// Returns true if Gaussians are placed after this many iterations.
    pub(super) fn places(&self, iteration: u32) -> bool {
        self.is_stop(iteration) && (PLACE_FROM..PLACE_UNTIL).contains(&self.share(iteration))
    }

    /// Returns true if sizes are limited after this many iterations.
    pub(super) fn limits(&self, iteration: u32) -> bool {
        self.is_stop(iteration) || iteration == self.iterations
    }

    /// Returns true if something is done between iterations.
    fn is_stop(&self, iteration: u32) -> bool {
        iteration.is_multiple_of((self.iterations / 40).clamp(1, PLACE_EVERY))
    }

    /// The number of Gaussians after the placement at this iteration, where `count` were before.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the budget")]
    pub(super) fn count_after(&self, iteration: u32, count: usize) -> usize {
        let wanted = self.planned_count(iteration).min(MAX_GROWTH * count as f64);
        (wanted.round() as usize).max(count)
    }

    /// The number of Gaussians at an iteration, if parents were never scarce.
    fn planned_count(&self, iteration: u32) -> f64 {
        let [start, budget] = self.gaussians.map(|n| n.max(1) as f64);
        let done = (self.share(iteration) / BUDGET_AT).min(1.0);
        start * libm::pow(budget / start, done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(iterations: u32) -> TrainingSchedule {
        TrainingSchedule { iterations, gaussians: [5000, 40_000], extent: 2.0, pixels: 1e4 }
    }

    #[test]
    fn photos_grow_and_harmonics_follow() {
        let s = schedule(1000);
        let levels = [0, 149, 150, 449, 450, 999].map(|i| s.level(i));
        assert_eq!(levels, [2, 2, 1, 1, 0, 0]);
        assert_eq!([0, 99, 100, 300, 999].map(|i| s.degree(i)), [0, 0, 1, 3, 3]);
        assert_eq!(schedule(30_000).degree(2999), 2);
    }

    #[test]
    fn the_budget_is_reached_in_the_middle_and_never_exceeded() {
        for iterations in [1000, 2000, 10_000] {
            let s = schedule(iterations);
            let mut count = 5000;
            for i in (0..iterations).filter(|i| s.places(*i)) {
                let after = s.count_after(i, count);
                assert!(after >= count && after as f64 <= 1.2 * count as f64 + 0.5 && after <= 40_000);
                count = after;
                if i >= iterations * 11 / 20 {
                    assert_eq!(count, 40_000, "{iterations}: at {i}");
                }
            }
        }
    }

    /// Work is additive, and an iteration of small photos costs less.
    #[test]
    fn the_work_of_parts_is_the_work_of_the_whole() {
        let s = schedule(1000);
        let [whole, first, last] = [(0, 1000), (0, 450), (450, 1000)].map(|(a, b)| s.work(a, b));
        // Each sum of 200 samples of a monotone rate is right to half a sample at each jump.
        assert!((first + last - whole).abs() < 0.01 * whole, "{first} + {last}, {whole}");
        assert!(first < last && s.work(7, 7) == 0.0);
    }

    #[test]
    fn long_trainings_have_the_published_rates() {
        let r = schedule(100_000).rates(0);
        // `arguments/__init__.py`: 0.005, 0.001, 0.0025; positions 1.6e-4 times the extent.
        assert!((r.log_scale - 0.005).abs() < 1e-8 && (r.rotation - 0.001).abs() < 1e-9);
        assert!((r.colour - 0.0025).abs() < 1e-9);
        let [first, last] = [0, 2000].map(|i| schedule(2000).rates(i).position);
        assert!((first / last - 100.0).abs() < 1e-3);
        // The others stay for half of the training, then fall to a tenth.
        let [first, late, last] = [0, 1000, 2000].map(|i| schedule(2000).rates(i).log_scale);
        assert!(first.to_bits() == late.to_bits() && (first / last - 10.0).abs() < 1e-4);
    }
}
