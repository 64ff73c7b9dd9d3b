//! Placement of Gaussians: where the image is wrong, by splitting those that are blended there.
//!
//! A Gaussian's score is the sum, over the pixels of the views since the last placement, of its
//! blended weight times the residual. Parents are drawn without replacement with a probability
//! proportional to the score (P. S. Efraimidis and P. G. Spirakis, "Weighted random sampling with a
//! reservoir", Information Processing Letters 97, 2006: the largest `ln(u) / weight`).
//!
//! A parent becomes two along its longest axis, at `+-s sqrt(1 - k^2)` with `k = sqrt(1/2)`. That
//! axis shrinks by `k`, so the two together keep the parent's variance along it; the other axes
//! shrink the less the shorter they are. Each gets the opacity `1 - (1 - o)^k`. The second one takes
//! the place of a dead Gaussian, or a new place. Why a split and no copy:
//! `docs/design/numerics-rendering.md`.

#![expect(clippy::cast_possible_truncation, reason = "parameters are stored in 32 bits")]

use super::adam::AdamMeans;
use super::draws::TrainingDraws;
use glam::{DQuat, DVec3};
use gs2e_scene::Gaussians;
use std::f64::consts::FRAC_1_SQRT_2;

/// Opacity up to which a Gaussian is dead.
const DEAD_OPACITY: f64 = 0.005;

/// Moves the dead Gaussians and adds others, to `count` in all if there are enough parents. Returns
/// the number of splits.
pub(super) fn place_gaussians(
    scene: &mut Gaussians,
    means: &mut AdamMeans,
    scores: &mut Vec<f32>,
    count: usize,
    draws: &TrainingDraws,
) -> usize {
    // Dead Gaussians are used again first, so the budget is not spent on what no view shows.
    let dead: Vec<usize> = (0..scene.len()).filter(|&i| is_dead(scene, i)).collect();
    let more = count.saturating_sub(scene.len());
    let parents = draw_parents(scene, scores, dead.len() + more, draws);
    let mut free = dead.into_iter();
    for &parent in &parents {
        let place = free.next().unwrap_or_else(|| {
            push_copy(scene, parent);
            means.resize(scene.len(), scene.sh_len());
            scene.len() - 1
        });
        split(scene, parent, place);
        // The means belong to a Gaussian that does not exist any more. Kept, they would push both
        // halves in the direction of the whole.
        means.forget(parent, scene.sh_len());
        means.forget(place, scene.sh_len());
    }
    scores.clear();
    scores.resize(scene.len(), 0.0);
    parents.len()
}

/// Returns true if a Gaussian is too transparent to matter, or not finite.
fn is_dead(scene: &Gaussians, i: usize) -> bool {
    let all = scene.positions[i].iter().chain(&scene.log_scales[i]).chain(&scene.rotations[i]);
    let sum = all.sum::<f32>() + scene.opacity_logits[i];
    // A sum over all parameters is one test for eleven.
    !sum.is_finite() || opacity(scene.opacity_logits[i]) <= DEAD_OPACITY
}

/// Draws up to `wanted` Gaussians that are not dead, the best first.
fn draw_parents(scene: &Gaussians, scores: &[f32], wanted: usize, draws: &TrainingDraws) -> Vec<usize> {
    // A key is below 0, and a large score brings it near 0: the largest keys win.
    let key = |i: usize| libm::log(draws.of_gaussian(i)) / f64::from(scores[i]);
    // A Gaussian without a score was not drawn or blends where the image is right.
    let candidates = (0..scene.len()).filter(|&i| scores[i] > 0.0 && !is_dead(scene, i));
    let mut keyed: Vec<(f64, usize)> = candidates.map(|i| (key(i), i)).collect();
    // Draws differ, so keys hardly tie; the index decides all the same.
    keyed.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    keyed.truncate(wanted);
    keyed.into_iter().map(|(_, i)| i).collect()
}

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

/// Adds a Gaussian that equals another.
fn push_copy(scene: &mut Gaussians, of: usize) {
    let n = scene.sh_len();
    scene.positions.push(scene.positions[of]);
    scene.log_scales.push(scene.log_scales[of]);
    scene.rotations.push(scene.rotations[of]);
    scene.opacity_logits.push(scene.opacity_logits[of]);
    scene.sh.extend_from_within(of * n..(of + 1) * n);
}

/// Splits a Gaussian; the second half goes to `place`.
fn split(scene: &mut Gaussians, parent: usize, place: usize) {
    let k = FRAC_1_SQRT_2;
    let scales = scene.log_scales[parent].map(|s| libm::exp(f64::from(s)));
    let longest = (0..3).fold(0, |a, b| if scales[b] > scales[a] { b } else { a });
    let shrunk = scales.map(|s| {
        // A quotient first: the square of a scale of 1e-30 would be 0.
        let q = (s / scales[longest]) * (s / scales[longest]);
        libm::log(s * (1.0 - q * (1.0 - k))) as f32
    });
    let [w, x, y, z] = scene.rotations[parent].map(f64::from);
    // Stored quaternions need not be of unit length. The bound keeps a zero quaternion from NaN.
    let norm = (w * w + x * x + y * y + z * z).sqrt().max(1e-12);
    let turn = DQuat::from_xyzw(x / norm, y / norm, z / norm, w / norm);
    // The variance along the axis is that of the shrunk halves, `k^2`, plus that of their places, `1 - k^2`.
    let axis = turn * DVec3::AXES[longest] * (scales[longest] * (1.0 - k * k).sqrt());
    let o = 1.0 - libm::pow(1.0 - opacity(scene.opacity_logits[parent]), k);
    // Beyond 20 an opacity is 1 in 32 bits, and its gradient 0: it could never fall again.
    let logit = libm::log(o / (1.0 - o)).clamp(-20.0, 20.0) as f32;
    let centre = DVec3::from_array(scene.positions[parent].map(f64::from));
    for (i, sign) in [(parent, 1.0), (place, -1.0)] {
        scene.positions[i] = (centre + sign * axis).as_vec3().to_array();
        scene.log_scales[i] = shrunk;
        scene.rotations[i] = scene.rotations[parent];
        scene.opacity_logits[i] = logit;
    }
    let n = scene.sh_len();
    scene.sh.copy_within(parent * n..(parent + 1) * n, place * n);
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::Seed;
    use gs2e_scene::SceneScreening;

    fn scene(count: usize) -> Gaussians {
        Gaussians {
            origin: DVec3::ZERO,
            positions: (0..count).map(|i| [i as f32, 0.0, 0.0]).collect(),
            log_scales: vec![[0.0, -1.0, -0.25]; count],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
            opacity_logits: vec![0.0; count],
            sh: vec![[0.5; 3]; count],
            sh_degree: 0,
            antialiased: None,
            screening: SceneScreening::default(),
            motion: None,
        }
    }

    fn means(count: usize) -> AdamMeans {
        let mut means = AdamMeans::default();
        means.resize(count, 1);
        means.ages.fill(7);
        means
    }

    /// Two halves of equal weight: mean and variance along the split are the parent's.
    #[test]
    fn a_split_keeps_the_mean_and_the_variance() {
        let mut scene = scene(2);
        split(&mut scene, 0, 1);
        let [a, b] = [scene.positions[0][0], scene.positions[1][0]].map(f64::from);
        let s = libm::exp(f64::from(scene.log_scales[0][0]));
        assert!((a + b).abs() < 1e-7);
        // Parent: mean 0, deviation 1 along x.
        assert!((s * s + (a * a + b * b) / 2.0 - 1.0).abs() < 1e-6, "{s}, {a}");
        // Light that passes both where they overlap: (1 - o)^(2 k), k < 1, at least that of one.
        assert!((opacity(scene.opacity_logits[0]) - (1.0 - 0.5_f64.powf(FRAC_1_SQRT_2))).abs() < 1e-7);
        assert_eq!(scene.log_scales[0].map(f32::to_bits), scene.log_scales[1].map(f32::to_bits));
        // A short axis shrinks less than the long one: by 1 - exp(-2) (1 - k) at exp(-1).
        let short = libm::exp(f64::from(scene.log_scales[0][1]) + 1.0);
        assert!((short - (1.0 - libm::exp(-2.0) * (1.0 - FRAC_1_SQRT_2))).abs() < 1e-6);
    }

    #[test]
    fn the_dead_are_replaced_first_and_the_count_is_met() {
        let mut scene = scene(10);
        scene.opacity_logits[4] = -9.0;
        scene.positions[6][1] = f32::NAN;
        let mut scores = vec![1.0; 10];
        scores[0] = 0.0;
        let mut means = means(10);
        let draws = TrainingDraws::new(Seed(1)).placement(100);
        assert_eq!(place_gaussians(&mut scene, &mut means, &mut scores, 13, &draws), 5);
        assert_eq!((scene.len(), means.ages.len(), scores.len()), (13, 13, 13));
        assert!((0..13).all(|i| !is_dead(&scene, i)));
        // Ten Gaussians made of five parents. The first one erred nowhere and keeps its age.
        assert_eq!(means.ages.iter().filter(|age| **age == 0).count(), 10);
        assert_eq!(means.ages[0], 7);
    }

    /// Parents by a score of 3 to 1: the share of the first among single draws is 3/4.
    #[test]
    fn parents_are_drawn_by_their_scores() {
        let scene = scene(2);
        const TRIALS: u32 = 4000;
        let all = TrainingDraws::new(Seed(5));
        let first =
            (0..TRIALS).filter(|t| draw_parents(&scene, &[3.0, 1.0], 1, &all.placement(*t)) == [0]).count();
        // Binomial with variance 0.1875 / 4000: 5 deviations are 0.034.
        let share = first as f64 / f64::from(TRIALS);
        assert!((share - 0.75).abs() < 0.034, "{share}");
    }
}
