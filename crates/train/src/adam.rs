//! Adam, with an age per Gaussian.
//!
//! D. P. Kingma and J. Ba, "Adam: A Method for Stochastic Optimization", ICLR 2015, algorithm 1. It
//! departs in one point: only the Gaussians that the view draws take a step, and the correction of
//! the bias counts their own steps, not the iterations. A Gaussian that is new, or rarely seen, would
//! otherwise start with means that are corrected as if they were old.

use super::schedule::LearningRates;
use fearless_simd::{Level, dispatch};
use gs2e_render::cpu::backward::{GaussianGradient, ViewGradients};
use gs2e_scene::{Gaussians, sh};
use rayon::prelude::*;

/// Decay of the means of the gradient and of its square.
const DECAY: [f32; 2] = [0.9, 0.999];
/// Added to the root of the mean square.
const EPSILON: f32 = 1e-15;
/// Parameters of a Gaussian other than its harmonics: position, log scale, rotation, logit.
pub(super) const GEOMETRY: usize = 11;
/// Gaussians of one task.
const RANGE: usize = 1024;
/// Ages from which on the corrections are 1 to the last bit of 32.
const OLD: usize = 20_000;

/// Means of gradients and of their squares, and the number of steps, of every Gaussian.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct AdamMeans {
    /// Mean and mean square of the geometry's gradients.
    pub(super) geometry: [Vec<[f32; GEOMETRY]>; 2],
    /// Mean and mean square of the harmonics' gradients, laid out as `Gaussians::sh`.
    pub(super) harmonics: [Vec<[f32; 3]>; 2],
    /// Number of steps.
    pub(super) ages: Vec<u32>,
}

/// A gradient that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotFinite {
    /// Index of the Gaussian.
    pub(super) gaussian: u32,
}

/// The corrections of the bias by age: `1 / (1 - decay^age)` for the mean, its root for the mean
/// square.
#[derive(Debug)]
pub(super) struct BiasTable(Vec<[f32; 2]>);

impl BiasTable {
    #[expect(clippy::cast_possible_truncation, reason = "rounded once, after the arithmetic")]
    pub(super) fn new() -> Self {
        // In 64 bits: `1 - 0.999` has lost four digits in 32, and every step of a young Gaussian is
        // divided by it.
        let mut powers = [1.0_f64; 2];
        let entry = |_| {
            for (power, decay) in powers.iter_mut().zip(DECAY) {
                *power *= f64::from(decay);
            }
            [(1.0 / (1.0 - powers[0])) as f32, libm::sqrt(1.0 / (1.0 - powers[1])) as f32]
        };
        Self((0..OLD).map(entry).collect())
    }

    fn at(&self, age: u32) -> [f32; 2] {
        // The last entry stands for all greater ages, at which both corrections round to 1.
        self.0[(age as usize).clamp(1, OLD) - 1]
    }
}

/// The Gaussians of one task: parameters and means.
struct AdamRange<'a> {
    positions: &'a mut [[f32; 3]],
    log_scales: &'a mut [[f32; 3]],
    rotations: &'a mut [[f32; 4]],
    logits: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
    geometry: [&'a mut [[f32; GEOMETRY]]; 2],
    harmonics: [&'a mut [[f32; 3]]; 2],
    ages: &'a mut [u32],
    /// Number of harmonics of a Gaussian.
    sh_len: usize,
}

impl AdamMeans {
    /// Room for the means of `gaussians`, so that growth moves no array.
    pub(super) fn reserve(&mut self, gaussians: usize, sh_len: usize) {
        self.geometry.iter_mut().for_each(|means| means.reserve_exact(gaussians));
        self.harmonics.iter_mut().for_each(|means| means.reserve_exact(gaussians * sh_len));
        self.ages.reserve_exact(gaussians);
    }

    /// Means for these Gaussians that took no step yet.
    pub(super) fn resize(&mut self, gaussians: usize, sh_len: usize) {
        self.geometry.iter_mut().for_each(|means| means.resize(gaussians, [0.0; GEOMETRY]));
        self.harmonics.iter_mut().for_each(|means| means.resize(gaussians * sh_len, [0.0; 3]));
        self.ages.resize(gaussians, 0);
    }

    /// Forgets the steps of a Gaussian.
    pub(super) fn forget(&mut self, i: usize, sh_len: usize) {
        self.geometry.iter_mut().for_each(|means| means[i] = [0.0; GEOMETRY]);
        self.harmonics.iter_mut().for_each(|means| means[i * sh_len..(i + 1) * sh_len].fill([0.0; 3]));
        self.ages[i] = 0;
    }

    /// One step of all drawn Gaussians.
    ///
    /// # Errors
    /// A gradient is not finite. The Gaussian with the lowest index is named; others may have moved.
    pub(super) fn step(
        &mut self,
        scene: &mut Gaussians,
        found: &ViewGradients,
        steps: &StepSizes<'_>,
    ) -> Result<(), NotFinite> {
        let sh_len = scene.sh_len();
        // All arrays are cut at the same Gaussians. A task then owns every parameter of its range,
        // and no lock or atomic addition can make the result depend on the schedule.
        let [g0, g1] = &mut self.geometry;
        let [h0, h1] = &mut self.harmonics;
        let parts = (
            scene.positions.par_chunks_mut(RANGE),
            scene.log_scales.par_chunks_mut(RANGE),
            scene.rotations.par_chunks_mut(RANGE),
            scene.opacity_logits.par_chunks_mut(RANGE),
            scene.sh.par_chunks_mut(RANGE * sh_len),
            g0.par_chunks_mut(RANGE),
            g1.par_chunks_mut(RANGE),
            h0.par_chunks_mut(RANGE * sh_len),
            h1.par_chunks_mut(RANGE * sh_len),
            self.ages.par_chunks_mut(RANGE),
        );
        let level = Level::new();
        let worst = parts.into_par_iter().enumerate().map(|(k, part)| {
            let (positions, log_scales, rotations, logits, sh, g0, g1, h0, h1, ages) = part;
            let mut range = AdamRange {
                positions,
                log_scales,
                rotations,
                logits,
                sh,
                geometry: [g0, g1],
                harmonics: [h0, h1],
                ages,
                sh_len,
            };
            let first = k * RANGE;
            // The drawn Gaussians ascend, so those of a range are found by halving.
            let at = |number: usize| found.numbers.partition_point(|n| (*n as usize) < number);
            let mine = at(first)..at(first + RANGE);
            let entries = found.numbers[mine.clone()].iter().zip(&found.gradients[mine]);
            dispatch!(level, _simd => range.step_all(entries, first, steps))
        });
        // The least index over all tasks, not that of the task that ends first: each run names the
        // same Gaussian.
        match worst.flatten().min() {
            Some(gaussian) => Err(NotFinite { gaussian }),
            None => Ok(()),
        }
    }
}

/// Common parameters of the steps of all Gaussians.
pub(super) struct StepSizes<'a> {
    pub(super) rates: &'a LearningRates,
    /// Highest degree of harmonics that is evaluated.
    pub(super) degree: u8,
    pub(super) bias: &'a BiasTable,
}

impl AdamRange<'_> {
    /// Steps of the range's Gaussians. Returns the first one with a gradient that is not finite.
    #[inline(always)]
    fn step_all<'g>(
        &mut self,
        entries: impl Iterator<Item = (&'g u32, &'g GaussianGradient)>,
        first: usize,
        steps: &StepSizes<'_>,
    ) -> Option<u32> {
        for (&number, gradient) in entries {
            if !is_finite(gradient) {
                return Some(number);
            }
            self.step_one(number as usize - first, gradient, steps);
        }
        None
    }

    #[inline(always)]
    fn step_one(&mut self, i: usize, g: &GaussianGradient, steps: &StepSizes<'_>) {
        let r = steps.rates;
        // The age counts the views that draw this Gaussian. The number of the iteration would take
        // the bias of a new Gaussian's means for removed.
        self.ages[i] = self.ages[i].saturating_add(1);
        let corrections = steps.bias.at(self.ages[i]);
        let ([a, b, c], [d, e, f], [h, j, k, l]) = (g.position, g.log_scale, g.rotation);
        let gradient = [a, b, c, d, e, f, h, j, k, l, g.logit];
        let (p, s, q) = (r.position, r.log_scale, r.rotation);
        let rate = [p, p, p, s, s, s, q, q, q, q, r.logit];
        let [m, v] = &mut self.geometry;
        let mut moves = [0.0; GEOMETRY];
        for n in 0..GEOMETRY {
            moves[n] = rate[n] * direction(gradient[n], &mut m[i][n], &mut v[i][n], corrections);
        }
        for n in 0..3 {
            self.positions[i][n] -= moves[n];
            self.log_scales[i][n] -= moves[3 + n];
        }
        for n in 0..4 {
            self.rotations[i][n] -= moves[6 + n];
        }
        self.logits[i] -= moves[10];
        self.step_harmonics(i, g, steps, corrections);
    }

    #[inline(always)]
    fn step_harmonics(
        &mut self,
        i: usize,
        g: &GaussianGradient,
        steps: &StepSizes<'_>,
        corrections: [f32; 2],
    ) {
        let count = sh::function_count(steps.degree).min(self.sh_len);
        let basis = g.harmonics(steps.degree);
        let range = i * self.sh_len..i * self.sh_len + count;
        let [m, v] = &mut self.harmonics;
        let (m, v) = (m[range.clone()].as_flattened_mut(), v[range.clone()].as_flattened_mut());
        let values = self.sh[range].as_flattened_mut();
        // The gradient of each coefficient, laid out first so that the loop below is vector code.
        let mut gradient = [0.0; 3 * sh::MAX_LEN];
        for (k, b) in basis.iter().enumerate() {
            for c in 0..3 {
                gradient[3 * k + c] = b * g.colour[c];
            }
        }
        let n = values.len();
        let (m, v, gradient) = (&mut m[..n], &mut v[..n], &gradient[..n]);
        for k in 0..n {
            // The first three values are the mean colour. The others must explain reflections only;
            // at the rate of the colour they learn the noise of single photos.
            let rate = if k < 3 { steps.rates.colour } else { steps.rates.harmonics };
            values[k] -= rate * direction(gradient[k], &mut m[k], &mut v[k], corrections);
        }
    }
}

/// Updates the means by a gradient, and returns the direction of the step.
#[inline(always)]
fn direction(g: f32, m: &mut f32, v: &mut f32, [by_mean, by_root]: [f32; 2]) -> f32 {
    *m = DECAY[0] * *m + (1.0 - DECAY[0]) * g;
    *v = DECAY[1] * *v + (1.0 - DECAY[1]) * (g * g);
    // The constant stands outside the root, as in the paper. A parameter without any gradient so
    // far then gets 0 / EPSILON, and stays.
    by_mean * *m / (by_root * v.sqrt() + EPSILON)
}

#[inline(always)]
fn is_finite(g: &GaussianGradient) -> bool {
    // A sum is NaN or infinite if one of its terms is; finite terms of a gradient are far from
    // overflow.
    let three = |v: [f32; 3]| v[0] + v[1] + v[2];
    let [w, x, y, z] = g.rotation;
    let sum = three(g.position) + three(g.log_scale) + three(g.colour) + (w + x + y + z) + g.logit;
    sum.is_finite()
}
