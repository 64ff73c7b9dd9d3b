//! Events are there at all times and everywhere on the sensor. A gate.
//!
//! Between two neighbouring anchors, the events of a pixel whose drift is larger than one and a
//! quarter thresholds must show that drift up to the voltage that remains at either end. The
//! measured value is the sum of the drift by events over the sum of the drift, over these pixels.
//! Sound streams show half of it or more; an interval without events shows nothing.
//!
//! Where an image turns back, most pixels begin close to an event of the other direction and may show
//! nothing. So the voltage that a pixel began with, plus its drift, must be as large too.
//!
//! - `time`: the smallest share over the intervals. It finds chunks, windows and halves of the
//!   recording that are missing.
//! - `place`: the smallest share over 4x4 parts of the sensor. It finds rows, columns and parts of
//!   the sensor that are missing.

pub mod intervals;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{StreamTally, TrajectorySubject, ValidationPass, limits};
use intervals::TileSums;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest share of the brightness change that events show. Default: `SHARE`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
}

/// Sound streams show 0.48 to 0.9: a change of one and a quarter thresholds leaves one event, or none
/// where the pixel was about to fire the other way.
const SHARE: f64 = 0.35;
/// Minimum number of pixels in an interval, and in a part of the sensor.
const MIN_PIXELS: u64 = 100;

/// The pass.
pub(crate) struct CompletenessPass;

impl ValidationPass for CompletenessPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        subject.changes_one_by_one()?;
        let (tally, law) = subject.compared_at_once()?;
        law.loose.map_or(Ok(()), Err)?;
        Ok(vec![("time", judge_time(subject, tally)), ("place", judge_place(subject, tally))])
    }
}

fn judge_time(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> JudgementResult {
    let intervals = &tally.compared.intervals;
    let sums = intervals.iter().map(|interval| {
        let [from, to] = interval.span_us;
        (interval.sums, format!("between {from} and {to} us"))
    });
    judge_least(subject, sums, "intervals between kept frames")
}

fn judge_place(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> JudgementResult {
    // Parts are numbered row by row.
    let side = tally.compared.tiles.len().isqrt().max(1);
    let tiles = tally.compared.tiles.iter().enumerate().map(|(i, sums)| {
        (*sums, format!("in part ({}, {}) of {side}x{side} of the sensor", i % side, i / side))
    });
    judge_least(subject, tiles, "parts of the sensor")
}

fn judge_least(
    subject: &TrajectorySubject<'_>,
    all: impl Iterator<Item = (TileSums, String)>,
    what: &str,
) -> JudgementResult {
    // A part with few pixels may miss half of its drift by chance.
    let enough: Vec<(TileSums, String)> = all.filter(|(sums, _)| sums.pixels >= MIN_PIXELS).collect();
    let least = enough.iter().min_by(|a, b| a.0.share().total_cmp(&b.0.share()));
    let Some((sums, at)) = least else {
        return Err(format!(
            "in none of the {what} do {MIN_PIXELS} pixels change by more than 1.25 thresholds"
        ));
    };
    let limit = LimitSide::limit_or(subject.limits.completeness.and_then(|l| l.min), LimitSide::gate(SHARE));
    let because = format!(
        "{at}, the events of {} pixels show {:.3} of their brightness change, the least of {} {what}",
        sums.pixels,
        sums.share(),
        enough.len()
    );
    Ok(Judgement::at_least(sums.share(), limit, "1", because))
}

#[cfg(test)]
mod tests {
    use crate::planted::PlantedWorld;
    use gs2e_event::Event;

    #[test]
    fn missing_events_are_found_by_time_and_place() {
        let t = |wanted: &str, keep: fn(&Event) -> bool| {
            let mut world = PlantedWorld::default_world();
            world.events.retain(keep);
            assert!(world.faults().contains(&wanted.to_owned()), "{wanted}: {:#?}", world.findings());
        };
        t("completeness#time", |e| !(19_000..31_000).contains(&e.t.floor_micros()));
        t("completeness#place", |e| e.x >= 24);
    }
}
