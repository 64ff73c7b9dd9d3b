//! Changes of the whole picture that the motion does not explain. A gate.
//!
//! A renderer draws a Gaussian until its mean passes the near plane. A large one covers the picture at
//! that moment, see `gs2e_render::near`, so all of it changes from one frame to the next.
//!
//! - `frames`: the change of brightness from one frame to a later one, that a fifth of the picture
//!   exceeds in one direction.
//! - `events`: the events of one polarity in a millisecond, or in the interval of the frames if that is
//!   longer.
//!
//! Each is divided by its usual value, see [`course`]. Intervals of one and four steps are judged:
//! filters and latencies spread a flash over several. Where the light changes, events are not judged, and
//! frames only without the change.

pub mod blocks;
pub mod course;

use super::subject::{Judgement, JudgementResult, LimitSide, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use course::{AtypicalChange, ChangeCourse};
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::metric::MixedMetric;
use serde::{Deserialize, Serialize};

/// Limits that a recipe may set; absent ones have their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest change of the whole picture, in usual changes. Default: `MAX_RATIO`.
    #[serde(deserialize_with = "limits::parse_positive", skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

/// Default limit.
const MAX_RATIO: f64 = 5.0;
/// Smallest usual change of a frame, greys. An alarm is then at least 5 greys, which makes events at a
/// contrast of 0.1 where the picture is darker than grey 50.
const LEAST_GREY: f64 = 1.0;
/// Smallest usual number of events of a polarity per pixel and interval. An alarm is then an event at a
/// quarter of the pixels, as a change of the whole picture makes.
const LEAST_SHARE: f64 = 0.05;
/// Smallest usual number of events. Five times as many are beyond chance in a million intervals.
const LEAST_EVENTS: f64 = 10.0;
/// Numbers of steps of the intervals that are judged.
const STRIDES: [usize; 2] = [1, 4];

/// The pass.
pub(crate) struct FlashPass;

/// The name of the pass.
pub const NAME: &str = "flash";

/// A flash of the frames or the events, or the largest change if none is unusual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureFlash {
    /// Begin and end of the change, us.
    pub span_us: [i64; 2],
    /// Poses at these times: the nearest ones.
    pub poses: [usize; 2],
    /// The change, its usual value, and their quotient.
    pub change: AtypicalChange,
}

impl ValidationPass for FlashPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(vec![("frames", judge_frames(subject))])
    }

    fn of_stream(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(vec![("events", judge_events(subject))])
    }
}

fn judge_frames(subject: &TrajectorySubject<'_>) -> JudgementResult {
    let Some(frames) = subject.blocks else {
        subject.changes_one_by_one()?;
        return Err("there are no frames to compare".into());
    };
    let found = in_frames(subject, frames).ok_or("there are too few frames to know their usual change")?;
    let AtypicalChange { change, typical, ratio } = found.change;
    let because = format!(
        "from pose {} to {}, {}, a fifth of the picture changes by {change:.2} grey or more: {ratio:.1} times the usual {typical:.2}",
        found.poses[0],
        found.poses[1],
        time_of(found.span_us)
    );
    Ok(judge_ratio(subject, ratio, because))
}

fn judge_events(subject: &TrajectorySubject<'_>) -> JudgementResult {
    subject.changes_one_by_one()?;
    let tally = subject.events()?;
    let (found, polarity) = in_events(subject).ok_or("there is too little time to know the usual rate")?;
    let AtypicalChange { change, typical, ratio } = found.change;
    let because = format!(
        "{}, near pose {}, {change:.0} {polarity} events, {:.3} per pixel: {ratio:.1} times the usual {typical:.0}",
        time_of(found.span_us),
        found.poses[0],
        change / tally.size.pixels() as f64
    );
    Ok(judge_ratio(subject, ratio, because))
}

fn time_of([from, to]: [i64; 2]) -> String {
    format!("from {:.1} to {:.1} ms", from as f64 * 1e-3, to as f64 * 1e-3)
}

fn judge_ratio(subject: &TrajectorySubject<'_>, ratio: f64, because: String) -> Judgement {
    let asked = subject.limits.flash.and_then(|limits| limits.max);
    let limit = LimitSide::limit_or(asked, LimitSide::gate(MAX_RATIO));
    Judgement::at_most(ratio, limit, "1", because)
}

/// The most unusual change of the frames; `None` if there are too few.
#[must_use]
pub fn in_frames(subject: &TrajectorySubject<'_>, frames: &[blocks::FrameBlocks]) -> Option<PictureFlash> {
    let path = PathLengths::of_subject(subject);
    let found = STRIDES.iter().filter_map(|stride| {
        let pairs = || frames.iter().zip(frames.get(*stride..).unwrap_or_default());
        let course = ChangeCourse {
            changes: pairs().map(|(from, to)| from.change(to)).collect(),
            motions: pairs().map(|(from, to)| path.between_poses(from.pose, to.pose)).collect(),
        };
        let (at, change) = course.most_atypical(*stride, LEAST_GREY)?;
        let poses = [frames[at].pose, frames[at + stride].pose];
        Some(PictureFlash { span_us: poses.map(|pose| subject.trajectory.stamps_us[pose]), poses, change })
    });
    found.max_by(|a, b| a.change.ratio.total_cmp(&b.change.ratio))
}

/// The most unusual number of events, and their polarity; `None` without events, or if the stream is too
/// short.
#[must_use]
pub fn in_events(subject: &TrajectorySubject<'_>) -> Option<(PictureFlash, &'static str)> {
    let tally = subject.tally?;
    let (path, counts) = (PathLengths::of_subject(subject), &tally.course);
    let least = LEAST_EVENTS.max(LEAST_SHARE * tally.size.pixels() as f64);
    let tried = [("ON", 0), ("OFF", 1)].into_iter().flat_map(|named| STRIDES.map(|stride| (named, stride)));
    let found = tried.filter_map(|((polarity, of), stride)| {
        let spans = || counts.bins.windows(stride).enumerate();
        let span_us = |at: usize| [at, at + stride].map(|bin| bin as i64 * counts.bin_us);
        let course = ChangeCourse {
            changes: spans().map(|(_, bins)| bins.iter().map(|bin| f64::from(bin[of])).sum()).collect(),
            motions: spans().map(|(at, _)| path.within(span_us(at))).collect(),
        };
        let (at, change) = course.most_atypical(stride, least)?;
        let span_us = span_us(at);
        let poses = span_us.map(|t_us| nearest_pose(subject.trajectory, t_us));
        Some((PictureFlash { span_us, poses, change }, polarity))
    });
    found.max_by(|(a, _), (b, _)| a.change.ratio.total_cmp(&b.change.ratio))
}

fn nearest_pose(trajectory: &Trajectory, t_us: i64) -> usize {
    let stamps = &trajectory.stamps_us;
    let after = stamps.partition_point(|stamp| *stamp < t_us).min(stamps.len() - 1);
    if after > 0 && t_us - stamps[after - 1] < stamps[after] - t_us { after - 1 } else { after }
}

/// Length of the path from its first pose to each pose, in the mixed metric.
struct PathLengths<'a> {
    stamps_us: &'a [i64],
    lengths: Vec<f64>,
}

impl<'a> PathLengths<'a> {
    fn of_subject(subject: &TrajectorySubject<'a>) -> Self {
        let metric = MixedMetric { scale: subject.speed.map_or(1.0, |report| report.scale_distance) };
        let poses = &subject.trajectory.world_from_camera;
        let mut length = 0.0;
        let steps = poses.windows(2).map(|pair| {
            length += metric.distance(&pair[0], &pair[1]);
            length
        });
        Self {
            stamps_us: &subject.trajectory.stamps_us,
            lengths: std::iter::once(0.0).chain(steps).collect(),
        }
    }

    fn between_poses(&self, from: usize, to: usize) -> f64 {
        self.lengths[to] - self.lengths[from]
    }

    /// Length of the path in a span of time.
    fn within(&self, span_us: [i64; 2]) -> f64 {
        let [from, to] = span_us.map(|t_us| self.until(t_us));
        to - from
    }

    fn until(&self, t_us: i64) -> f64 {
        let after = self.stamps_us.partition_point(|stamp| *stamp <= t_us);
        if after == 0 || after == self.stamps_us.len() {
            return self.lengths[after.saturating_sub(1)];
        }
        let [from, to] = [self.stamps_us[after - 1], self.stamps_us[after]];
        let share = (t_us - from) as f64 / (to - from) as f64;
        self.lengths[after - 1] + share * (self.lengths[after] - self.lengths[after - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::Limits;
    use crate::Verdict;
    use crate::planted::PlantedWorld;
    use gs2e_event::Event;
    use gs2e_num::units::Timestamp;

    #[test]
    fn a_flash_of_all_pixels_is_found_at_its_time() {
        let mut world = PlantedWorld::default_world();
        assert_eq!(world.finding("flash#events").verdict, Verdict::Pass);
        let at =
            |k: u16| Event { x: k % 96, y: k / 96, t: Timestamp::from_micros(30_500), ..world.events[0] };
        let flash: Vec<Event> = (0..96 * 72).map(at).collect();
        world.events.extend(flash);
        world.events.sort_by_cached_key(Event::file_order);
        let found = world.finding("flash#events");
        assert_eq!(found.verdict, Verdict::Fail, "{found:#?}");
        assert!(found.because.starts_with("from 30.0 to 31.0 ms, near pose 72, "), "{found:#?}");
        world.limits.flash = Some(Limits { max: Some(1e4) });
        assert_eq!(world.finding("flash#events").verdict, Verdict::Pass);
    }
}
