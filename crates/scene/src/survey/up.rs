//! The upward direction of a scene, guessed from its cameras or its Gaussians.

use super::axes::principal_axes;
use super::{FLAT, LINEAR, LOPSIDED};
use glam::{DMat3, DVec3};
use serde::Serialize;

/// A guess at the up direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UpGuess {
    /// The direction, of unit length.
    pub direction: DVec3,
    /// The rule that gave it.
    pub rule: UpRule,
}

/// A rule for the up direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpRule {
    /// The Gaussians form a layer. Up is its normal, on the side with the longer tail: what stands
    /// on a floor or a table is thinner than the floor.
    Layer,
    /// The Gaussians form a layer, and both sides are alike. Up is its normal, on the side of `-y`.
    LayerAlike,
    /// There is no layer. Up is `-y`, as in captures that COLMAP solved.
    Colmap,
}

/// Values in ascending order, each with the weight of all values up to it.
pub(super) struct SortedWeights(Vec<(f64, f64)>);

impl SortedWeights {
    pub(super) fn new(values: impl Iterator<Item = f64>, weights: &[f64]) -> Self {
        let mut pairs: Vec<(f64, f64)> = values.zip(weights.iter().copied()).collect();
        // Weights break ties, so that sums do not depend on the order of equal values.
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut sum = 0.0;
        for (_, weight) in &mut pairs {
            sum += *weight;
            *weight = sum;
        }
        Self(pairs)
    }

    pub(super) fn quantile(&self, share: f64) -> f64 {
        let wanted = share * self.0.last().expect("the scene has a Gaussian").1;
        // The last sum is the total itself, so a share of at most 1 always finds a value.
        let at = self.0.partition_point(|(_, up_to)| *up_to < wanted);
        self.0[at].0
    }
}

/// The up direction of weighted points.
pub(super) fn guess_up(held: &[(DVec3, f64)]) -> UpGuess {
    let colmap = UpGuess { direction: DVec3::NEG_Y, rule: UpRule::Colmap };
    let total: f64 = held.iter().map(|(_, weight)| weight).sum();
    // The intervals of the axes may have no Gaussian in common.
    if total <= 0.0 {
        return colmap;
    }
    let mean = held.iter().map(|(point, weight)| *point * *weight).sum::<DVec3>() / total;
    let spread = |(point, weight): &(DVec3, f64)| {
        let d = *point - mean;
        DMat3::from_cols(d * d.x, d * d.y, d * d.z) * *weight
    };
    let covariance = held.iter().map(spread).fold(DMat3::ZERO, |sum, next| sum + next) * (1.0 / total);
    let [(least, normal), (next, _), (largest, _)] = principal_axes(covariance);
    // Points on a line have no normal: what is left across the line is rounding.
    if !(least <= FLAT * next && next > LINEAR * largest) {
        return colmap;
    }
    let third = held.iter().map(|(point, weight)| {
        let along = (*point - mean).dot(normal);
        along * along * along * weight
    });
    // The least variance is the one along the normal, so this is its power of 3/2.
    let skewness = third.sum::<f64>() / total / (least * least.sqrt());
    if skewness.abs() > LOPSIDED {
        return UpGuess { direction: normal * skewness.signum(), rule: UpRule::Layer };
    }
    let direction = if normal.y > 0.0 { -normal } else { normal };
    UpGuess { direction, rule: UpRule::LayerAlike }
}
