//! Event rates of pixels. Gates where the recipe sets a limit, otherwise warnings.
//!
//! `rate` is events per pixel and second, compared with the recipe's `min` and `max`. `flow` is
//! events per pixel and px of median flow. The usual range is 0.02 to 1 at a contrast of 0.2, in
//! proportion to the inverse contrast elsewhere; the events that noise can make widen it upwards.
//! Outside, the luminance or the motion is wrong. A sensor with a contrast above 0.5 may see
//! nothing at all in a picture with softer edges, so it has no lower bound. A stream without events
//! gets a warning for every sensor: it may be right, but it is of no use.

use super::drift::DriftLaw;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements, between_bounds};
use super::{StreamTally, TrajectorySubject, ValidationPass, Verdict, limits};
use gs2e_sensor::SensorChoice;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Fewest events per pixel and second. Unit: Hz. Default: none.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Most events per pixel and second. Unit: Hz. Default: none.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// Events per pixel and px of flow at [`CONTRAST`].
const PER_FLOW: [f64; 2] = [0.02, 1.0];
/// The contrast for which [`PER_FLOW`] holds.
const CONTRAST: f64 = 0.2;
/// Contrast above which a sensor may make no events.
const INSENSITIVE: f64 = 0.5;
/// Events per pixel below which a stream is of no use.
const FEW: f64 = 1e-3;
/// Greys at which the noise is bounded.
const GREYS: [f64; 5] = [1.0, 16.0, 64.0, 128.0, 255.0];

/// The pass.
pub(crate) struct EventRate;

impl ValidationPass for EventRate {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        Ok(vec![("rate", Ok(judge_rate(subject, tally))), ("flow", per_flow(subject, tally))])
    }
}

fn judge_rate(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Judgement {
    let seconds = subject.seconds();
    if seconds <= 0.0 {
        let because = "there is only one frame; a sensor needs at least two to make events".to_owned();
        return Judgement::without_value(Verdict::Warn, "ev/(px s)", because);
    }
    let limits = subject.limits.event_rate.unwrap_or_default();
    let least = LimitSide::limit_or(limits.min, LimitSide::warning(0.0));
    let most = LimitSide::limit_or(limits.max, LimitSide::warning(f64::INFINITY));
    let pixels = tally.size.pixels() as f64;
    let measured = tally.events as f64 / (pixels * seconds);
    let (verdict, limit) = between_bounds(measured, least, most);
    let (verdict, because) = match (tally.events, verdict) {
        // Also without a limit: the bounds of 0 and infinity would pass it.
        (0, Verdict::Pass) => (Verdict::Warn, empty(seconds)),
        (events, Verdict::Pass) if (events as f64) < FEW * pixels => {
            let because = format!(
                "only {events} events from {pixels} pixels in {seconds:.4} s: fewer than one per 1,000 pixels"
            );
            (Verdict::Warn, because)
        }
        (events, verdict) => {
            let peak = tally.peak_per_ms as f64 * 1e-3;
            let because = format!(
                "{events} events from {pixels} pixels in {seconds:.4} s; the peak rate is {peak:.3} million events per second"
            );
            (verdict, because)
        }
    };
    // The defaults of 0 and infinity are no limits to show.
    let limit = (limits != Limits::default() && limit.is_finite()).then_some(limit);
    Judgement::new(verdict, measured, limit, "ev/(px s)", because)
}

/// An upper bound of the events of a pixel of this grey by noise.
fn most_noise_events(sensor: &SensorChoice, grey: f64, seconds: f64) -> f64 {
    DriftLaw::for_sensor(sensor).most_noise_events(grey, 1e6 * seconds)
}

fn empty(seconds: f64) -> String {
    format!("no events: no pixel crossed its threshold in {seconds:.4} s")
}

fn per_flow(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> JudgementResult {
    if tally.events == 0 {
        return Err(empty(subject.seconds()));
    }
    // Light that changes makes events without motion.
    subject.changes_one_by_one()?;
    // The median over pixels: a near object in a corner moves far, but makes few of the events.
    let (Some(moved), Some(sensor)) = (subject.moved_px, subject.sensor) else {
        return Err("there is no optical flow to compare the rate with".into());
    };
    if moved < 1.0 {
        return Err(format!("the picture moves by {moved:.2} px in total, which is less than 1 px"));
    }
    let (on, off) = sensor.as_model().contrast();
    let contrast = 0.5 * (on + off);
    // An edge of a given contrast makes that many more events as thresholds are finer.
    let sensitivity = CONTRAST / contrast;
    // The luminance of each pixel is not known here, so the noisiest of some greys bounds the
    // noise.
    let noise = GREYS.map(|grey| most_noise_events(sensor, grey, subject.seconds()));
    let noise = noise.into_iter().fold(0.0, f64::max) / moved;
    let least = if contrast > INSENSITIVE { 0.0 } else { PER_FLOW[0] * sensitivity };
    let most = PER_FLOW[1] * sensitivity + noise;
    let measured = tally.events as f64 / tally.size.pixels() as f64 / moved;
    let (verdict, limit) = between_bounds(measured, LimitSide::warning(least), LimitSide::warning(most));
    let because = format!(
        "{measured:.4} events per pixel and px of image motion ({moved:.1} px in total, the median over pixels); {least:.3} to {most:.3} is usual"
    );
    debug_assert_ne!(verdict, Verdict::Fail, "this statement only warns");
    Ok(Judgement::new(verdict, measured, limit, "ev/px^2", because))
}

#[cfg(test)]
mod tests {
    use super::Limits;
    use crate::Verdict;
    use crate::planted::PlantedWorld;

    #[test]
    fn a_recipes_rate_is_a_gate() {
        let mut world = PlantedWorld::default_world();
        let rate = world.finding("event_rate#rate").measured.unwrap();
        world.limits.event_rate = Some(Limits { min: None, max: Some(rate * 0.99) });
        assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Fail);
        world.limits.event_rate = Some(Limits { min: None, max: Some(rate * 1.01) });
        assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Pass);
    }

    #[test]
    fn a_stream_without_events_is_told_and_fails_a_limit() {
        let mut world = PlantedWorld::default_world();
        world.events.clear();
        let found = world.finding("event_rate#rate");
        assert_eq!((found.verdict, found.measured), (Verdict::Warn, Some(0.0)));
        assert!(found.because.starts_with("no events"), "{}", found.because);
        assert_eq!(world.finding("event_rate#flow").verdict, Verdict::NotRun);
        world.limits.event_rate = Some(Limits { min: Some(1e-3), max: None });
        assert_eq!(world.finding("event_rate#rate").verdict, Verdict::Fail);
    }
}
