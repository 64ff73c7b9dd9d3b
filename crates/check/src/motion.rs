//! Events against scene motion: moved along the optical flow to one instant, events gather on the
//! edges that made them (the contrast of the image of warped events; Gallego et al., CVPR 2018).
//!
//! Around each instant with a known depth, the flow follows from depth, poses and their stamps. The
//! events of a short window are counted in place and, a second time, at the pixel from which they
//! come at that instant. The variances of both counts are compared. ON and OFF are counted
//! separately, and places are rounded to whole pixels in both, so that neither image is smoother.
//! Wrong depths, stamps or axes blur the moved image. A ratio below 1 by more than noise is a gate;
//! a median below 1.2, or a ratio below 1 in one window of twenty, is a warning. The median may be
//! closer to 1 where noise makes a share of the events, a filter delays them, or fewer than three
//! windows tell. The events of a lamp show the picture in place, and the pass is not run.
//!
//! Events between two frames fade instead of moving. If the image moves by several px per frame,
//! the pass makes no statement (see `sampling`).

pub mod warp;

use super::subject::{Judgement, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, Verdict, limits};
use serde::{Deserialize, Serialize};
use warp::WarpSharpness;

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Smallest median ratio of the variances, moved over in place. Default: `MEDIAN`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub median: Option<f64>,
}

/// Smallest median ratio of a stream with events that move with the scene.
const MEDIAN: f64 = 1.2;
/// Smallest share of windows with a ratio above 1.
const WINDOWS: f64 = 0.95;
/// Minimum number of windows from which a median shows the usual gain.
const MIN_WINDOWS: usize = 3;
/// Minimum image motion in a window, px. Below it, moving the events changes little.
const MIN_MOVED: f64 = 3.0;
/// Minimum number of events in a window.
const MIN_EVENTS: u64 = 1000;
/// Maximum image motion between frames, px. Beyond it, events do not move with the image.
const MAX_PER_FRAME: f32 = 2.0;
/// Maximum image motion during the delay of a filter, px. Delays differ between dark and bright
/// pixels by more than this delay itself.
const MAX_DELAYED: f64 = 1.0;
/// The grey at which the noise is taken.
const GREY: f64 = 64.0;
/// Distance of the median below 1, in standard deviations of noise, from which on it is a fault.
const CERTAIN: f64 = 4.5;

/// The pass.
pub(crate) struct MotionCompensation;

impl ValidationPass for MotionCompensation {
    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let tally = subject.events()?;
        // With a tolerance, the frames are not at the poses, and the motion between them is small.
        let at_poses = !(subject.is_release && subject.tolerance.is_some());
        if let Some(flow) = subject.flow.filter(|flow| at_poses && flow.median > MAX_PER_FRAME) {
            return Err(format!(
                "the picture moves by {:.1} px between frames, too far for interpolated events to follow the motion",
                flow.median
            ));
        }
        subject.changes_one_by_one()?;
        if subject.compared_sensor().is_some_and(|sensor| !sensor.hot_pixels().is_absent()) {
            return Err("not applicable with hot pixels: their events do not move".into());
        }
        if let Some(px) = delayed_px(subject).filter(|px| *px > MAX_DELAYED) {
            return Err(format!(
                "the sensor's low-pass filter delays events while the picture moves by {px:.1} px, so that they do not meet at their edges"
            ));
        }
        if tally.sharpness.is_empty() {
            return Err("there is no depth or flow of a moving view".into());
        }
        let telling = |s: &&WarpSharpness| s.moved_px >= MIN_MOVED && s.events >= MIN_EVENTS;
        let windows: Vec<&WarpSharpness> = tally.sharpness.iter().filter(telling).collect();
        if windows.is_empty() {
            return Err(format!(
                "too little motion to judge: no window has {MIN_EVENTS} events and {MIN_MOVED} px of motion"
            ));
        }
        Ok(vec![("median", Ok(judge_median(subject, &windows))), ("windows", Ok(judge_share(&windows)))])
    }
}

fn judge_median(subject: &TrajectorySubject<'_>, windows: &[&WarpSharpness]) -> Judgement {
    let mut ratios: Vec<f64> = windows.iter().map(|s| s.ratio()).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let measured = ratios[(ratios.len() - 1) / 2];
    // The median is at most as noisy as its noisiest window.
    let noise = windows.iter().map(|s| s.noise()).fold(0.0, f64::max);
    let gate = LimitSide::gate(1.0 - CERTAIN * noise);
    let most = if windows.len() < MIN_WINDOWS { 1.0 } else { 1.0 + (MEDIAN - 1.0) * sharp_share(subject) };
    let default = LimitSide::warning(most);
    let wanted = LimitSide::limit_or(subject.limits.motion.and_then(|l| l.median), default);
    // The gate holds even where the recipe asks for less.
    let (verdict, limit) = match gate.at_least(measured) {
        Verdict::Pass => (wanted.at_least(measured), wanted.value),
        failed => (failed, gate.value),
    };
    let because = format!(
        "motion compensation changes the contrast of events by {measured:.3}x (median of {} windows, {:.3}x to {:.3}x); sound events gain contrast",
        windows.len(),
        ratios[0],
        ratios[ratios.len() - 1]
    );
    Judgement::new(verdict, measured, limit, "1", because)
}

/// Image motion during the delay of a filter, px; `None` if one of both is unknown.
fn delayed_px(subject: &TrajectorySubject<'_>) -> Option<f64> {
    let px_s = subject.moved_px? / subject.seconds();
    Some(px_s * 1e-6 * subject.drift_law().ok()?.delay_us)
}

/// Share of the usual gain in contrast that a sensor leaves. Noise does not move with the image: it
/// adds to both variances. A low-pass filter delays the events of dark pixels more than others, so
/// that they do not meet at one place.
fn sharp_share(subject: &TrajectorySubject<'_>) -> f64 {
    let (Ok(law), Some(tally)) = (subject.drift_law(), subject.tally) else { return 1.0 };
    let noise = law.noise_events(GREY) * 1e6 * subject.seconds() * tally.size.pixels() as f64;
    let signal = (1.0 - noise / tally.events.max(1) as f64).clamp(0.0, 1.0);
    if law.delay_us > 0.0 { 0.25 * signal } else { signal }
}

fn judge_share(windows: &[&WarpSharpness]) -> Judgement {
    let sharper = windows.iter().filter(|s| s.ratio() > 1.0).count();
    let measured = sharper as f64 / windows.len() as f64;
    let limit = LimitSide::warning(WINDOWS);
    let because = format!("{sharper} of {} windows gain contrast by motion compensation", windows.len());
    Judgement::at_least(measured, limit, "1", because)
}

#[cfg(test)]
mod tests {
    use crate::Verdict;
    use crate::planted::PlantedWorld;

    #[test]
    fn events_that_do_not_move_with_the_scene_are_found() {
        let turned = |flow: fn([f32; 2]) -> [f32; 2], verdict: Verdict| {
            let mut world = PlantedWorld::default_world();
            for at in &mut world.flows {
                at.px_s.pixels_mut().iter_mut().for_each(|v| *v = flow(*v));
            }
            let found = world.finding("motion#median");
            assert_eq!(found.verdict, verdict, "{found:?}");
        };
        // As with poses from world to camera, or with OpenGL camera axes.
        turned(|[u, v]| [-u, v], Verdict::Fail);
        turned(|[u, v]| [u, v], Verdict::Pass);
        let mut world = PlantedWorld::default_world();
        world.flow.as_mut().unwrap().median = 3.0;
        assert_eq!(world.finding("motion").verdict, Verdict::NotRun);
        // A single window has no median.
        let mut world = PlantedWorld::default_world();
        let limit = |world: &PlantedWorld| world.finding("motion#median").limit.unwrap();
        assert!(limit(&world) > 1.1);
        world.flows.truncate(1);
        assert!((limit(&world) - 1.0).abs() < 1e-9);
    }
}
