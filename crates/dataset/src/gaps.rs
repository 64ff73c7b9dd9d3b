//! Holes in a stream: pauses of all pixels between parts with a steady rate.
//!
//! A stream that pauses is not wrong by itself: the camera may stop, or the events may come in bursts, one
//! per frame. A pause is a hole if the stream goes on as it stopped: on both sides, over twice the length of
//! the pause, there are enough events, in every quarter of that time, and no other pause is a third as
//! long. Where frames show that the scene stands still, nothing is missing.
//!
//! The number of events in a time that sees 20 on average is 0 with a probability of 2e-9.

use super::samples::DatasetFrames;
use super::{EventDataset, OpenEvents, for_each_event};
use gs2e_check::{Finding, Judgement, Verdict};
use gs2e_event::EventFileError;

/// Number of the longest pauses that are looked at.
const LONGEST: usize = 32;
/// Quarters of the time on each side.
const QUARTERS: usize = 4;
/// Length of each side, pauses.
const SIDE: i64 = 2;
/// Minimum number of events on each side.
const MIN_EVENTS: u64 = 40;
/// Share of the mean of the quarters that each quarter needs.
const EVEN: f64 = 0.25;
/// A pause that is this part of the hole makes a stream of bursts.
const OTHER: i64 = 3;
/// Share of the mean motion below which the scene stands still.
const STANDS: f64 = 0.2;
/// Share of the time in which pauses are shorter than the stated one.
const PAUSE_QUANTILE: f64 = 0.99;
/// Bins of the lengths of pauses: a quarter of an octave each.
const BINS: usize = 160;

/// The pauses of a stream, counted in one pass.
#[derive(Debug, Clone)]
pub(super) struct StreamPauses {
    last_us: Option<i64>,
    /// Begin and end of the longest pauses, the longest first.
    longest: Vec<[i64; 2]>,
    /// Time in pauses, us, by their length.
    time_us: Vec<f64>,
    events: u64,
}

impl StreamPauses {
    /// Starts before the first event.
    pub(super) fn new() -> Self {
        Self { last_us: None, longest: Vec::new(), time_us: vec![0.0; BINS], events: 0 }
    }

    /// Counts the time of an event.
    pub(super) fn see(&mut self, t_us: i64) {
        self.events += 1;
        let Some(last) = self.last_us.replace(t_us) else { return };
        let pause = t_us.saturating_sub(last);
        if pause <= 0 {
            return;
        }
        self.time_us[length_bin(pause)] += pause as f64;
        let is_long = self.longest.last().is_none_or(|[start, end]| pause > end - start);
        if is_long || self.longest.len() < LONGEST {
            let at = self.longest.partition_point(|[start, end]| end - start >= pause);
            self.longest.insert(at, [last, t_us]);
            self.longest.truncate(LONGEST);
        }
    }

    /// The length below which pauses hold 99 % of the time, us.
    fn pause_quantile_us(&self) -> f64 {
        let all: f64 = self.time_us.iter().sum();
        let mut below = 0.0;
        let bin = self.time_us.iter().position(|time| {
            below += time;
            below >= PAUSE_QUANTILE * all
        });
        libm::exp2((bin.unwrap_or(0) as f64 + 1.0) / 4.0)
    }

    /// The finding on the longest hole. Reads the events once more.
    pub(super) fn judge(
        &self,
        dataset: &EventDataset<'_>,
        span_us: [i64; 2],
    ) -> Result<Finding, EventFileError> {
        let holes = self.find_holes(dataset.events, span_us)?;
        let length = |hole: &[i64; 2]| hole[1] - hole[0];
        let moving = |hole: &&[i64; 2]| dataset.frames.is_none_or(|frames| moves_within(frames, **hole));
        let (wrong, still): (Vec<_>, Vec<_>) = holes.iter().partition(moving);
        let seconds = |t_us: i64| (t_us - span_us[0]) as f64 * 1e-6;
        let (verdict, because) = match (wrong.first(), still.first()) {
            (Some(hole), _) => (
                Verdict::Fail,
                format!(
                    "{} without events between parts with a steady rate; the longest is {:.2} ms, {:.4} s after the \
                     first event: events are missing",
                    counted(wrong.len()),
                    length(hole) as f64 * 1e-3,
                    seconds(hole[0])
                ),
            ),
            (None, Some(hole)) => (
                Verdict::Pass,
                format!(
                    "{:.2} ms without events, {:.4} s after the first: the frames stand still as well",
                    length(hole) as f64 * 1e-3,
                    seconds(hole[0])
                ),
            ),
            (None, None) => {
                (Verdict::Pass, "no time without events between parts with a steady rate".to_owned())
            }
        };
        let longest = wrong.first().map_or(0, length) as f64;
        let even = (span_us[1] - span_us[0]) as f64 / self.events.max(1) as f64;
        // A hole in a part with half of the mean rate.
        let size =
            (OTHER as f64 * self.pause_quantile_us()).max(2.0 * even * MIN_EVENTS as f64 / SIDE as f64);
        let judged = Judgement::new(verdict, longest, 0.0, "us", because).detecting(size, "us");
        Ok(dataset.finding("completeness", "gaps", Ok(judged)))
    }

    /// The pauses among the longest between steady parts.
    fn find_holes(&self, events: OpenEvents<'_>, span_us: [i64; 2]) -> Result<Vec<[i64; 2]>, EventFileError> {
        let mut sides: Vec<[PauseSide; 2]> =
            self.longest.iter().map(|pause| PauseSide::both(*pause, span_us)).collect();
        for_each_event(events, |_, t_us| {
            sides.iter_mut().flatten().for_each(|side| side.see(t_us));
        })?;
        let pauses = self.longest.iter().zip(&sides);
        let steady = pauses.filter(|(_, sides)| sides.iter().all(PauseSide::is_steady));
        Ok(steady.map(|(pause, _)| *pause).collect())
    }
}

/// The time on one side of a pause.
#[derive(Debug, Clone)]
struct PauseSide {
    from_us: i64,
    to_us: i64,
    quarters: [u64; QUARTERS],
    last_us: i64,
    longest_us: i64,
    most_us: i64,
}

impl PauseSide {
    /// Both sides, within the stream.
    fn both([start, end]: [i64; 2], [first, last]: [i64; 2]) -> [Self; 2] {
        let length = end - start;
        let side = |from_us: i64, to_us: i64| Self {
            from_us,
            to_us,
            quarters: [0; QUARTERS],
            last_us: from_us,
            longest_us: 0,
            most_us: length / OTHER,
        };
        [
            side((start - SIDE * length).max(first), start),
            side(end, end.saturating_add(SIDE * length).min(last)),
        ]
    }

    fn see(&mut self, t_us: i64) {
        if t_us < self.from_us || t_us > self.to_us {
            return;
        }
        let share = (t_us - self.from_us) as f64 / (self.to_us - self.from_us).max(1) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a quarter from 0 to 3")]
        let quarter = ((share * QUARTERS as f64) as usize).min(QUARTERS - 1);
        self.quarters[quarter] += 1;
        self.longest_us = self.longest_us.max(t_us - self.last_us);
        self.last_us = t_us;
    }

    fn is_steady(&self) -> bool {
        let all: u64 = self.quarters.iter().sum();
        let least = EVEN * all as f64 / QUARTERS as f64;
        let longest = self.longest_us.max(self.to_us - self.last_us);
        all >= MIN_EVENTS
            && longest <= self.most_us
            && self.quarters.iter().all(|quarter| *quarter as f64 >= least)
    }
}

/// Returns true unless the frames show that the scene stands still.
fn moves_within(frames: &DatasetFrames, hole: [i64; 2]) -> bool {
    let activity = frames.bursts.activity(hole.map(|t| t as f64));
    activity.is_none_or(|[within, overall]| within >= STANDS * overall)
}

fn counted(number: usize) -> String {
    if number == 1 { "a time".to_owned() } else { format!("{number} times") }
}

/// A quarter of an octave per bin.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number from 0 to BINS")]
fn length_bin(pause_us: i64) -> usize {
    ((4.0 * libm::log2(pause_us as f64)) as usize).min(BINS - 1)
}
