//! Events of pixels that see no change. Warnings; a gate where the recipe sets a limit.
//!
//! `rate`: the events of still pixels match the sensor's noise at their brightness within a factor
//! of two; wrong units or a wrong leak differ by thousands. If voltages start at 0 and a pixel's
//! mean interval is not short against the clip, fewer events are sound, because no pixel has
//! drifted far; then only the upper bound applies. `rhythm`: still pixels have no common clock, so
//! the autocorrelation of their summed rate has no peak. A peak beyond five standard deviations
//! means pixels that leak in step.
//!
//! `labels`: labels of noise and signal against the sensor's noise.

mod labels;
pub mod still;

use super::drift::DriftLaw;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_sensor::SensorChoice;
use serde::{Deserialize, Serialize};
use still::StillPixelCounts;

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest factor between the events of still pixels and those of the sensor's noise. Default:
    /// `FACTOR`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub factor: Option<f64>,
}

const FACTOR: f64 = 2.0;
const RHYTHM: f64 = 5.0;
/// Minimum number of still pixels.
const MIN_PIXELS: u64 = 1000;
/// Minimum number of events for a rhythm.
const MIN_EVENTS: u64 = 400;
const UNKNOWN: &str = "which pixels are static is unknown: there are too few frames, and no depth or flow";
/// Number of mean intervals in a clip from which the start at 0 no longer matters.
const SETTLED: f64 = 5.0;

/// The pass.
pub(crate) struct NoiseFloor;

impl ValidationPass for NoiseFloor {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let still = judge_still(subject);
        let mut statements = still.unwrap_or_else(|because| vec![("", Err(because))]);
        statements.extend(labels::judge_labels(subject).map(|judged| ("labels", judged)));
        Ok(statements)
    }
}

fn judge_still(subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
    let tally = subject.events()?;
    // Late events keep their rate, except behind a bus, which loses some.
    let loses = subject.sensor.is_some_and(|sensor| sensor.readout().is_some());
    // A latency and a filter hide no other reason.
    let at_once = |sensor: SensorChoice| sensor.without_latency().without_bandwidth();
    let law = subject.compared_sensor().map(|sensor| DriftLaw::for_sensor(&at_once(sensor)));
    if let Some(because) = law.and_then(|law| law.loose.filter(|_| loses || law.delay_us <= 0.0)) {
        return Err(because.into());
    }
    let Some(still) = tally.still.as_ref().filter(|still| still.pixels >= MIN_PIXELS) else {
        subject.drift_law()?;
        return Err(match tally.still {
            None => UNKNOWN.to_owned(),
            Some(_) => format!("fewer than {MIN_PIXELS} pixels are static"),
        });
    };
    Ok(vec![("rate", Ok(judge_rate(subject, still))), ("rhythm", judge_rhythm(still))])
}

fn judge_rate(subject: &TrajectorySubject<'_>, still: &StillPixelCounts) -> Judgement {
    let factor =
        LimitSide::limit_or(subject.limits.noise_floor.and_then(|l| l.factor), LimitSide::warning(FACTOR));
    let settled = !still.from_zero || still.intervals >= SETTLED;
    // Counts vary by at most five times the root of their expectation, which is one event or more.
    let slack = 5.0 * still.expected.max(1.0).sqrt();
    let events = still.events as f64;
    let [least, most] = [still.expected / factor.value - slack, still.expected * factor.value + slack];
    let verdict =
        if events > most || (settled && events < least) { factor.beyond } else { super::Verdict::Pass };
    let because = format!(
        "{} static pixels have {events} events; the sensor's noise at their brightness predicts {:.1}{}",
        still.pixels,
        still.expected,
        if settled { "" } else { " at most, because voltages start at 0" }
    );
    // The finding states the bound on the side of the count.
    let limit = if events < still.expected { least.max(0.0) } else { most };
    Judgement::new(verdict, events, limit, "events", because)
}

fn judge_rhythm(still: &StillPixelCounts) -> JudgementResult {
    if still.events < MIN_EVENTS {
        return Err(format!("{} events at static pixels are too few to test for a rhythm", still.events));
    }
    let limit = LimitSide::warning(RHYTHM);
    let because = format!(
        "the autocorrelation of the event rate of {} static pixels reaches {:.2} standard deviations; a high value means that they fire in step",
        still.pixels, still.rhythm
    );
    Ok(Judgement::at_most(still.rhythm, limit, "sd", because))
}

#[cfg(test)]
mod tests {
    use super::Limits;
    use crate::Verdict;
    use crate::planted::{PlantedWorld, SplitMixDraws, WorldSettings};
    use gs2e_event::{Event, Polarity};
    use gs2e_num::units::Timestamp;

    #[test]
    fn a_noise_floor_of_other_units_and_pixels_in_step_are_found() {
        let mut world = PlantedWorld::new(WorldSettings { pace: 0.0, ..WorldSettings::default() });
        world.flow = None;
        assert_eq!(world.finding("noise_floor#rate").verdict, Verdict::Pass);
        let mut draws = SplitMixDraws(2);
        let mut noise = |world: &mut PlantedWorld, t_us: &dyn Fn(usize) -> i64| {
            world.events = (0..2000)
                .map(|_| Event {
                    t: Timestamp::from_micros(t_us(draws.below(62_000))),
                    x: draws.at(96),
                    y: draws.at(72),
                    polarity: Polarity::On,
                    label: gs2e_event::EventLabel::Signal,
                })
                .collect();
            world.events.sort_by_cached_key(Event::file_order);
        };
        // The leak of 1e-7 per us makes 43 events.
        noise(&mut world, &|t| t as i64);
        let [rate, rhythm] =
            ["rate", "rhythm"].map(|part| world.finding(&format!("noise_floor#{part}")).verdict);
        assert_eq!([rate, rhythm], [Verdict::Warn, Verdict::Pass]);
        noise(&mut world, &|t| if t % 4 == 0 { t as i64 / 8000 * 8000 } else { t as i64 });
        assert_eq!(world.finding("noise_floor#rhythm").verdict, Verdict::Warn);
        world.limits.noise_floor = Some(Limits { factor: Some(100.0) });
        assert_eq!(world.finding("noise_floor#rate").verdict, Verdict::Pass);
    }
}
