//! Validity of the affine projection. A warning; a gate where the recipe sets the limit.
//!
//! A Gaussian is drawn as the ellipse of the projection's linear part at its mean, which is wrong
//! if it is deep for its distance: with a standard deviation of a tenth of the depth, the ellipse
//! is approximately right; with half the depth, it is not.

use super::subject::{Judgement, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
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
pub(crate) struct AffinePass;

impl ValidationPass for AffinePass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let Some(measured) = subject.doubtful_share else {
            return Err(match subject.is_release {
                true => "the Gaussians are not in a release; the build judges them".into(),
                false => "no visible Gaussian could be measured".into(),
            });
        };
        let limit =
            LimitSide::limit_or(subject.limits.affine.and_then(|l| l.max), LimitSide::warning(MAX_SHARE));
        let because = format!(
            "{:.2} % of the picture comes from Gaussians that are large and close to the camera (deeper than a tenth of their distance); they may look wrong or flash",
            100.0 * measured
        );
        Ok(vec![("", Ok(Judgement::at_most(measured, limit, "1", because)))])
    }
}

#[cfg(test)]
mod tests {
    use super::Limits;
    use crate::Verdict;
    use crate::planted::PlantedWorld;

    #[test]
    fn deep_gaussians_warn_and_fail_where_the_recipe_says_so() {
        let mut world = PlantedWorld::default_world();
        world.doubtful_share = Some(0.02);
        assert_eq!(world.finding("affine").verdict, Verdict::Warn);
        world.limits.affine = Some(Limits { max: Some(0.01) });
        assert_eq!(world.finding("affine").verdict, Verdict::Fail);
        world.doubtful_share = None;
        assert_eq!(world.finding("affine").verdict, Verdict::NotRun);
    }
}
