//! Jumps between neighbouring poses. A gate.
//!
//! A step is compared with the median of the three steps before it and the three after it, all
//! divided by the shares of the path that the law assigns to them. A lasting change of speed,
//! however abrupt, stays below 2 by this measure (half of the neighbours are as fast, so the median
//! is at least half of it), and a smooth path stays near 1. A larger value for one or two steps is
//! a jump. The default limit is 3. Translation and rotation are judged separately, each in the
//! trajectory's mixed metric. A step below a quarter of the median mixed step is not a jump.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass, limits};
use crate::se3::rotation::relative_angle;
use crate::stats::mean_median;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest ratio of a step to the median step of its neighbours. Default: `MAX_RATIO`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

const MAX_RATIO: f64 = 3.0;
/// Number of neighbours on each side.
const REACH: usize = 3;
/// Share of the median mixed step below which a step is not a jump.
const FLOOR: f64 = 0.25;
/// Minimum number of steps.
const MIN_STEPS: usize = 3;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct PoseContinuity;

const NAME: &str = "pose_continuity";

impl ValidationPass for PoseContinuity {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let steps = RelativeSteps::of_subject(subject);
        if steps.linear.len() < MIN_STEPS {
            return vec![subject.not_run(NAME, "", "there are fewer than 4 poses")];
        }
        let floor = FLOOR * steps.median_mixed();
        let part = |part, steps| judge_steps(subject, part, steps, floor);
        vec![part("translation", &steps.linear), part("rotation", &steps.angular)]
    }
}

fn judge_steps(subject: &TrajectorySubject<'_>, part: &str, steps: &[f64], floor: f64) -> Finding {
    let ratio = |j: usize| {
        let among = median_of_neighbours(steps, j).max(floor);
        // If nothing moves, the floor is 0 as well, and the ratio would be NaN.
        if steps[j] > 0.0 { steps[j] / among } else { 0.0 }
    };
    let ratios = (0..steps.len()).map(|j| (j, ratio(j)));
    let (at, measured) = ratios.max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are steps");
    let limits = subject.limits.pose_continuity.unwrap_or_default();
    let limit = LimitSide::limit_or(limits.max, LimitSide::gate(MAX_RATIO));
    let because = format!(
        "the most uneven step, from pose {at} to {}, is {measured:.3} times the median of the steps around it",
        at + 1
    );
    let verdict = limit.at_most(measured);
    let (measured, limit) = (Some(measured), Some(limit.value));
    subject.finding(NAME, part, Judgement { verdict, measured, limit, unit: "1", because })
}

/// Steps in the mixed metric, divided by their requested shares of the path.
struct RelativeSteps {
    linear: Vec<f64>,
    angular: Vec<f64>,
}

impl RelativeSteps {
    fn of_subject(subject: &TrajectorySubject<'_>) -> Self {
        let report = subject.speed;
        let (alpha, beta) = report.map_or((1.0, 1.0), |r| (r.alpha, r.beta / r.scale_distance));
        let shares: Vec<f64> = report.map_or_else(Vec::new, |r| r.asked_shares().collect());
        // A share of 0 cannot divide a step.
        let asked = |j: usize| shares.get(j).copied().filter(|share| *share > 0.0).unwrap_or(1.0);
        let pairs = || (0..).zip(subject.trajectory.world_from_camera.windows(2));
        let linear = |w: &[crate::se3::Se3]| beta * (w[1].translation - w[0].translation).length();
        let angular = |w: &[crate::se3::Se3]| alpha * relative_angle(w[0].rotation, w[1].rotation);
        Self {
            linear: pairs().map(|(j, w)| linear(w) / asked(j)).collect(),
            angular: pairs().map(|(j, w)| angular(w) / asked(j)).collect(),
        }
    }

    fn median_mixed(&self) -> f64 {
        mean_median(self.linear.iter().zip(&self.angular).map(|(l, a)| l + a).collect()).unwrap_or(0.0)
    }
}

fn median_of_neighbours(steps: &[f64], j: usize) -> f64 {
    // The step itself is left out, because it would raise the median that it is compared with.
    let around = j.saturating_sub(REACH)..(j + REACH + 1).min(steps.len());
    mean_median(around.filter(|i| *i != j).map(|i| steps[i]).collect()).unwrap_or(0.0)
}
