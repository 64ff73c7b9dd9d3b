//! Density of frames. Warnings; gates where the recipe sets the limit.
//!
//! Events between two frames come from interpolated brightness, which is accurate while the image
//! moves by at most about a pixel. The paper's own setting moves by tens of pixels, so this is only
//! a warning. In addition, some intervals are simulated again with twice the frames and the same
//! noise: the number of events must change by less than 5 %, and their times by less than a share of
//! the time between frames in the median, event by event. Events that noise made are left out: they
//! do not move. If the recipe states a tolerance, which is an error of voltage, the
//! motion and the shift are reported but not judged by default.

mod resampled;

pub use resampled::ResampledIntervals;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, Verdict, limits};
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest 95 % quantile of the optical flow per frame. Unit: px. Default: `MAX_PX`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Largest change of the number of events at twice the frames, as a share. Default: `COUNT`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub count: Option<f64>,
    /// Largest median shift of an event at twice the frames. Unit: us. Default: `SHIFT_STEPS` of the
    /// time between frames; none with a tolerance.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub shift_us: Option<f64>,
}

/// Default limit, px per frame.
const MAX_PX: f64 = 1.0;
/// Default limits of the change with twice the frames.
const COUNT: f64 = 0.05;
/// As a share of the time between frames: at [`MAX_PX`] an edge is then this far from its place, px.
const SHIFT_STEPS: f64 = 0.03;
/// Minimum number of events.
const MIN_EVENTS: u64 = 400;

/// The pass.
pub(crate) struct SamplingPass;

impl ValidationPass for SamplingPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let flow = subject.flow.ok_or("there is no depth or flow, so the image motion is unknown")?;
        let asked = subject.limits.sampling.and_then(|l| l.max);
        let measured = f64::from(flow.p95);
        let because = format!(
            "95 % of pixels move by at most {measured:.2} px between {} (median {:.2}, maximum {:.2})",
            if subject.is_release { "poses" } else { "frames" },
            flow.median,
            flow.max
        );
        if let (Some(tolerance), None) = (subject.tolerance, asked) {
            // Its error was measured on held-out intervals; a distance between frames says less.
            let because = format!(
                "{because}; the error between frames is within the tolerance of {tolerance} thresholds"
            );
            let judged = Judgement::new(Verdict::Pass, measured, None, "px/frame", because);
            return Ok(vec![("", Ok(judged))]);
        }
        let limit = LimitSide::limit_or(asked, LimitSide::warning(MAX_PX));
        Ok(vec![("", Ok(Judgement::at_most(measured, limit, "px/frame", because)))])
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(match resampled(subject) {
            Ok(tried) => {
                vec![("count", Ok(judge_count(subject, tried))), ("shift", judge_shift(subject, tried))]
            }
            Err(because) => vec![("twice", Err(because))],
        })
    }
}

/// The intervals with twice the frames, or the reason why they say nothing.
fn resampled<'a>(subject: &TrajectorySubject<'a>) -> Result<&'a ResampledIntervals, String> {
    let tried = subject.resampled.ok_or("twice the frames were not tried: this sensor follows the frames (v2e, `law: official`, a readout, `intensity: linear`), or the check reads a release")?;
    if tried.events < MIN_EVENTS {
        return Err(format!(
            "{} events in {} intervals are too few to compare",
            tried.events, tried.intervals
        ));
    }
    Ok(tried)
}

fn judge_count(subject: &TrajectorySubject<'_>, tried: &ResampledIntervals) -> Judgement {
    let limit = LimitSide::limit_or(subject.limits.sampling.and_then(|l| l.count), LimitSide::warning(COUNT));
    let measured = (tried.at_twice as f64 / tried.events as f64 - 1.0).abs();
    let because = format!(
        "in {0} intervals, a quarter of the pixel rows has {1} events, and {2} with twice the frames",
        tried.intervals, tried.events, tried.at_twice
    );
    Judgement::at_most(measured, limit, "1", because)
}

fn judge_shift(subject: &TrajectorySubject<'_>, tried: &ResampledIntervals) -> JudgementResult {
    let measured = tried.shift_us.ok_or("no event occurs in both streams")?;
    let because =
        format!("doubling the frame rate shifts events by {measured:.2} us (median of {})", tried.paired);
    let asked = subject.limits.sampling.and_then(|l| l.shift_us);
    // A tolerance bounds an error of voltage, from which no error of time follows.
    if let (Some(tolerance), None) = (tried.tolerance, asked) {
        let because =
            format!("{because}; not judged, because the recipe sets a tolerance of {tolerance} thresholds");
        return Ok(Judgement::new(Verdict::Pass, measured, None, "us", because));
    }
    let limit = LimitSide::limit_or(asked, LimitSide::warning(SHIFT_STEPS * 1e6 / subject.rate.to_f64()));
    Ok(Judgement::at_most(measured, limit, "us", because))
}

#[cfg(test)]
mod tests {
    use super::{Limits, ResampledIntervals};
    use crate::Verdict;
    use crate::planted::PlantedWorld;

    #[test]
    fn a_fast_picture_warns_and_fails_where_the_recipe_says_so() {
        let mut world = PlantedWorld::default_world();
        world.flow.as_mut().unwrap().p95 = 1.2;
        assert_eq!(world.finding("sampling").verdict, Verdict::Warn);
        // The error of a tolerance was measured, so the distance is not judged.
        world.tolerance = Some(0.1);
        assert_eq!(world.finding("sampling").verdict, Verdict::Pass);
        world.limits.sampling = Some(Limits { max: Some(1.0), ..Default::default() });
        assert_eq!(world.finding("sampling").verdict, Verdict::Fail);
    }

    #[test]
    fn frames_too_far_apart_are_found_by_doing() {
        let part = |part: &str, plant: fn(&mut ResampledIntervals)| {
            let mut world = PlantedWorld::default_world();
            plant(world.resampled.as_mut().unwrap());
            world.finding(&format!("sampling#{part}")).verdict
        };
        assert_eq!(part("count", |r| r.at_twice = 1051), Verdict::Warn);
        assert_eq!(part("count", |r| r.at_twice = 951), Verdict::Pass);
        assert_eq!(part("shift", |r| r.shift_us = Some(20.5)), Verdict::Warn);
        let asked = |r: &mut ResampledIntervals| (r.shift_us, r.tolerance) = (Some(20.5), Some(0.05));
        assert_eq!(part("shift", asked), Verdict::Pass);
        assert_eq!(part("twice", |r| r.events = 30), Verdict::NotRun);
    }
}
