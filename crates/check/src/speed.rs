//! Agreement of the path with its speed law.
//!
//! The mixed metric, measured as arc length along the fitted curve, follows the law within 1e-6: a
//! gate, which does not apply under `literal`, the paper's chords. The trajectory's report has this
//! measure, because the poses alone do not determine the curve; a release does not make the
//! statement. Measured as chords between neighbouring poses, the metric follows the law within 3 %:
//! a warning. The sum of the chords is the length of the curve within 3 %: a gate. Both are measured
//! from the poses. Linear and angular speed need not follow the law, and are reported. The law of a rig is that of its
//! body, so nothing is asked of its cameras.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass, Verdict, limits};
use gs2e_trajectory::CourseKind;
use gs2e_trajectory::report::{ChordFollow, FollowError, SpeedReport};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest relative deviation of a step from its share of the path, as arc length. Default:
    /// `ARC`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub arc: Option<f64>,
    /// Largest relative deviation of a step from its share of the path, as chord. Default: `CHORD`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub chord: Option<f64>,
}

const ARC: f64 = 1e-6;
const CHORD: f64 = 0.03;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct SpeedPass;

const NAME: &str = "speed";

impl ValidationPass for SpeedPass {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(report) = subject.speed else {
            return vec![subject.not_run(NAME, "", "the trajectory has no speed report")];
        };
        if report.kind == CourseKind::Mounted {
            return vec![subject.not_run(
                NAME,
                "",
                "the speed law is that of the body that carries the camera",
            )];
        }
        let Some(chords) = report.measure_chords(&subject.trajectory.world_from_camera) else {
            let because = format!(
                "speed.json has {} steps for {} poses",
                report.s.len().saturating_sub(1),
                subject.trajectory.world_from_camera.len()
            );
            let judged = Judgement { verdict: Verdict::Fail, ..Judgement::not_run(because) };
            return vec![judge_arc(subject, report), subject.finding(NAME, "chord", judged)];
        };
        vec![
            judge_arc(subject, report),
            judge_chord(subject, &chords),
            judge_length(subject, report, &chords),
        ]
    }
}

/// Compares the length of the chords with that of the curve.
fn judge_length(subject: &TrajectorySubject<'_>, report: &SpeedReport, chords: &ChordFollow) -> Finding {
    let Some(curve) = report.length_ratio.map(|ratio| ratio * report.length).filter(|length| *length > 0.0)
    else {
        return subject.not_run(NAME, "length", "the camera does not move");
    };
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.chord), LimitSide::gate(CHORD));
    let measured = (chords.length / curve - 1.0).abs();
    let because = format!(
        "the steps between the poses sum to {:.4} times the length of the curve in speed.json",
        chords.length / curve
    );
    let judged = Judgement::from_value(limit.at_most(measured), measured, limit, "1", because);
    subject.finding(NAME, "length", judged)
}

fn judge_arc(subject: &TrajectorySubject<'_>, report: &SpeedReport) -> Finding {
    if subject.is_release {
        let because = "the fitted curve is not in a release; `chord` and `length` judge the poses";
        return subject.not_run(NAME, "arc", because);
    }
    if report.literal {
        return subject.not_run(
            NAME,
            "arc",
            "not applicable with `literal`: the paper's chords need not follow the speed law",
        );
    }
    let Some(follow) = report.mixed_ratio else {
        return subject.not_run(NAME, "arc", "the camera does not move");
    };
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.arc), LimitSide::gate(ARC));
    judge_follow(subject, "arc", follow, limit, "")
}

fn judge_chord(subject: &TrajectorySubject<'_>, chords: &ChordFollow) -> Finding {
    let Some(follow) = chords.mixed else {
        return subject.not_run(NAME, "chord", "the camera does not move");
    };
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.chord), LimitSide::warning(CHORD));
    let phrase = |name: &str, follow: Option<FollowError>| {
        follow.map_or_else(String::new, |f| format!("; {name} speed {:.3} to {:.3}", f.min, f.max))
    };
    let parts = phrase("linear", chords.linear) + &phrase("angular", chords.angular);
    judge_follow(subject, "chord", follow, limit, &parts)
}

fn judge_follow(
    subject: &TrajectorySubject<'_>,
    part: &str,
    follow: FollowError,
    limit: LimitSide,
    more: &str,
) -> Finding {
    let measured = (follow.min - 1.0).abs().max((follow.max - 1.0).abs());
    let because = format!(
        "steps measured by {part} length are {:.7} to {:.7} times what the speed law requires{more}",
        follow.min, follow.max
    );
    let judged = Judgement {
        verdict: limit.at_most(measured),
        measured: Some(measured),
        limit: Some(limit.value),
        unit: "1",
        because,
    };
    subject.finding(NAME, part, judged)
}
