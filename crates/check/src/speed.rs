//! Agreement of the path with its speed law.
//!
//! The mixed metric, measured as arc length along the fitted curve, follows the law within 1e-6: a gate,
//! which does not apply under `literal`, the paper's chords. The trajectory's report has this measure,
//! because the poses alone do not determine the curve; a release does not make the statement. Measured as
//! chords between neighbouring poses, the metric follows the law within 3 %: a warning. The sum of the chords
//! is the length of the curve within 3 %: a gate. Both are measured from the poses. Linear and angular speed
//! need not follow the law, and are reported. The law of a rig is that of its body, so nothing is asked of
//! its cameras.

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, Verdict, limits};
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
const STILL: &str = "the camera does not move";

/// The pass.
pub(crate) struct SpeedPass;

impl ValidationPass for SpeedPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let report = subject.speed.ok_or("the trajectory has no speed report")?;
        if report.kind == CourseKind::Mounted {
            return Err("the speed law is that of the body that carries the camera".into());
        }
        let Some(chords) = report.measure_chords(&subject.trajectory.world_from_camera) else {
            let because = format!(
                "speed.json has {} steps for {} poses",
                report.s.len().saturating_sub(1),
                subject.trajectory.world_from_camera.len()
            );
            let chord = Judgement::without_value(Verdict::Fail, "1", because);
            return Ok(vec![("arc", judge_arc(subject, report)), ("chord", Ok(chord))]);
        };
        Ok(vec![
            ("arc", judge_arc(subject, report)),
            ("chord", judge_chord(subject, &chords)),
            ("length", judge_length(subject, report, &chords)),
        ])
    }
}

/// Compares the length of the chords with that of the curve.
fn judge_length(
    subject: &TrajectorySubject<'_>,
    report: &SpeedReport,
    chords: &ChordFollow,
) -> JudgementResult {
    let curve = report.length_ratio.map(|ratio| ratio * report.length).filter(|length| *length > 0.0);
    let curve = curve.ok_or(STILL)?;
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.chord), LimitSide::gate(CHORD));
    let measured = (chords.length / curve - 1.0).abs();
    let because = format!(
        "the steps between the poses sum to {:.4} times the length of the curve in speed.json",
        chords.length / curve
    );
    Ok(Judgement::at_most(measured, limit, "1", because))
}

fn judge_arc(subject: &TrajectorySubject<'_>, report: &SpeedReport) -> JudgementResult {
    if subject.is_release {
        return Err("the fitted curve is not in a release; `chord` and `length` judge the poses".into());
    }
    if report.literal {
        return Err("not applicable with `literal`: the paper's chords need not follow the speed law".into());
    }
    let follow = report.mixed_ratio.ok_or(STILL)?;
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.arc), LimitSide::gate(ARC));
    Ok(judge_follow("arc", follow, limit, ""))
}

fn judge_chord(subject: &TrajectorySubject<'_>, chords: &ChordFollow) -> JudgementResult {
    let follow = chords.mixed.ok_or(STILL)?;
    let limit = LimitSide::limit_or(subject.limits.speed.and_then(|l| l.chord), LimitSide::warning(CHORD));
    let phrase = |name: &str, follow: Option<FollowError>| {
        follow.map_or_else(String::new, |f| format!("; {name} speed {:.3} to {:.3}", f.min, f.max))
    };
    let split = phrase("linear", chords.linear) + &phrase("angular", chords.angular);
    Ok(judge_follow("chord", follow, limit, &split))
}

fn judge_follow(measure: &str, follow: FollowError, limit: LimitSide, more: &str) -> Judgement {
    let measured = (follow.min - 1.0).abs().max((follow.max - 1.0).abs());
    let because = format!(
        "steps measured by {measure} length are {:.7} to {:.7} times what the speed law requires{more}",
        follow.min, follow.max
    );
    Judgement::at_most(measured, limit, "1", because)
}

#[cfg(test)]
mod tests {
    use crate::planted::{PlantedWorld, check};

    #[test]
    fn a_law_that_is_not_followed_is_found() {
        check(|w| w.report.mixed_ratio.as_mut().unwrap().max = 1.00001, &["speed#arc"]);
        let still = |w: &mut PlantedWorld| {
            let first = w.trajectory.world_from_camera[0];
            w.trajectory.world_from_camera.fill(first);
        };
        check(still, &["speed#length"]);
    }
}
