//! The share of ON events. A warning; a gate where the recipe sets a limit.
//!
//! The net count follows from the frames: with `s = A N_on - B N_off` summed over pixels and
//! `N = N_on + N_off`, the share of ON events is `(B + s / N) / (A + B)`. The expected `s` is the
//! drift of each pixel in whole thresholds. A balanced scene gives one half, and a leaking sensor
//! on a still scene gives 1; the usual 0.35 to 0.65 becomes the predicted value plus or minus 0.15.
//! If voltages do not start at 0, each firing pixel shifts `s` by up to `A + B` through its initial
//! and final voltage, so the width grows with the number of firing pixels divided by `N`. A sensor
//! with more leak than noise starts anywhere between 0 and `A`, and its first events are ON.
//!
//! Hot pixels add ON events, whose expected share moves the prediction.
//!
//! `contrary` is a gate: the share of events with the wrong polarity among those of pixels that
//! brighten or darken by more than 1.25 thresholds while the image moves by about a pixel.
//! Such a pixel changes steadily, so that all of its events have one polarity.

use super::event_frame::fit::AnchorFit;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements, between_bounds};
use super::{StreamTally, TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest share of ON events. Default: `WIDTH` below the share that the frames predict.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest share of ON events. Default: `WIDTH` above it.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Largest share of events whose polarity contradicts a steady change. Default: `CONTRARY`.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub contrary: Option<f64>,
}

/// Largest distance of the share from its prediction.
const WIDTH: f64 = 0.15;
/// Minimum number of events: with 400, the standard deviation of a share is at most 0.025, a sixth
/// of the width.
const MIN_EVENTS: u64 = 400;
/// Pixels at thin lines brighten and darken within a pixel of motion.
const CONTRARY: f64 = 0.05;
/// Minimum number of events for it.
const MIN_STEADY: f64 = 200.0;

/// The pass.
pub(crate) struct OnShare;

impl ValidationPass for OnShare {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let Some(share) = tally.on_share().filter(|_| tally.events >= MIN_EVENTS) else {
            return Err(format!("{} events are too few to measure the share of ON events", tally.events));
        };
        subject.changes_one_by_one()?;
        Ok(vec![("", Ok(judge_share(subject, tally, share))), ("contrary", judge_contrary(subject))])
    }
}

fn judge_contrary(subject: &TrajectorySubject<'_>) -> JudgementResult {
    let (tally, law) = subject.compared_at_once()?;
    subject.changes_steadily()?;
    // Over longer intervals a pixel may brighten and darken, and have events of both polarities.
    let short = tally.compared.intervals.iter().filter(|interval| interval.short);
    let [mut pixels, mut with, mut against, mut noise, mut floor] = [0.0; 5];
    for interval in short {
        let length_us = (interval.span_us[1] - interval.span_us[0]) as f64;
        let changing = interval.sums.pixels as f64;
        pixels += changing;
        with += interval.sums.events[0] as f64;
        against += interval.sums.events[1] as f64;
        // The darkest pixels have the most shots. Each hot pixel makes many events. It may change
        // steadily in every interval, so the deviations add up.
        let [hot, scatter] = law.hot_events(changing, length_us);
        noise += changing * law.shots(0.0, length_us) + hot + 5.0 * scatter;
        floor += interval.sums.floor;
    }
    // The light of these pixels is known, so their floor is expected, with the scatter of a count.
    noise += floor + 5.0 * floor.sqrt();
    let events = with + against;
    if events < MIN_STEADY {
        return Err(format!(
            "{events} events at steadily changing pixels are too few to judge their polarity"
        ));
    }
    let asked = subject.limits.polarity.and_then(|l| l.contrary);
    // A share of few events scatters about its mean.
    let scatter = 5.0 * (CONTRARY * (1.0 - CONTRARY) / events).sqrt();
    let limit = LimitSide::limit_or(asked, LimitSide::gate(CONTRARY + scatter + noise / events));
    let measured = against / events;
    let because = format!(
        "{against} of {events} events have the wrong polarity, at {pixels} pixels that brighten or darken steadily"
    );
    Ok(Judgement::at_most(measured, limit, "1", because))
}

fn judge_share(subject: &TrajectorySubject<'_>, tally: &StreamTally, share: f64) -> Judgement {
    let limits = subject.limits.polarity.unwrap_or_default();
    let predicted = predicted_share(subject, tally);
    // Without frames, half of the events are expected to be ON.
    let of_scene = predicted.unwrap_or(0.5);
    let hot = hot_share(subject, tally);
    // Of the events that are not hot, the predicted share is ON; all hot ones are.
    let center = of_scene + (1.0 - of_scene) * hot[0];
    let width = WIDTH + largest_shift(subject, tally) + 5.0 * (1.0 - of_scene) * hot[1];
    let least = LimitSide::limit_or(limits.min, LimitSide::warning((center - width).max(0.0)));
    let most = LimitSide::limit_or(limits.max, LimitSide::warning((center + width).min(1.0)));
    let (verdict, limit) = between_bounds(share, least, most);
    let because = match predicted {
        Some(p) => format!("{share:.4} of {} events are ON; the frames predict {p:.4}", tally.events),
        None => format!("{share:.4} of {} events are ON", tally.events),
    };
    Judgement::new(verdict, share, limit, "1", because)
}

/// Expected share of the events of hot pixels, which are all ON, and its standard deviation.
fn hot_share(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> [f64; 2] {
    let Ok(law) = subject.drift_law() else { return [0.0; 2] };
    let hot = law.hot_events(tally.size.pixels() as f64, 1e6 * subject.seconds());
    hot.map(|events| (events / tally.events as f64).min(1.0))
}

/// Largest shift of the share by voltages that start anywhere.
fn largest_shift(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> f64 {
    let anywhere = subject.drift_law().is_ok_and(|law| !law.from_zero);
    if anywhere { tally.active_pixels as f64 / tally.events as f64 } else { 0.0 }
}

/// The share of ON events predicted from the frames and the number of events.
fn predicted_share(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Option<f64> {
    // Events that need not match the drift do not follow from it.
    let [a, b] = subject.compared_law().ok().filter(|law| law.loose.is_none())?.thresholds;
    let AnchorFit { expected, events, .. } = tally.compared.fits.last()?;
    if *events == 0 {
        return None;
    }
    // The clamp is for few events, whose voltages at start and end weigh as much as the drift.
    Some(((b + expected / *events as f64) / (a + b)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use crate::Verdict;
    use crate::planted::{PlantedWorld, SIZE, SplitMixDraws, WorldSettings, check, event_at};
    use gs2e_event::{Event, Polarity};
    use gs2e_sensor::noise::HotPixelNoise;

    #[test]
    fn flipped_polarity_is_found() {
        let flip = |w: &mut PlantedWorld| {
            for event in &mut w.events {
                event.polarity = if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
            }
            w.events.sort_by_cached_key(Event::file_order);
        };
        let wanted = [
            "polarity#contrary",
            "event_frame#gain",
            "event_frame#gain-on",
            "event_frame#gain-off",
            "event_frame#threshold-on",
            "event_frame#threshold-off",
            "event_frame#residual",
            "event_frame#sign",
            "alignment#correlation",
            "completeness#time",
            "completeness#place",
            "drift_identity#events",
        ];
        check(flip, &wanted);
    }

    /// Hot pixels fire ON events whatever the brightness does, and their number is drawn.
    #[test]
    fn hot_pixels_do_not_contradict_a_steady_change() {
        let hot = HotPixelNoise { share: 0.004, rate: 20_000.0, spread: 0.0 };
        for seed in 0..12 {
            let mut world = PlantedWorld::default_world();
            world.sensor.settings.hot_pixels = hot;
            let mut draws = SplitMixDraws(seed);
            let end_us = world.trajectory.stamps_us.last().unwrap().unsigned_abs();
            for pixel in (0..SIZE.pixels()).filter(|_| draws.share() < hot.share).collect::<Vec<_>>() {
                // 20 events a millisecond on average.
                for _ in 0..20 * end_us / 1000 {
                    let t_us = draws.below(end_us) as i64;
                    world.events.push(event_at(pixel, 1000 * t_us, Polarity::On));
                }
            }
            world.events.sort_by_cached_key(Event::file_order);
            let found = world.finding("polarity#contrary");
            println!("{seed}: {:?} {:?} {}", found.measured, found.limit, found.because);
            assert_eq!(found.verdict, Verdict::Pass, "{seed}: {found:?}");
        }
    }

    /// A share of few events scatters.
    #[test]
    fn a_few_contrary_events_are_no_share() {
        let contrary = |share: f64| {
            let mut world =
                PlantedWorld::new(WorldSettings { thresholds: [1.7; 2], ..WorldSettings::default() });
            let mut draws = SplitMixDraws(7);
            for event in &mut world.events {
                if draws.share() < share {
                    event.polarity =
                        if event.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
                }
            }
            world.events.sort_by_cached_key(Event::file_order);
            world.finding("polarity#contrary").verdict
        };
        assert_eq!([0.0, 0.065, 0.2].map(contrary), [Verdict::Pass, Verdict::Pass, Verdict::Fail]);
    }

    #[test]
    fn a_brightening_scene_is_predicted_to_be_on() {
        let setting = WorldSettings { pace: 0.0, dawn: 3.0, ..WorldSettings::default() };
        let world = PlantedWorld::new(setting);
        let finding = world.finding("polarity");
        assert_eq!((finding.verdict, finding.measured), (Verdict::Pass, Some(1.0)), "{finding:?}");
        let mut flipped = world;
        for event in &mut flipped.events {
            event.polarity = Polarity::Off;
        }
        assert_eq!(flipped.finding("polarity").verdict, Verdict::Warn);
    }
}
