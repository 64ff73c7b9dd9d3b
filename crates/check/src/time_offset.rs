//! Offset between the clocks of events and frames. A gate.
//!
//! The delay of the events follows from the pixels with steady drift at some instants, see
//! [`LagSums`].
//! It may be at most half of a frame step, and four standard deviations of the estimate more. The pass
//! needs a sensor whose drift is determined by frames, and is not run if noise hides an eighth of a step.
//! Unequal thresholds and a noise floor count by their means over the pixels. Residuals are half of a
//! threshold on average only if pixels change one by one, so the pass is not run where the light changes.

use super::event_frame::fit::LagSums;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest time offset between events and frames. Unit: us. Default: half a step between poses, and four
    /// standard deviations of the estimate.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max_us: Option<f64>,
}

/// Largest offset, in steps between poses.
const STEPS: f64 = 0.5;
/// How far the estimate may be from the offset, in its standard deviations.
const SIGMAS: f64 = 4.0;
/// Largest standard deviation of a reported offset, in the same unit.
const UNSURE: f64 = 0.125;
/// Minimum number of pixels with steady drift.
const MIN_PIXELS: u64 = 200;

/// The pass.
pub(crate) struct TimeOffset;

impl ValidationPass for TimeOffset {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(vec![("", judge_offset(subject))])
    }
}

fn judge_offset(subject: &TrajectorySubject<'_>) -> JudgementResult {
    // Pixels that change in step have equal residuals, and their mean is not half of a threshold.
    subject.changes_one_by_one()?;
    let tally = subject.compared()?;
    subject.compared_law()?.loose.map_or(Ok(()), Err)?;
    let pixels: u64 = tally.compared.fits.iter().map(|fit| fit.lag.pixels).sum();
    let lag = LagSums::pooled_lag(tally.compared.fits.iter().map(|fit| fit.lag));
    let Some([lag, deviation]) = lag.filter(|_| pixels >= MIN_PIXELS) else {
        return Err(format!(
            "{pixels} pixels change steadily by two thresholds, too few to measure an offset"
        ));
    };
    let step = 1e6 / subject.rate.to_f64();
    if deviation > UNSURE * step {
        return Err(format!(
            "the offset can be measured only to {deviation:.0} us, from {pixels} pixels with a steady change"
        ));
    }
    let stated = subject.limits.time_offset.and_then(|l| l.max_us);
    let limit = LimitSide::limit_or(stated, LimitSide::gate(STEPS * step + SIGMAS * deviation));
    // The limit is on the size; the finding keeps the sign.
    let verdict = limit.at_most(lag.abs());
    let because = format!(
        "events are {:.1} us {} than the frames, measured at {pixels} pixels with a steady change (standard deviation {deviation:.1} us)",
        lag.abs(),
        if lag < 0.0 { "earlier" } else { "later" }
    );
    // A fault may work against the offset that the stream already has. 1.645 standard deviations
    // beyond that are found in 95 % of trials.
    let detects = limit.value + lag.abs() + 1.645 * deviation;
    Ok(Judgement::new(verdict, lag, limit.value, "us", because).detecting(detects, "us"))
}

#[cfg(test)]
mod tests {
    use crate::Verdict;
    use crate::planted::{PlantedWorld, WorldSettings};
    use gs2e_num::units::Timestamp;

    #[test]
    fn an_offset_of_a_frame_is_found() {
        for (late_us, verdict) in
            [(417, Verdict::Fail), (-417, Verdict::Fail), (150, Verdict::Pass), (-150, Verdict::Pass)]
        {
            let mut world = PlantedWorld::default_world();
            let end = *world.trajectory.stamps_us.last().unwrap();
            world.events.iter_mut().for_each(|e| e.t = Timestamp(e.t.0 + 1000 * late_us));
            world.events.retain(|e| (0..=end).contains(&e.t.floor_micros()));
            let found = world.finding("time_offset");
            assert_eq!(found.verdict, verdict, "{late_us}: {found:?}");
            assert!((found.measured.unwrap() - late_us as f64).abs() < 60.0, "{late_us}: {found:?}");
        }
    }

    #[test]
    fn an_offset_of_half_a_frame_passes_where_few_pixels_measure_it() {
        // High thresholds leave 580 pixels, whose estimate errs by up to 36 us.
        for (late_us, verdict) in
            [(417, Verdict::Fail), (-417, Verdict::Fail), (208, Verdict::Pass), (-208, Verdict::Pass)]
        {
            let mut world =
                PlantedWorld::new(WorldSettings { thresholds: [1.75; 2], ..WorldSettings::default() });
            world.events.iter_mut().for_each(|e| e.t = Timestamp(e.t.0 + 1000 * late_us));
            let found = world.finding("time_offset");
            assert_eq!(found.verdict, verdict, "{late_us}: {found:?}");
            assert!((found.measured.unwrap() - late_us as f64).abs() < 60.0, "{late_us}: {found:?}");
        }
    }
}
