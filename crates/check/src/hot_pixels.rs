//! Pixels that fire far more than the others, and pixels that are silent where the image changes.
//! Warnings; gates where the recipe sets a limit.
//!
//! `hot`: a pixel with more events than the mean plus five standard deviations, and five times the count that
//! all but one in a thousand pixels have. A sensor with hot pixels in its recipe may have that many, plus
//! five standard deviations. `dead`: a pixel that never fires although the frames changed by more than two
//! thresholds; this needs a law in which frames determine the drift. A pixel that fires later is not dead:
//! where the recipe states a tolerance, the sensor may not have seen a brief change. `stray`, from the files
//! of a release: a pixel whose events and drift differ by three thresholds more than is possible. It finds
//! clusters that fire too slowly to be hot, and pixels that lose many of their events.

use super::event_frame::fit::STRAY;
use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{StreamTally, TrajectorySubject, ValidationPass, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest share of hot pixels. Default: `SHARE`, and what the recipe makes hot.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub hot: Option<f64>,
    /// Largest share of dead pixels among those that the frames changed. Default: `SHARE`, or three pixels.
    #[serde(deserialize_with = "limits::parse_share", skip_serializing_if = "Option::is_none")]
    pub dead: Option<f64>,
}

/// Share of pixels that may be abnormal.
const SHARE: f64 = 1e-4;
/// Number of stray or dead pixels that a sensor of any size may have.
const FEW: f64 = 3.0;
/// Minimum number of changed pixels for a share.
const MIN_PIXELS: u64 = 1000;

/// The pass.
pub(crate) struct HotPixelsPass;

impl ValidationPass for HotPixelsPass {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        let mut statements =
            vec![("hot", Ok(judge_hot(subject, tally))), ("dead", judge_dead(subject, tally))];
        // In a build, the sensor's own account is exact: `drift_identity`.
        let stray = subject.is_release.then(|| judge_stray(subject)).flatten();
        statements.extend(stray.map(|judged| ("stray", Ok(judged))));
        Ok(statements)
    }
}

fn judge_hot(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> Judgement {
    let limits = subject.limits.hot_pixels.unwrap_or_default();
    let pixels = tally.size.pixels() as f64;
    let stated = subject.sensor.map_or(0.0, |sensor| sensor.hot_pixels().share);
    // The number of hot pixels is drawn, with this standard deviation or less.
    let most = SHARE + stated + 5.0 * (stated / pixels).sqrt();
    let limit = LimitSide::limit_or(limits.hot, LimitSide::warning(most));
    let busy = &tally.busy;
    let measured = busy.hot as f64 / pixels;
    let because = format!(
        "{} of {pixels} pixels have more than {} events; the busiest has {}, the mean is {:.3}{}",
        busy.hot,
        busy.bound,
        busy.most,
        busy.mean,
        if stated > 0.0 { format!("; the recipe makes a share of {stated} hot") } else { String::new() }
    );
    Judgement::at_most(measured, limit, "1", because)
}

/// Pixels whose events differ from their drift by far more than is possible; `None` where the law does not
/// say how much is possible.
fn judge_stray(subject: &TrajectorySubject<'_>) -> Option<Judgement> {
    let (tally, law) = subject.compared_at_once().ok()?;
    let fits = &tally.compared.fits;
    if law.loose.is_some() || law.has_floor() || fits.iter().any(|fit| fit.disturbed > 0.0) {
        return None;
    }
    let share = |fit: &super::event_frame::fit::AnchorFit| fit.stray as f64 / fit.compared as f64;
    let enough = fits.iter().filter(|fit| fit.compared >= MIN_PIXELS);
    let fit = enough.max_by(|a, b| share(a).total_cmp(&share(b)))?;
    // A few pixels of a small sensor are no share.
    let limit = LimitSide::warning(SHARE.max(FEW / fit.compared as f64));
    let because = format!(
        "{} of {} pixels have events that differ from their brightness change by {STRAY} thresholds more than is possible",
        fit.stray, fit.compared
    );
    Some(Judgement::at_most(share(fit), limit, "1", because).detecting(limit.value, "1"))
}

fn judge_dead(subject: &TrajectorySubject<'_>, tally: &StreamTally) -> JudgementResult {
    subject.compared_at_once()?;
    let [changed, silent] = tally.compared.must_fire;
    if changed < MIN_PIXELS {
        return Err(format!("fewer than {MIN_PIXELS} pixels changed by more than two thresholds"));
    }
    let stated = subject.limits.hot_pixels.and_then(|l| l.dead);
    // A short change between two frames may be missed; a few pixels of a small sensor are no share.
    let limit = LimitSide::limit_or(stated, LimitSide::warning(SHARE.max(FEW / changed as f64)));
    let because =
        format!("{silent} of {changed} pixels that changed by more than two thresholds have no events");
    let measured = silent as f64 / changed as f64;
    Ok(Judgement::at_most(measured, limit, "1", because))
}

#[cfg(test)]
mod tests {
    use super::Limits;
    use crate::Verdict;
    use crate::planted::{PlantedWorld, check};
    use gs2e_event::{Event, Polarity};
    use gs2e_num::units::Timestamp;

    #[test]
    fn hot_and_dead_pixels_are_found() {
        let mut world = PlantedWorld::default_world();
        let hot = |i: i64| Event {
            t: Timestamp::from_micros(60 * i),
            x: 40,
            y: 30,
            polarity: Polarity::On,
            label: gs2e_event::EventLabel::Signal,
        };
        world.events.extend((0..1000).map(hot));
        world.events.sort_by_cached_key(Event::file_order);
        assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Warn);
        world.sensor.settings.hot_pixels = gs2e_sensor::noise::HotPixelNoise {
            share: 1e-3,
            rate: 1e4,
            ..gs2e_sensor::noise::HotPixelNoise::default()
        };
        assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Pass, "the recipe says so");
        world.limits.hot_pixels = Some(Limits { hot: Some(0.0), dead: None });
        assert_eq!(world.finding("hot_pixels#hot").verdict, Verdict::Fail);
        let of_first = |n: u16| move |e: &Event| e.y == 30 && (27..27 + n).contains(&e.x);
        check(|w| w.events.retain(|e| !of_first(3)(e)), &["drift_identity#events"]);
        check(|w| w.events.retain(|e| !of_first(4)(e)), &["hot_pixels#dead", "drift_identity#events"]);
        // Pixels that fire later have missed a change, and are not dead.
        let late = |e: &Event| e.t.floor_micros() > 30_000;
        check(|w| w.events.retain(|e| !of_first(4)(e) || late(e)), &["drift_identity#events"]);
    }
}
