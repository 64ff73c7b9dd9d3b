//! What of a Gaussian no view changes: its scaled axes and its opacity.

use crate::scene::Gaussians;
use glam::{DMat3, DQuat};
use rayon::prelude::*;

/// A Gaussian as every view uses it.
#[derive(Debug, Clone, Copy)]
pub(in crate::render) struct Activated {
    /// World directions of its own axes, each as long as the standard deviation along it: the columns of `Rq S`.
    /// NaN where a stored field is not finite, so that no view draws it.
    pub(in crate::render) axes: [[f32; 3]; 3],
    /// Opacity at the mean, 0..1.
    pub(in crate::render) opacity: f32,
}

/// Least norm that a quaternion is divided by (`torch.nn.functional.normalize`).
const LEAST_NORM: f64 = 1e-12;

/// Applies the activations to every Gaussian, in f64 before the result is rounded.
pub(in crate::render) fn activate(scene: &Gaussians) -> Vec<Activated> {
    (0..scene.len()).into_par_iter().map(|i| one(scene, i)).collect()
}

fn one(scene: &Gaussians, i: usize) -> Activated {
    if !is_finite(scene, i) {
        return Activated { axes: [[f32::NAN; 3]; 3], opacity: 0.0 };
    }
    let rotation = rotation(scene.rotations[i]);
    let axis = |k: usize| {
        let deviation = libm::exp(f64::from(scene.log_scales[i][k]));
        (rotation.col(k) * deviation).as_vec3().to_array()
    };
    Activated { axes: [axis(0), axis(1), axis(2)], opacity: sigmoid(scene.opacity_logits[i]) }
}

fn is_finite(scene: &Gaussians, i: usize) -> bool {
    let triple = |v: &[f32; 3]| v.iter().all(|x| x.is_finite());
    triple(&scene.positions[i])
        && triple(&scene.log_scales[i])
        && scene.rotations[i].iter().all(|x| x.is_finite())
        && scene.opacity_logits[i].is_finite()
        && scene.sh_of(i).iter().all(triple)
}

/// The rotation of a stored quaternion `w, x, y, z` of any length. A zero one gives the identity, as does, nearly,
/// one far below [`LEAST_NORM`].
fn rotation(stored: [f32; 4]) -> DMat3 {
    let [w, x, y, z] = stored.map(f64::from);
    let norm = (w * w + x * x + y * y + z * z).sqrt().max(LEAST_NORM);
    DMat3::from_quat(DQuat::from_xyzw(x / norm, y / norm, z / norm, w / norm))
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to 32 bits once, after the arithmetic")]
fn sigmoid(logit: f32) -> f32 {
    (1.0 / (1.0 + libm::exp(-f64::from(logit)))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn quaternions_of_any_length_turn_alike_and_zero_does_not_turn() {
        // half of sqrt 2: a quarter turn about z takes x to y
        for length in [1e-6_f32, 1.0, 1e6] {
            let turned = rotation([length, 0.0, 0.0, length]) * DVec3::X;
            assert!((turned - DVec3::Y).length() < 1e-15, "{length}: {turned}");
        }
        assert_eq!(rotation([0.0; 4]), DMat3::IDENTITY);
        let nearly = rotation([1e-20, 1e-20, 0.0, 0.0]) * DVec3::ONE;
        assert!((nearly - DVec3::ONE).length() < 1e-7, "{nearly}");
    }

    #[test]
    fn opacity_keeps_its_full_range() {
        assert_eq!([0.0, 40.0].map(|x| sigmoid(x).to_bits()), [0.5_f32, 1.0].map(f32::to_bits));
        // far down the logistic function is the exponential
        assert!((f64::from(sigmoid(-80.0)) / libm::exp(-80.0) - 1.0).abs() < 1e-7);
    }
}
