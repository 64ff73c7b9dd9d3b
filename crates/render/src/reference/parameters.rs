//! Parameters of a Gaussian with their rates, and its scaled axes.

use super::D;
use crate::dual::RealNumber;
use gs2e_scene::dynamic::{MomentSplat, Rated, SceneAt};
use gs2e_scene::{Gaussians, sh};
use std::array::from_fn;

/// Rates of one Gaussian's stored parameters, per unit of time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianRates {
    /// Of its position, scene units.
    pub position: [f64; 3],
    /// Of the logarithms of its scales.
    pub log_scale: [f64; 3],
    /// Of its stored quaternion, `w x y z`.
    pub rotation: [f64; 4],
    /// Of the logit of its opacity.
    pub logit: f64,
    /// Of its coefficients of harmonics; those beyond the scene's degree do not count.
    pub harmonics: [[f64; 3]; sh::MAX_LEN],
}

fn opacity_of(logit: D) -> D {
    D::constant(1.0) / (D::constant(1.0) + (-logit).exponential())
}

/// The parameters of a Gaussian, which may change in time.
pub(super) struct RatedGaussian {
    pub(super) position: [D; 3],
    log_scale: [D; 3],
    rotation: [D; 4],
    opacity: D,
    harmonics: [[D; 3]; sh::MAX_LEN],
}

impl RatedGaussian {
    pub(super) fn new(scene: &Gaussians, i: usize, rates: &GaussianRates) -> Self {
        let join = |value: f32, rate: f64| D { value: value.into(), rate };
        let triple = |v: [f32; 3], rates: [f64; 3]| from_fn(|k| join(v[k], rates[k]));
        let coefficients = scene.sh_of(i);
        Self {
            position: triple(scene.positions[i], rates.position),
            log_scale: triple(scene.log_scales[i], rates.log_scale),
            rotation: from_fn(|k| join(scene.rotations[i][k], rates.rotation[k])),
            opacity: opacity_of(join(scene.opacity_logits[i], rates.logit)),
            harmonics: from_fn(|k| {
                coefficients.get(k).map_or([D::constant(0.0); 3], |c| triple(*c, rates.harmonics[k]))
            }),
        }
    }

    /// World directions of the axes, scaled by the standard deviations.
    pub(super) fn axes(&self) -> [[D; 3]; 3] {
        let turn = self.turn();
        from_fn(|k| {
            let deviation = self.log_scale[k].exponential();
            turn[k].map(|entry| entry * deviation)
        })
    }

    /// The columns of the rotation.
    fn turn(&self) -> [[D; 3]; 3] {
        let one = D::constant(1.0);
        let [w, x, y, z] = self.rotation;
        // As in the CPU's activation: a zero quaternion gives the identity.
        let norm = (w * w + x * x + y * y + z * z).sqrt().at_least(D::constant(1e-12));
        // The operations of `DMat3::from_quat` in their order: a scene at rest keeps the bits that
        // plain matrices give it.
        let [w, x, y, z] = [w / norm, x / norm, y / norm, z / norm];
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let (xx, xy, xz) = (x * x2, x * y2, x * z2);
        let (yy, yz, zz) = (y * y2, y * z2, z * z2);
        let (wx, wy, wz) = (w * x2, w * y2, w * z2);
        [
            [one - (yy + zz), xy + wz, xz - wy],
            [xy - wz, one - (xx + zz), yz + wx],
            [xz + wy, yz - wx, one - (xx + yy)],
        ]
    }

    /// Gaussian `i` of a scene that changes, at a moment.
    pub(super) fn at_moment(scene: &Gaussians, i: usize, at: SceneAt<'_>) -> Self {
        let rated = |[value, rate]: Rated| D { value, rate };
        let MomentSplat { position, log_scale, rotation, opacity } = at.splat(i);
        let still = || Self::new(scene, i, &GaussianRates::default()).harmonics;
        let changing = at.harmonics(i);
        Self {
            position: position.map(rated),
            log_scale: log_scale.map(rated),
            rotation: rotation.map(rated),
            opacity: rated(opacity),
            harmonics: changing.map_or_else(still, |own| own.map(|channels| channels.map(rated))),
        }
    }

    /// Opacity at the mean, without the factor of the antialiased rule.
    pub(super) fn opacity(&self) -> D {
        self.opacity
    }

    /// The colour in a unit direction.
    pub(super) fn colour(&self, degree: u8, direction: [D; 3]) -> [D; 3] {
        let basis = sh::basis_values(degree, direction);
        let count = sh::function_count(degree);
        from_fn(|c| {
            // The order of `sh::sum_colour`, which takes coefficients without rates.
            let mut sum = D::constant(0.0);
            for (coefficients, value) in self.harmonics[..count].iter().zip(basis) {
                sum = sum + coefficients[c] * value;
            }
            (sum + D::constant(0.5)).clamp(0.0, f64::INFINITY)
        })
    }
}
