//! Events that occur twice in a stream. A gate.
//!
//! Two events of a pixel in one microsecond are legal in a burst and rare: their share is below
//! 1e-4, and higher by chance where pixels fire often, as hot ones do. The sensor counts its own pairs,
//! and the stream must hold exactly as many. This also finds a chunk that was written twice into a
//! stream with bursts. Three events of one microsecond count as three pairs in both.

use super::subject::{Judgement, LimitSide};
use super::{Finding, StreamTally, TrajectorySubject, ValidationPass, limits};
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
        let mut findings = vec![judge_share(subject, tally)];
        // A release has no account of the simulation.
        let made = subject.account.map(|account| account.same_us_same_pixel);
        findings.extend(made.map(|made| judge_excess(subject, tally.pairs, made)));
        findings
    }
}

fn judge_share(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Finding {
    let (repeats, events) = (tally.repeated + tally.contrary, tally.events);
    let limit = LimitSide::limit_or(
        subject.limits.duplicates.and_then(|l| l.max),
        LimitSide::gate(most_repeats(tally) / events.max(1) as f64),
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

/// Largest number of repeats of a sound stream.
fn most_repeats(tally: &StreamTally) -> f64 {
    let expected = SHARE * tally.events as f64 + tally.repeats_by_chance;
    // Five standard deviations of a count, and one event, which is no share of a short stream.
    expected + 5.0 * expected.sqrt() + 1.0
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

#[cfg(test)]
mod tests {
    use crate::planted::{PlantedWorld, SplitMixDraws, event_at};
    use crate::{Finding, Verdict};
    use gs2e_event::{Event, Polarity};

    /// The finding on a sound world whose events from `n` on are replaced by `more`.
    fn share(n: usize, more: impl IntoIterator<Item = Event>) -> Finding {
        let mut world = PlantedWorld::default_world();
        world.events.truncate(n);
        world.events.extend(more);
        world.events.sort_by_cached_key(Event::file_order);
        world.finding("duplicates#share")
    }

    #[test]
    fn one_repeat_is_no_share_of_a_short_stream() {
        let last = PlantedWorld::default_world().events[7999];
        assert_eq!(share(8000, [last]).verdict, Verdict::Pass);
        assert_eq!(share(8000, [last; 12]).verdict, Verdict::Fail);
    }

    /// Hot pixels repeat themselves by chance, whether the sensor states them or not.
    #[test]
    fn pixels_that_fire_often_repeat_themselves() {
        let mut draws = SplitMixDraws(5);
        // 20 pixels at 40 kHz for 60 ms: a pixel fires in one microsecond of 25.
        let hot: Vec<Event> = (0..20 * 2400)
            .map(|i| event_at(97 * (i % 20), 1000 * draws.below(60_000) as i64, Polarity::On))
            .collect();
        let found = share(8000, hot.clone());
        assert!(found.measured.unwrap() > 0.01 && found.verdict == Verdict::Pass, "{found:?}");
        let again = hot[..hot.len() / 10].to_vec();
        assert_eq!(share(8000, [hot, again].concat()).verdict, Verdict::Fail);
    }
}
