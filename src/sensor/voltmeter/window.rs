//! One window of time, and the legs between frames that it crosses.

use super::Between;
use super::exact::{Law, Stored};
use super::tree::LEVELS;
use std::ops::Range;

/// One window of time.
#[derive(Debug)]
pub(super) struct Window<'a> {
    pub(super) law: &'a Law,
    pub(super) frames: Vec<&'a Stored>,
    /// In order of time; the first begins at or before the window's start, the last ends at or after its end.
    pub(super) legs: Vec<Leg>,
    /// Frames whose brightness the legs' curves go by.
    pub(super) knots: Range<usize>,
    /// The leg that holds the middle, the later one at a stamp, and the time since its start.
    pub(super) middle: (usize, f64),
    /// Longest part of a leg in the window, ns.
    pub(super) widest: f64,
    /// ns since the first stamp.
    pub(super) start: i64,
    /// ns between the microsecond that the window begins in and its start.
    pub(super) into_microsecond: u64,
    /// ns
    pub(super) length: f64,
    /// Later events, in ns since `start`, are dropped.
    pub(super) last: f64,
}

/// The way from a frame to the next, or on after the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    /// Position of the earlier frame among those that are kept.
    pub(super) frame: usize,
    /// Its stamp, ns since the window's start.
    pub(super) stamp: f64,
    /// One over the time to the next frame; 0 after the last.
    pub(super) inverse: f64,
    /// What of it lies in the window, ns since the window's start.
    pub(super) from: f64,
    /// Its end.
    pub(super) to: f64,
}

impl<'a> Window<'a> {
    /// The window from `start` to `end`, in ns, which the first frame does not follow.
    pub(super) fn new(law: &'a Law, frames: Vec<&'a Stored>, [start, end]: [i64; 2], last: i64) -> Self {
        let since_start = |t: i64| (t - start) as f64;
        let before = |t: i64| frames.partition_point(|frame| frame.t <= t) - 1;
        let leg = |frame: usize| {
            let stamp = frames[frame].t;
            let next = frames.get(frame + 1).map(|next| next.t);
            Leg {
                frame,
                stamp: since_start(stamp),
                inverse: next.map_or(0.0, |next| 1.0 / (next - stamp) as f64),
                from: since_start(stamp.max(start)),
                to: since_start(next.unwrap_or(end).min(end)),
            }
        };
        let legs: Vec<Leg> = (before(start)..=before(end - 1)).map(leg).collect();
        let mut knots = before(start)..frames.len().min(before(end - 1) + 2);
        if law.between == Between::Catmull {
            knots = knots.start.saturating_sub(1)..frames.len().min(knots.end + 1);
        }
        let middle = start + (end - start) / 2;
        let holding = before(middle);
        let middle = (holding - legs[0].frame, (middle - frames[holding].t) as f64);
        let last = last.saturating_sub(start) as f64;
        let into_microsecond = start.rem_euclid(1000).cast_unsigned();
        let widest = legs.iter().map(|leg: &Leg| leg.to - leg.from).fold(0.0, f64::max);
        Self {
            law,
            legs,
            knots,
            middle,
            widest,
            start,
            into_microsecond,
            length: since_start(end),
            last,
            frames,
        }
    }

    /// The leg that holds `t`, ns since the window's start; at a stamp, the later one.
    pub(super) fn leg_at(&self, t: f64) -> usize {
        self.legs.iter().position(|leg| t < leg.to).unwrap_or(self.legs.len() - 1)
    }

    /// Number of the root cell.
    pub(super) fn root(&self) -> u64 {
        (self.start >> LEVELS).cast_unsigned()
    }
}
