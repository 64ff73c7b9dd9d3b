//! Events that occur twice in a stream. A gate.
//!
//! Two events of a pixel in one microsecond are legal in a burst and rare: their share is below
//! 1e-4. The sensor counts its own pairs, and the stream must hold exactly as many. This also finds
//! a chunk that was written twice into a stream with bursts. Three events of one microsecond count
//! as three pairs in both.

use super::subject::{Judgement, LimitSide};
use super::{Finding, TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest share of events that repeat the time and pixel of another. Default: `SHARE`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// Share of repeats that bursts can explain.
const SHARE: f64 = 1e-4;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct DuplicatesPass;

const NAME: &str = "duplicates";

impl ValidationPass for DuplicatesPass {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Vec<Finding> {
        let Some(tally) = subject.tally else {
            return vec![subject.not_run(NAME, "", "there are no events")];
        };
        let mut findings = vec![judge_share(subject, tally.repeated + tally.contrary, tally.events)];
        // A release has no account of the simulation.
        let made = subject.account.map(|account| account.same_us_same_pixel);
        findings.extend(made.map(|made| judge_excess(subject, tally.pairs, made)));
        findings
    }
}

fn judge_share(subject: &TrajectorySubject<'_>, repeats: u64, events: u64) -> Finding {
    let limit = LimitSide::limit_or(
        subject.limits.duplicates.and_then(|l| l.max),
        LimitSide::gate(SHARE + by_chance(subject)),
    );
    let share = repeats as f64 / events.max(1) as f64;
    let because = format!("{repeats} of {events} events repeat the time and pixel of the previous event");
    let judged = Judgement {
        verdict: limit.at_most(share),
        measured: Some(share),
        limit: Some(limit.value),
        unit: "1",
        because,
    };
    subject.finding(NAME, "share", judged)
}

/// Expected share of repeats by hot pixels, which fire at random: their rate times a microsecond.
fn by_chance(subject: &TrajectorySubject<'_>) -> f64 {
    subject.sensor.map_or(0.0, |sensor| sensor.hot_pixels().rate * 1e-6)
}

fn judge_excess(subject: &TrajectorySubject<'_>, pairs: u64, made: u64) -> Finding {
    let because = format!(
        "the stream has {pairs} pairs of events with equal time and pixel; the simulation made {made}"
    );
    let difference = pairs.abs_diff(made) as f64;
    let judged = Judgement {
        verdict: LimitSide::gate(0.0).at_most(difference),
        measured: Some(difference),
        limit: Some(0.0),
        unit: "events",
        because,
    };
    subject.finding(NAME, "account", judged)
}
