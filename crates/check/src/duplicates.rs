//! Events that occur twice in a stream. A gate.
//!
//! Two events of a pixel in one microsecond are legal in a burst and rare: their share is below
//! 1e-4, and higher by chance where pixels fire often, as hot ones do. The sensor counts its own pairs,
//! and the stream must hold exactly as many. This also finds a chunk that was written twice into a
//! stream with bursts. Three events of one microsecond count as three pairs in both.

use super::subject::{Judgement, LimitSide, Statements};
use super::{StreamTally, TrajectorySubject, ValidationPass, limits};
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
pub(crate) struct DuplicatesPass;

impl ValidationPass for DuplicatesPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let mut statements = vec![("share", Ok(judge_share(subject, tally)))];
        // A release has no account of the simulation.
        let made = subject.account.map(|account| account.same_us_same_pixel);
        statements.extend(made.map(|made| ("account", Ok(judge_excess(tally.pairs, made)))));
        Ok(statements)
    }
}

fn judge_share(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Judgement {
    let (repeats, events) = (tally.repeated + tally.contrary, tally.events);
    let limit = LimitSide::limit_or(
        subject.limits.duplicates.and_then(|l| l.max),
        LimitSide::gate(most_repeats(tally) / events.max(1) as f64),
    );
    let share = repeats as f64 / events.max(1) as f64;
    let because = format!("{repeats} of {events} events repeat the time and pixel of the previous event");
    Judgement::at_most(share, limit, "1", because)
}

/// Largest number of repeats of a sound stream.
fn most_repeats(tally: &StreamTally) -> f64 {
    let expected = SHARE * tally.events as f64 + tally.repeats_by_chance;
    // Five standard deviations of a count, and one event, which is no share of a short stream.
    expected + 5.0 * expected.sqrt() + 1.0
}

fn judge_excess(pairs: u64, made: u64) -> Judgement {
    let because = format!(
        "the stream has {pairs} pairs of events with equal time and pixel; the simulation made {made}"
    );
    Judgement::none_of(pairs.abs_diff(made) as f64, "events", because)
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

    #[test]
    fn a_repeated_chunk_is_found() {
        let repeat = |w: &mut PlantedWorld| {
            let tenth = w.events[..w.events.len() / 10].to_vec();
            w.events.extend(tenth);
            w.events.sort_by_cached_key(Event::file_order);
        };
        let mut world = PlantedWorld::default_world();
        repeat(&mut world);
        let faults = world.faults();
        for wanted in
            ["duplicates#share", "duplicates#account", "event_frame#residual", "drift_identity#events"]
        {
            assert!(faults.contains(&wanted.to_owned()), "{faults:?}");
        }
    }
}
