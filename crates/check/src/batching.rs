//! Event times that cluster at frame times.
//!
//! `times`: at most two distinct times per frame means that the stream was made frame by frame: a
//! gate. `phase`: the counts over 16 phases of the frame interval vary by at most 0.35 of their
//! mean: a warning. Both need a minimum number of events per frame.

use super::subject::{Judgement, LimitSide, Statements};
use super::{StreamTally, TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Fewest distinct event times per frame. Default: `UNIQUE_PER_FRAME`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub unique_per_frame: Option<f64>,
    /// Largest coefficient of variation of event counts over the phase of the frame interval.
    /// Default: `PHASE_CV`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub phase_cv: Option<f64>,
}

const UNIQUE_PER_FRAME: f64 = 2.0;
const PHASE_CV: f64 = 0.35;
/// Minimum number of events. With 16 bins and this many events, the counts of a stream without
/// phase vary by 0.1 of their mean.
const MIN_EVENTS: u64 = 1600;
/// Minimum number of events per frame. With fewer, two distinct times per frame cannot be expected.
const MIN_PER_FRAME: f64 = 8.0;

/// The pass.
pub(crate) struct BatchingPass;

impl ValidationPass for BatchingPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let frames = subject.trajectory.stamps_us.len().max(1) as f64;
        if tally.events < MIN_EVENTS || (tally.events as f64) < MIN_PER_FRAME * frames {
            return Err(format!("{} events in {frames} frames are too few to test", tally.events));
        }
        Ok(vec![
            ("times", Ok(judge_times(subject, tally, frames))),
            ("phase", Ok(judge_phase(subject, tally))),
        ])
    }
}

fn judge_times(subject: &TrajectorySubject<'_>, tally: &StreamTally, frames: f64) -> Judgement {
    let limits = subject.limits.batching.unwrap_or_default();
    let limit = LimitSide::limit_or(limits.unique_per_frame, LimitSide::gate(UNIQUE_PER_FRAME));
    // Stamps are counted, not events: a frame of a million events at one instant is one stamp.
    let measured = tally.distinct_us as f64 / frames;
    let because = format!(
        "{} events have {} distinct times in {frames} frames; about one per frame means that frames set the times",
        tally.events, tally.distinct_us
    );
    Judgement::at_least(measured, limit, "1/frame", because)
}

fn judge_phase(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Judgement {
    let limits = subject.limits.batching.unwrap_or_default();
    let limit = LimitSide::limit_or(limits.phase_cv, LimitSide::warning(PHASE_CV));
    let bins = tally.phases.len() as f64;
    let mean = tally.events as f64 / bins;
    // The variation, not a chi-square: with millions of events, sound streams deviate from a flat
    // phase significantly, because motion speeds up and slows down.
    let variance = tally.phases.iter().map(|n| (*n as f64 - mean) * (*n as f64 - mean)).sum::<f64>() / bins;
    let measured = variance.sqrt() / mean;
    let because = format!(
        "event counts vary by {measured:.3} of their mean within the frame interval; a large value means that events cluster at frame times"
    );
    Judgement::at_most(measured, limit, "1", because)
}

#[cfg(test)]
mod tests {
    use crate::planted::PlantedWorld;
    use gs2e_event::Event;
    use gs2e_num::units::Timestamp;

    #[test]
    fn frame_times_are_found() {
        let snap = |w: &mut PlantedWorld| {
            let stamps = w.trajectory.stamps_us.clone();
            for event in &mut w.events {
                let later = stamps.partition_point(|stamp| *stamp < event.t.floor_micros());
                event.t = Timestamp::from_micros(stamps[later]);
            }
            w.events.sort_by_cached_key(Event::file_order);
        };
        let mut world = PlantedWorld::default_world();
        snap(&mut world);
        let faults = world.faults();
        assert!(faults.contains(&"batching#times".to_owned()), "{faults:?}");
        assert!(faults.contains(&"batching#phase".to_owned()), "{faults:?}");
    }
}
