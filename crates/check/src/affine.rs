//! Validity of the affine projection. A warning; a gate where the recipe sets the limit.
//!
//! A Gaussian is drawn as the ellipse of the projection's linear part at its mean, which is wrong
//! if it is deep for its distance: with a standard deviation of a tenth of the depth, the ellipse
//! is approximately right; with half the depth, it is not.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest share of the picture made up by Gaussians too deep for their distance. Default:
    /// `MAX_SHARE`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// Default limit.
const MAX_SHARE: f64 = 0.01;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct AffinePass;

const NAME: &str = "affine";

impl ValidationPass for AffinePass {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(measured) = subject.doubtful_share else {
            let because = match subject.is_release {
                true => "the Gaussians are not in a release; the build judges them",
                false => "no visible Gaussian could be measured",
            };
            return vec![subject.not_run(NAME, "", because)];
        };
        let limit =
            LimitSide::limit_or(subject.limits.affine.and_then(|l| l.max), LimitSide::warning(MAX_SHARE));
        let because = format!(
            "{:.2} % of the picture comes from Gaussians that are large and close to the camera (deeper than a tenth of their distance); they may look wrong or flash",
            100.0 * measured
        );
        let judged = Judgement {
            verdict: limit.at_most(measured),
            measured: Some(measured),
            limit: Some(limit.value),
            unit: "1",
            because,
        };
        vec![subject.finding(NAME, "", judged)]
    }
}
