//! Agreement of the path with its speed law.
//!
//! The mixed metric, measured as arc length along the fitted curve, follows the law within 1e-6: a
//! gate, which does not apply under `literal`, the paper's chords. Measured as chords between
//! neighbouring poses, it follows the law within 3 %: a warning. Linear and angular speed need not
//! follow it, and are reported.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass, limits};
use crate::trajectory::report::{FollowError, SpeedReport};
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
        vec![judge_arc(subject, report), judge_chord(subject, report)]
    }
}

fn judge_arc(subject: &TrajectorySubject<'_>, report: &SpeedReport) -> Finding {
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

fn judge_chord(subject: &TrajectorySubject<'_>, report: &SpeedReport) -> Finding {
    let Some(follow) = report.mixed_chord_ratio else {
        return subject.not_run(NAME, "chord", "the camera does not move");
    };
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.chord), LimitSide::warning(CHORD));
    let told = |name: &str, follow: Option<FollowError>| {
        follow.map_or_else(String::new, |f| format!("; {name} speed {:.3} to {:.3}", f.min, f.max))
    };
    let parts = told("linear", report.linear_ratio) + &told("angular", report.angular_ratio);
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
