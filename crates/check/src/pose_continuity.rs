//! Jumps between neighbouring poses. A gate.
//!
//! A step is compared with the median of the three steps before it and the three after it, all
//! divided by the shares of the path that the law assigns to them. A lasting change of speed,
//! however abrupt, stays below 2 by this measure (half of the neighbours are as fast, so the median
//! is at least half of it), and a smooth path stays near 1. A larger value for one or two steps is
//! a jump. The default limit is 3. Translation and rotation are judged separately, each in the
//! trajectory's mixed metric. A step below a quarter of the median mixed step is not a jump.
//!
//! `noise-translation` and `noise-rotation` find what no smooth or cornered path has between its
//! knots: noise, swapped poses, and a single displaced or turned pose, see `noise`. Their limit is
//! a thousandth of the median step. They need a path of two poses per view, and of four where the
//! path has corners.

mod noise;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_num::se3::rotation::{relative_angle, same_hemisphere};
use gs2e_num::stats::mean_median;
use gs2e_num::units::Ratio;
use gs2e_trajectory::CourseKind;
use gs2e_trajectory::curve::CurveKind;
use noise::{PathNoise, PathPoint, path_noise};
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
pub(crate) struct PoseContinuity;

impl ValidationPass for PoseContinuity {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let steps = RelativeSteps::of_subject(subject);
        if steps.linear.len() < MIN_STEPS {
            return Err("there are fewer than 4 poses".into());
        }
        let floor = FLOOR * steps.median_mixed();
        let [translation, rotation] =
            [&steps.linear, &steps.angular].map(|steps| judge_steps(subject, steps, floor));
        let mut statements = vec![("translation", Ok(translation)), ("rotation", Ok(rotation))];
        statements.extend(["noise-translation", "noise-rotation"].into_iter().zip(judge_noise(subject)));
        Ok(statements)
    }
}

/// Fewest poses per view or key pose where a path is smooth, and where it has corners. Corners at
/// every second or third pose have the spectrum of noise.
const PER_VIEW: [f64; 2] = [2.0, 4.0];

/// The noise of translation and rotation.
fn judge_noise(subject: &TrajectorySubject<'_>) -> [JudgementResult; 2] {
    if let Err(because) = is_sampled_densely(subject) {
        return [Err(because.clone()), Err(because)];
    }
    let scale = subject.speed.map_or(1.0, |r| r.scale_distance);
    let poses = &subject.trajectory.world_from_camera;
    let centres = poses.iter().map(|pose| (pose.translation / scale).extend(0.0).to_array());
    // Twice the quaternion, on which a small turn moves by its angle.
    let turns = poses.iter().scan(None, |before, pose| {
        let q = same_hemisphere(pose.rotation, before.unwrap_or(pose.rotation));
        *before = Some(q);
        Some(q.to_array().map(|part| 2.0 * part))
    });
    let (centres, turns): (Vec<PathPoint>, Vec<PathPoint>) = (centres.collect(), turns.collect());
    let length = |w: &[PathPoint]| w[0].iter().zip(w[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let steps = centres.windows(2).zip(turns.windows(2)).map(|(c, t)| length(c) + length(t));
    let step = mean_median(steps.collect()).unwrap_or(0.0);
    let judge = |points: &[PathPoint], unit: NoiseUnit| {
        let found = path_noise(points, noise::FLOOR * step).filter(|_| step > 0.0);
        let found = found.ok_or("the camera stands still, or there are fewer than 11 poses")?;
        Ok(judge_found(&found, step, unit))
    };
    [
        judge(&centres, NoiseUnit { factor: scale, name: "scene units" }),
        judge(&turns, NoiseUnit { factor: 1f64.to_degrees(), name: "degrees" }),
    ]
}

/// The unit of a noise in messages, and its factor.
#[derive(Clone, Copy)]
struct NoiseUnit {
    factor: f64,
    name: &'static str,
}

/// Judges a noise by the median step.
fn judge_found(found: &PathNoise, step: f64, unit: NoiseUnit) -> Judgement {
    let limit = LimitSide::gate(noise::FLOOR);
    let measured = found.size / step;
    let absolute = |size: f64| format!("{:.2e} {}", unit.factor * size, unit.name);
    let because = if measured > 0.0 {
        format!(
            "around pose {} the poses are off a smooth path by {measured:.3} of a median step ({}): noise, or poses in another order",
            found.pose,
            absolute(found.size)
        )
    } else {
        format!(
            "the path explains the differences of its poses; a pose that is off by {} would be seen, except for the {} at either end",
            absolute(found.detects),
            found.ends
        )
    };
    Judgement::at_most(measured, limit, "steps", because).detecting(found.detects / step, "steps")
}

/// Requires enough poses between the views that a path follows, where it is fastest.
fn is_sampled_densely(subject: &TrajectorySubject<'_>) -> Result<(), String> {
    let report = subject.speed.ok_or("the trajectory has no speed report, which states its curve")?;
    let poses = subject.trajectory.world_from_camera.len() as f64;
    let gamma = report.gamma.as_ref().and_then(|gamma| gamma.parse::<Ratio>().ok());
    let views = match report.kind {
        CourseKind::Orbit => return Ok(()),
        CourseKind::Novel => Some(report.keyframes.len()),
        CourseKind::Refine | CourseKind::Keyframes => subject.views,
        CourseKind::Mounted => subject.views.or(Some(report.keyframes.len()).filter(|n| *n > 0)),
    };
    let per_view = gamma.map(|g| g.numerator() as f64 / g.denominator() as f64);
    let per_view = per_view.or(views.map(|n| poses / n.max(1) as f64));
    let per_view = per_view.ok_or("the number of views that the path follows is not known here")?;
    // Where the speed law is fast, a view has fewer poses.
    let fastest = report.asked_shares().fold(0.0, f64::max) * (poses - 1.0);
    let least = if report.curve == Some(CurveKind::SlerpLerp) { PER_VIEW[1] } else { PER_VIEW[0] };
    let per_view = if fastest > 1.0 { per_view / fastest } else { per_view };
    if per_view >= least {
        return Ok(());
    }
    Err(format!(
        "where the path is fastest, it has {per_view:.1} poses per view; noise can be separated from the path from {least} on"
    ))
}

fn judge_steps(subject: &TrajectorySubject<'_>, steps: &[f64], floor: f64) -> Judgement {
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
    Judgement::at_most(measured, limit, "1", because)
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
        let linear = |w: &[gs2e_num::se3::Se3]| beta * (w[1].translation - w[0].translation).length();
        let angular = |w: &[gs2e_num::se3::Se3]| alpha * relative_angle(w[0].rotation, w[1].rotation);
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

#[cfg(test)]
mod tests {
    use crate::planted::{PlantedWorld, check};
    use glam::DVec3;

    #[test]
    fn a_pose_jump_is_found() {
        let shift = |w: &mut PlantedWorld| w.trajectory.world_from_camera[70].translation += DVec3::X * 0.05;
        check(
            shift,
            &[
                "pose_continuity#translation",
                "pose_continuity#noise-translation",
                "speed#chord",
                "speed#length",
            ],
        );
        let turn = |w: &mut PlantedWorld| {
            let pose = &mut w.trajectory.world_from_camera[70];
            pose.rotation *= glam::DQuat::from_rotation_x(0.02);
        };
        check(
            turn,
            &["pose_continuity#rotation", "pose_continuity#noise-rotation", "speed#chord", "speed#length"],
        );
    }

    #[test]
    fn a_path_that_changes_its_speed_is_no_jump() {
        // From pose 70 on, every step is fifty times as long.
        let hurry = |w: &mut PlantedWorld| {
            for (j, pose) in w.trajectory.world_from_camera.iter_mut().enumerate() {
                let steps = j.min(70) + 50 * j.saturating_sub(70);
                pose.translation = DVec3::X * 1e-3 * steps as f64;
                pose.rotation = glam::DQuat::IDENTITY;
            }
        };
        // The poses contradict the speeds that the report asks for, but none of them is a jump.
        check(hurry, &["speed#chord", "speed#length"]);
    }
}
