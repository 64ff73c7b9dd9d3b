//! Events against the motion of the scene: moved along the optical flow to one instant, they fall on the
//! edges that made them (docs/checks.md; the contrast of the image of warped events, Gallego et al., CVPR
//! 2018).
//!
//! Around each instant whose depth is known, the flow follows from depth, poses and their stamps. The
//! events of a short window are counted a second time at the pixel that they come from at the instant, and
//! the variance of the counts is compared with that of the counts in place; ON and OFF are counted apart,
//! and both to whole pixels, so that neither image is smoother by itself. Depths, stamps or axes that are
//! wrong smear what they should gather: below 1 is a gate, by more than noise alone does; below 1.2 in the
//! median, or below 1 in one window of twenty, is a warning.
//!
//! Events between two frames do not move but fade, so where the picture moves by several px a frame the
//! pass says nothing (see `sampling`).

pub mod warp;

use super::subject::{Bound, Judged};
use super::{Check, Finding, Subject, Verdict, limits};
use serde::{Deserialize, Serialize};
use warp::Sharpness;

/// Limits that a recipe may set; what is absent has its default.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Least median ratio of the variances.
    #[serde(deserialize_with = "limits::positive", skip_serializing_if = "Option::is_none")]
    pub median: Option<f64>,
}

/// Least median ratio of a stream whose events move with the scene.
const MEDIAN: f64 = 1.2;
/// Share of windows that are sharper than events in place.
const WINDOWS: f64 = 0.95;
/// Way of the picture through a window below which moving the events changes little, px.
const LEAST_MOVED: f64 = 3.0;
/// Fewer events in a window make no picture.
const LEAST_EVENTS: u64 = 1000;
/// Way between frames beyond which events do not move with the picture, px.
const MOST_PER_FRAME: f32 = 2.0;
/// Standard deviations of what noise alone makes of the median, before it counts as below 1.
const CERTAIN: f64 = 4.5;

/// The pass.
#[derive(Debug, Clone, Copy)]
pub struct MotionCompensation;

const NAME: &str = "motion";

impl Check for MotionCompensation {
    fn name(&self) -> &'static str {
        NAME
    }

    fn of_stream(&self, subject: &Subject<'_>) -> Vec<Finding> {
        let Some(tally) = subject.tally else {
            return vec![subject.not_run(NAME, "", "there are no events")];
        };
        if let Some(flow) = subject.flow.filter(|flow| flow.median > MOST_PER_FRAME) {
            let because = format!(
                "the picture moves by {:.1} px between frames, where events fade in place and do not move",
                flow.median
            );
            return vec![subject.not_run(NAME, "", because)];
        }
        if subject.sensor.is_some_and(|sensor| !sensor.hot_pixels().is_absent()) {
            return vec![subject.not_run(NAME, "", "the hot pixels of the recipe outweigh what moves")];
        }
        if tally.sharpness.is_empty() {
            return vec![subject.not_run(NAME, "", "no depth of a picture that moves is at hand")];
        }
        let telling = |s: &&Sharpness| s.moved_px >= LEAST_MOVED && s.events >= LEAST_EVENTS;
        let windows: Vec<&Sharpness> = tally.sharpness.iter().filter(telling).collect();
        if windows.is_empty() {
            let because = format!(
                "in none of {} windows {LEAST_EVENTS} events move by {LEAST_MOVED} px",
                tally.sharpness.len()
            );
            return vec![subject.not_run(NAME, "", because)];
        }
        vec![median(subject, &windows), share(subject, &windows)]
    }
}

fn median(subject: &Subject<'_>, windows: &[&Sharpness]) -> Finding {
    let mut ratios: Vec<f64> = windows.iter().map(|s| s.ratio()).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let measured = ratios[(ratios.len() - 1) / 2];
    let noise = windows.iter().map(|s| s.noise()).fold(0.0, f64::max);
    let gate = Bound::gate(1.0 - CERTAIN * noise);
    let wanted = Bound::of(subject.limits.motion.and_then(|l| l.median), Bound::warning(MEDIAN));
    let (verdict, limit) = match gate.at_least(measured) {
        Verdict::Pass => (wanted.at_least(measured), wanted.value),
        failed => (failed, gate.value),
    };
    let because = format!(
        "moved along the flow, the events of {} windows have {measured:.3} times the contrast in the median, {:.3} to {:.3}",
        windows.len(),
        ratios[0],
        ratios[ratios.len() - 1]
    );
    let judged = Judged { verdict, measured: Some(measured), limit: Some(limit), unit: "1", because };
    subject.finding(NAME, "median", judged)
}

fn share(subject: &Subject<'_>, windows: &[&Sharpness]) -> Finding {
    let sharper = windows.iter().filter(|s| s.ratio() > 1.0).count();
    let measured = sharper as f64 / windows.len() as f64;
    let limit = Bound::warning(WINDOWS);
    let because = format!("{sharper} of {} windows are sharper than their events in place", windows.len());
    subject.finding(NAME, "windows", Judged::of(limit.at_least(measured), measured, limit, "1", because))
}
