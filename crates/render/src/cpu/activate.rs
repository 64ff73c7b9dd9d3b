//! View-independent properties of Gaussians (scaled axes, opacity, reach), laid out in blocks for
//! projection.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_scene::collector::{Gaussian, GaussianCollector};
//! use gs2e_render::cpu::activate::activate_one;
//!
//! # let mut collector = GaussianCollector::new(0, 1)?;
//! # let (log_scale, rotation, sh) = ([0.0; 3], [1.0, 0.0, 0.0, 0.0], &[[0.0; 3]]);
//! # collector.push(&Gaussian { position: [0.0, 0.0, 2.0], log_scale, rotation, opacity_logit: 0.0, sh });
//! # let scene = collector.finish(DVec3::ZERO, None)?;
//! // The Gaussian is stored with log scales of 0, no rotation, and an opacity logit of 0.
//! let active = activate_one(&scene, 0);
//! assert_eq!(active.axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
//! assert_eq!(active.opacity, 0.5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::cull::ALL_LANES;
use super::extent;
use crate::RenderRules;
use crate::dual::RealNumber;
use crate::shared::least_alpha;
use glam::{DMat3, DQuat, DVec3};
use gs2e_scene::dynamic::{MomentSplat, SceneAt, SplatDynamics};
use gs2e_scene::{Gaussians, sh};
use rayon::prelude::*;

/// Number of Gaussians that are projected together.
pub(super) const LANES: usize = 64;

/// Number of promises that are counted apart: that of all frames, and that of one reader.
pub(super) const PROMISES: usize = 2;

/// One value for each Gaussian of a block.
pub(super) type Lane = [f32; LANES];

/// Gaussians in activated form, in the order of the file.
#[derive(Debug, Clone)]
pub(super) struct GaussianBlock {
    /// Number of Gaussians in the block. Lanes beyond it are padding.
    pub(super) len: usize,
    /// The object that its Gaussians belong to: 0 for what is still.
    pub(super) object: usize,
    /// Indices of the Gaussians in the scene.
    pub(super) numbers: [u32; LANES],
    /// The lanes that each promise may see, one bit per lane.
    pub(super) promised: [u64; PROMISES],
    /// Means relative to the scene's origin.
    pub(super) positions: [Lane; 3],
    /// The columns of `Rq S`: world directions of a Gaussian's axes, scaled by the standard
    /// deviation along each. NaN if a stored field is not finite, so that no view draws the
    /// Gaussian.
    pub(super) axes: [[Lane; 3]; 3],
    /// Opacity at the mean, 0..1.
    pub(super) opacity: Lane,
    /// [`extent::opacity_reach`] of the opacity.
    pub(super) reach: Lane,
    /// The rates of Gaussians that change.
    pub(super) motion: Option<Box<BlockMotion>>,
}

/// Rates of the Gaussians of a block, per second.
#[derive(Debug, Clone)]
pub(super) struct BlockMotion {
    /// Of the means.
    pub(super) velocity: [Lane; 3],
    /// Of the scaled axes.
    pub(super) axes: [[Lane; 3]; 3],
    /// Of the opacities.
    pub(super) opacity: Lane,
}

/// One Gaussian in activated form: see `GaussianBlock`.
#[derive(Debug, Clone, Copy)]
pub struct ActivatedGaussian {
    /// Principal axes, scene units: directions times standard deviations.
    pub axes: [[f32; 3]; 3],
    /// Opacity, 0 to 1.
    pub opacity: f32,
}

/// Applies the activations to one Gaussian in f64, and rounds the result.
pub fn activate_one(scene: &Gaussians, i: usize) -> ActivatedGaussian {
    ActivatedGaussian { axes: scaled_axes(scene, i), opacity: logistic_opacity(scene.opacity_logits[i]) }
}

/// Smallest norm by which a quaternion is divided (`torch.nn.functional.normalize`).
pub const MIN_NORM: f64 = 1e-12;

impl GaussianBlock {
    /// The Gaussian of a lane.
    pub(super) fn lane(&self, lane: usize) -> ActivatedGaussian {
        let axis = |k: usize| [self.axes[k][0][lane], self.axes[k][1][lane], self.axes[k][2][lane]];
        let axes = [axis(0), axis(1), axis(2)];
        ActivatedGaussian { axes, opacity: self.opacity[lane] }
    }

    /// Activates the Gaussians of a scene that changes, as they are at a moment.
    pub(super) fn advance(&mut self, at: SceneAt<'_>, rules: RenderRules) {
        let zero = [0.0; LANES];
        let still = || Box::new(BlockMotion { velocity: [zero; 3], axes: [[zero; 3]; 3], opacity: zero });
        let motion = self.motion.get_or_insert_with(still);
        for lane in 0..self.len {
            let splat = at.splat(self.numbers[lane] as usize);
            for k in 0..3 {
                let [value, rate] = splat.position[k].map(single);
                (self.positions[k][lane], motion.velocity[k][lane]) = (value, rate);
            }
            let [opacity, rate] = splat.opacity.map(single);
            (self.opacity[lane], motion.opacity[lane]) = (opacity, rate);
            // Antialiasing only lowers an opacity, so such a Gaussian is not drawn, whatever its axes are.
            if opacity < 0.5 * least_alpha(rules) {
                continue;
            }
            self.reach[lane] = extent::opacity_reach(rules, opacity);
            let axes = changing_axes(&splat);
            for (k, [axis, rate]) in axes.into_iter().enumerate() {
                for c in 0..3 {
                    (self.axes[k][c][lane], motion.axes[k][c][lane]) = (single(axis[c]), single(rate[c]));
                }
            }
        }
    }

    /// Activates the Gaussian of a lane again, after a change in the scene.
    pub(super) fn refresh(&mut self, scene: &Gaussians, rules: RenderRules, lane: usize) {
        let i = self.numbers[lane] as usize;
        let ActivatedGaussian { axes, opacity } = activate_one(scene, i);
        self.opacity[lane] = opacity;
        self.reach[lane] = extent::opacity_reach(rules, opacity);
        for (to, from) in self.positions.iter_mut().zip(scene.positions[i]) {
            to[lane] = from;
        }
        for (to, from) in self.axes.as_flattened_mut().iter_mut().zip(axes.as_flattened()) {
            to[lane] = *from;
        }
    }
}

/// Applies the activations to the Gaussians with these indices, ascending. No block has Gaussians of two
/// objects.
pub(super) fn activate_all(scene: &Gaussians, rules: RenderRules, numbers: &[u32]) -> Vec<GaussianBlock> {
    let (mut blocks, mut rest) = (Vec::new(), numbers);
    for object in 0..=scene.object_count() {
        let end = scene.object_end(object);
        let (own, after) = rest.split_at(rest.partition_point(|number| (*number as usize) < end));
        rest = after;
        blocks.par_extend(own.par_chunks(LANES).map(|own| activate_block(scene, rules, object, own)));
    }
    blocks
}

/// The highest degree with a harmonic that is not zero somewhere in the scene. Leaving out higher
/// degrees changes no bit: the sum of a colour begins at +0, so it is never -0, and adding a zero
/// of either sign to anything else leaves it unchanged. (Gaussians with NaN coefficients are never
/// drawn.)
pub(super) fn sh_degree(scene: &Gaussians) -> u8 {
    // Harmonics that change may be zero at first.
    if scene.dynamics().is_some_and(SplatDynamics::has_harmonics) {
        return scene.sh_degree;
    }
    let is_used = |degree: u8| {
        let band = sh::function_count(degree - 1)..sh::function_count(degree);
        let all = (0..scene.len()).into_par_iter().map(|i| scene.sh_of(i)[band.clone()].as_flattened());
        all.any(|band: &[f32]| band.iter().any(|c| c.abs() > 0.0))
    };
    (1..=scene.sh_degree).rev().find(|&degree| is_used(degree)).unwrap_or(0)
}

fn activate_block(scene: &Gaussians, rules: RenderRules, object: usize, numbers: &[u32]) -> GaussianBlock {
    // Padding lanes hold zeros. They are projected with the others, and never counted or drawn.
    let zero = [0.0; LANES];
    let mut block = GaussianBlock {
        len: numbers.len(),
        object,
        numbers: [0; LANES],
        promised: [ALL_LANES; PROMISES],
        positions: [zero; 3],
        axes: [[zero; 3]; 3],
        opacity: zero,
        reach: zero,
        motion: None,
    };
    for (lane, &number) in numbers.iter().enumerate() {
        block.numbers[lane] = number;
        block.refresh(scene, rules, lane);
    }
    block
}

fn scaled_axes(scene: &Gaussians, i: usize) -> [[f32; 3]; 3] {
    if !is_finite(scene, i) {
        // NaN makes the determinant NaN in every view, so the Gaussian counts as degenerate.
        return [[f32::NAN; 3]; 3];
    }
    let rotation = stored_rotation(scene.rotations[i]);
    let axis = |k: usize| {
        // By `libm` and in 64 bits, so that the bits do not depend on the platform.
        let deviation = libm::exp(f64::from(scene.log_scales[i][k]));
        (rotation.col(k) * deviation).as_vec3().to_array()
    };
    [axis(0), axis(1), axis(2)]
}

/// The scaled axes of a Gaussian that changes, each with its rate. While a unit quaternion `q` changes, axes
/// turn with the angular velocity `2 qdot q*`.
fn changing_axes(splat: &MomentSplat) -> [[DVec3; 2]; 3] {
    let quaternion = |part: usize| {
        let [w, x, y, z] = splat.rotation.map(|both| both[part]);
        DQuat::from_xyzw(x, y, z, w)
    };
    let (stored, rate) = (quaternion(0), quaternion(1));
    let norm = stored.length().max(MIN_NORM);
    let unit = stored / norm;
    // Only the component across the quaternion turns it.
    let across = (rate - unit * unit.dot(rate)) / norm;
    let spin = (across * unit.conjugate()).xyz() * 2.0;
    let turn = DMat3::from_quat(unit);
    let axis = |k: usize| {
        let [log, log_rate] = splat.log_scale[k];
        let axis = turn.col(k) * libm::exp(log);
        [axis, spin.cross(axis) + axis * log_rate]
    };
    [axis(0), axis(1), axis(2)]
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to 32 bits once, after the arithmetic")]
fn single(value: f64) -> f32 {
    value as f32
}

/// The gradient by a stored quaternion, from the gradients by the scaled axes in world axes. Only its
/// component across the quaternion turns, so a stored length does not matter; a zero quaternion has
/// the gradient 0.
pub(super) fn rotation_gradient<S: RealNumber<Plain = S>>(
    stored: [f32; 4],
    axes: [[S; 3]; 3],
    by_axes: [[S; 3]; 3],
) -> [S; 4] {
    let [w, x, y, z] = stored.map(|q| S::nearest(q.into()));
    let (two, nothing) = (S::nearest(2.0), S::nearest(0.0));
    let norm = (w * w + x * x + y * y + z * z).sqrt();
    if norm <= S::nearest(MIN_NORM) {
        return [nothing; 4];
    }
    let [w, x, y, z] = [w / norm, x / norm, y / norm, z / norm];
    // `d[k]` is the gradient by column `k` of the rotation.
    let column = |k: usize| {
        let [a, b, c] = axes[k];
        let deviation = (a * a + b * b + c * c).sqrt();
        [by_axes[k][0] * deviation, by_axes[k][1] * deviation, by_axes[k][2] * deviation]
    };
    let d = [column(0), column(1), column(2)];
    // The matrix is a polynomial in `w x y z`. What only changes the quaternion's length is removed below.
    let by_unit = [
        two * (z * (d[0][1] - d[1][0]) + y * (d[2][0] - d[0][2]) + x * (d[1][2] - d[2][1])),
        two * (y * (d[1][0] + d[0][1]) + z * (d[2][0] + d[0][2]) - two * x * (d[1][1] + d[2][2])
            + w * (d[1][2] - d[2][1])),
        two * (x * (d[1][0] + d[0][1]) + z * (d[2][1] + d[1][2]) - two * y * (d[0][0] + d[2][2])
            + w * (d[2][0] - d[0][2])),
        two * (x * (d[2][0] + d[0][2]) + y * (d[2][1] + d[1][2]) - two * z * (d[0][0] + d[1][1])
            + w * (d[0][1] - d[1][0])),
    ];
    let unit = [w, x, y, z];
    let along = w * by_unit[0] + x * by_unit[1] + y * by_unit[2] + z * by_unit[3];
    let across = |k: usize| (by_unit[k] - along * unit[k]) / norm;
    [across(0), across(1), across(2), across(3)]
}

fn is_finite(scene: &Gaussians, i: usize) -> bool {
    let triple = |v: &[f32; 3]| v.iter().all(|x| x.is_finite());
    triple(&scene.positions[i])
        && triple(&scene.log_scales[i])
        && scene.rotations[i].iter().all(|x| x.is_finite())
        && scene.opacity_logits[i].is_finite()
        && scene.sh_of(i).iter().all(triple)
}

/// The rotation of a stored quaternion `w, x, y, z` of any length. A zero quaternion gives the
/// identity, and one far below [`MIN_NORM`] nearly does.
fn stored_rotation(stored: [f32; 4]) -> DMat3 {
    let [w, x, y, z] = stored.map(f64::from);
    let norm = (w * w + x * x + y * y + z * z).sqrt().max(MIN_NORM);
    DMat3::from_quat(DQuat::from_xyzw(x / norm, y / norm, z / norm, w / norm))
}

/// The logistic function.
#[expect(clippy::cast_possible_truncation, reason = "rounded to 32 bits once, after the arithmetic")]
pub(super) fn logistic_opacity(logit: f32) -> f32 {
    (1.0 / (1.0 + libm::exp(-f64::from(logit)))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn quaternions_of_any_length_turn_alike_and_zero_does_not_turn() {
        // Half of sqrt 2 in w and z: a quarter turn about z, which takes x to y.
        for length in [1e-6_f32, 1.0, 1e6] {
            let turned = stored_rotation([length, 0.0, 0.0, length]) * DVec3::X;
            assert!((turned - DVec3::Y).length() < 1e-15, "{length}: {turned}");
        }
        assert_eq!(stored_rotation([0.0; 4]), DMat3::IDENTITY);
        let nearly = stored_rotation([1e-20, 1e-20, 0.0, 0.0]) * DVec3::ONE;
        assert!((nearly - DVec3::ONE).length() < 1e-7, "{nearly}");
    }

    #[test]
    fn opacity_keeps_its_full_range() {
        assert_eq!([0.0, 40.0].map(|x| logistic_opacity(x).to_bits()), [0.5_f32, 1.0].map(f32::to_bits));
        // Far below zero, the logistic function is the exponential function.
        assert!((f64::from(logistic_opacity(-80.0)) / libm::exp(-80.0) - 1.0).abs() < 1e-7);
    }
}
