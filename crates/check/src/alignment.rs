//! Events and frames show the same pixels in the same places. Gates.
//!
//! For each pixel, the drift by the frames since the first of them is correlated with the drift by
//! its events, at some instants of the recording. The same is done with the events of each pixel up
//! to two columns and rows away, and with the sensor mirrored and turned.
//!
//! - `correlation`: the correlation in place. It finds events that have nothing to do with the
//!   frames (noise, another recording), and, by its sign, exchanged polarities.
//! - `shift`: the place of the largest correlation among the shifts, to a part of a pixel, along the
//!   worse axis. Another place must be better by 0.02. It finds images that are moved by a pixel.
//! - `orientation`: the largest correlation of a mirrored or turned sensor, less that in place.
//!
//! A pixel that has drifted from 0 shows its drift in whole thresholds. The difference has no
//! preferred side, so that the correlation has its peak in place at any speed and contrast.

pub mod places;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use places::{PlaceSums, Placement};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest correlation of events with the change of frames. Default: `CORRELATION`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub correlation: Option<f64>,
    /// Largest shift between events and frames. Unit: px. Default: `SHIFT`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub shift: Option<f64>,
}

const CORRELATION: f64 = 0.15;
const SHIFT: f64 = 0.5;
/// Minimum number of pixels with a change of a threshold. The correlation of as many independent
/// pixels has a standard deviation of 0.05.
const MIN_PIXELS: u64 = 400;
/// Correlation below which the best placement is chance.
const CHANCE: f64 = 0.1;
/// Minimum length of a recording, in delays of the sensor's filter.
const DELAYS: f64 = 2.0;
/// Maximum number of events of a pixel that noise makes, and the grey at which it is taken.
const MAX_NOISE: f64 = 2.0;
const GREY: f64 = 64.0;
/// Excess of a correlation over that in place which is chance.
const MARGIN: f64 = 0.02;

/// The pass.
pub(crate) struct AlignmentPass;

impl ValidationPass for AlignmentPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.compared()?;
        subject.changes_one_by_one()?;
        requires_frames(subject)?;
        let places = &tally.compared.places;
        let Some(in_place) = places.in_place().filter(|_| places.changed >= MIN_PIXELS) else {
            return Err(format!(
                "{} pixels change by a threshold between kept frames, too few to place the events",
                places.changed
            ));
        };
        Ok(vec![
            ("correlation", Ok(judge_correlation(subject, in_place))),
            ("shift", judge_shift(subject, places)),
            ("orientation", judge_orientation(places, in_place.abs())),
        ])
    }
}

/// Requires that the frames decide the events of most pixels.
fn requires_frames(subject: &TrajectorySubject<'_>) -> Result<(), &'static str> {
    let law = subject.drift_law()?;
    let us = 1e6 * subject.seconds();
    if DELAYS * law.delay_us > us {
        return Err("the sensor's low-pass filter delays events by a large part of the recording");
    }
    let [on, off] = law.floor_rates(GREY);
    let stray = law.disturbances(GREY, us) + (on + off) * us;
    if law.most_noise(us) > law.least_threshold() || stray > MAX_NOISE {
        return Err("the sensor's noise makes more events than the frames do");
    }
    Ok(())
}

fn judge_correlation(subject: &TrajectorySubject<'_>, in_place: f64) -> Judgement {
    let asked = subject.limits.alignment.and_then(|l| l.correlation);
    let limit = LimitSide::limit_or(asked, LimitSide::gate(CORRELATION));
    let because = format!(
        "the events of the pixels correlate with the brightness change of the frames at {in_place:.3}; 0 means that they show something else, and -1 that ON and OFF are exchanged"
    );
    Judgement::at_least(in_place, limit, "1", because)
}

fn judge_shift(subject: &TrajectorySubject<'_>, places: &PlaceSums) -> JudgementResult {
    subject.compared_at_once()?;
    // A smooth image fits at several places nearly as well, so the right one has an advantage.
    let shifts = places.correlations.iter().filter_map(|(placement, r)| match placement {
        Placement::Shifted([0, 0]) => Some(([0, 0], r.abs() + MARGIN)),
        Placement::Shifted(shift) => Some((*shift, r.abs())),
        Placement::Turned(_) => None,
    });
    let best = shifts.max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((shift, r)) = best.filter(|(_, r)| *r >= CHANCE + MARGIN) else {
        return Err("no shift of the events brings them to the frames".into());
    };
    let r = if shift == [0, 0] { r - MARGIN } else { r };
    let at = [[1, 0], [0, 1]].map(|axis| peak_along(places, shift, axis));
    let measured = at[0].abs().max(at[1].abs());
    let limit = LimitSide::limit_or(subject.limits.alignment.and_then(|l| l.shift), LimitSide::gate(SHIFT));
    let because = format!(
        "the events fit the frames best if they are taken from ({:.2}, {:.2}) px away, with a correlation of {r:.3}",
        at[0], at[1]
    );
    Ok(Judgement::at_most(measured, limit, "px", because))
}

/// The peak of the parabola through the largest correlation and its two neighbours along an axis,
/// as a coordinate on that axis.
fn peak_along(places: &PlaceSums, best: [i64; 2], axis: [i64; 2]) -> f64 {
    let whole = (best[0] * axis[0] + best[1] * axis[1]) as f64;
    let at = |step: i64| {
        let shift = [best[0] + step * axis[0], best[1] + step * axis[1]];
        places.shifted(shift).map(f64::abs)
    };
    match [at(-1), at(0), at(1)] {
        [Some(before), Some(top), Some(after)] => {
            let curve = before - 2.0 * top + after;
            // A flat top has no peak between the pixels, and a slope has none near this one.
            if curve < 0.0 { whole + (0.5 * (before - after) / curve).clamp(-0.5, 0.5) } else { whole }
        }
        // At the edge of the tried shifts.
        _ => whole,
    }
}

fn judge_orientation(places: &PlaceSums, in_place: f64) -> JudgementResult {
    let turned =
        places.correlations.iter().filter(|(placement, _)| matches!(placement, Placement::Turned(_)));
    let Some((placement, r)) = turned.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
        return Err("no other orientation was compared".into());
    };
    let r = r.abs();
    if in_place.max(r) < CHANCE {
        return Err("no orientation of the events brings them to the frames".into());
    }
    let limit = LimitSide::gate(MARGIN);
    let because = format!(
        "the events fit the frames with a correlation of {in_place:.3} as they are, and of {r:.3} {placement}, the best of seven other orientations"
    );
    Ok(Judgement::at_most(r - in_place, limit, "1", because))
}

#[cfg(test)]
mod tests {
    use crate::planted::PlantedWorld;
    use gs2e_event::Event;

    #[test]
    fn misplaced_events_are_found_by_their_place() {
        let t = |wanted: &str, plant: fn(&mut Event)| {
            let mut world = PlantedWorld::default_world();
            world.events.iter_mut().for_each(plant);
            world.events.retain(|e| e.x < 96 && e.y < 72);
            world.events.sort_by_cached_key(Event::file_order);
            assert!(world.faults().contains(&wanted.to_owned()), "{wanted}: {:#?}", world.findings());
        };
        t("alignment#shift", |e| e.x += 1);
        t("alignment#shift", |e| e.y += 1);
        t("alignment#orientation", |e| e.x = 95 - e.x);
        t("alignment#orientation", |e| e.y = 71 - e.y);
        t("alignment#orientation", |e| (e.x, e.y) = (e.y, e.x));
    }
}
