//! One window of time, and the legs between frames that it crosses.

use super::BetweenFrames;
use super::curve::DriftCurve;
use super::exact::{ExactSettings, PendingFrame};
use super::touch::motion_reach;
use super::tree::LEVELS;
use std::ops::Range;

/// One window of time, with the frames and legs that it crosses.
#[derive(Debug)]
pub(super) struct TimeStep<'a> {
    pub(super) law: &'a ExactSettings,
    pub(super) frames: Vec<&'a PendingFrame>,
    /// The legs in order of time. The first begins at or before the window's start; the last ends
    /// at or after its end.
    pub(super) legs: Vec<FrameLeg>,
    /// Indices of the frames that the legs' curves depend on.
    pub(super) knots: Range<usize>,
    /// The leg that contains the window's middle (the later one at a stamp), and the time since the
    /// leg's start.
    pub(super) middle: (usize, f64),
    /// Length of the longest part of a leg in the window, ns.
    pub(super) widest: f64,
    /// Start of the window, ns since the first stamp.
    pub(super) start: i64,
    /// Time from the last full microsecond before the window to its start, ns.
    pub(super) into_microsecond: u64,
    /// Length of the window, ns.
    pub(super) length: f64,
    /// How far a Brownian motion of unit variance per ns strays from its chord over the window.
    pub(super) motion_reach: f64,
    /// Events after this time, ns since `start`, are dropped.
    pub(super) last: f64,
}

/// The stretch from one frame to the next, or beyond the last frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameLeg {
    /// Position of the earlier frame among those that are kept.
    pub(super) frame: usize,
    /// Stamp of the earlier frame, ns since the window's start.
    pub(super) stamp: f64,
    /// Inverse of the time to the next frame, per ns; 0 after the last frame.
    pub(super) inverse: f64,
    /// Start of the part inside the window, ns since the window's start.
    pub(super) from: f64,
    /// End of the part inside the window, ns since the window's start.
    pub(super) to: f64,
}

impl<'a> TimeStep<'a> {
    /// The window from `start` to `end`, in ns. It does not begin before the first frame.
    pub(super) fn new(
        law: &'a ExactSettings,
        frames: Vec<&'a PendingFrame>,
        [start, end]: [i64; 2],
        last: i64,
    ) -> Self {
        let since_start = |t: i64| (t - start) as f64;
        // At least one frame is counted, because no window begins before the first frame.
        let before = |t: i64| frames.partition_point(|frame| frame.t <= t) - 1;
        let leg = |frame: usize| {
            let stamp = frames[frame].t;
            let next = frames.get(frame + 1).map(|next| next.t);
            FrameLeg {
                frame,
                stamp: since_start(stamp),
                inverse: next.map_or(0.0, |next| 1.0 / (next - stamp) as f64),
                from: since_start(stamp.max(start)),
                to: since_start(next.unwrap_or(end).min(end)),
            }
        };
        // A frame stamped `end` belongs to the next window.
        let legs: Vec<FrameLeg> = (before(start)..=before(end - 1)).map(leg).collect();
        // A leg that begins in the window depends on the frame at its end too, where there is one.
        let mut knots = before(start)..frames.len().min(before(end - 1) + 2);
        // A slope is that of a parabola through three frames, so both ends need one more neighbour.
        if law.between == BetweenFrames::Catmull {
            knots = knots.start.saturating_sub(1)..frames.len().min(knots.end + 1);
        }
        let middle = start + (end - start) / 2;
        // `sigma` of the root cell is taken there. At a stamp the later leg counts.
        let holding = before(middle);
        let middle = (holding - legs[0].frame, (middle - frames[holding].t) as f64);
        // `last` is `i64::MAX` until the sequence ends.
        let last = last.saturating_sub(start) as f64;
        let into_microsecond = start.rem_euclid(1000).cast_unsigned();
        let widest = legs.iter().map(|leg: &FrameLeg| leg.to - leg.from).fold(0.0, f64::max);
        Self {
            law,
            legs,
            knots,
            middle,
            widest,
            start,
            into_microsecond,
            length: since_start(end),
            motion_reach: motion_reach(since_start(end)),
            last,
            frames,
        }
    }

    /// The leg that contains `t`, ns since the window's start; at a stamp, the later leg.
    pub(super) fn leg_at(&self, t: f64) -> usize {
        // A time at the window's end has no later leg.
        self.legs.iter().position(|leg| t < leg.to).unwrap_or(self.legs.len() - 1)
    }

    /// A bound on the distance between a pixel's drift and its chord from `a` to `b`: the largest
    /// distance at the stamps inside, plus the largest distance of a piece from its own chord.
    pub(super) fn straying<C: DriftCurve>(&self, pieces: &[[f64; 5]], [a, b]: [f64; 2]) -> f64 {
        let legs = &self.legs;
        // At `b` itself the leg that ends there counts, not the one that begins.
        let [first, last] = [self.leg_at(a), self.leg_at(b.next_down())];
        let bulge = |at: usize| {
            let (leg, [_, curve @ ..]) = (&legs[at], &pieces[at]);
            C::bulge_of_one(curve, [leg.from.max(a) - leg.stamp, leg.to.min(b) - leg.stamp])
        };
        if first == last {
            return bulge(first);
        }
        let drift = |at: usize, t: f64| {
            let (leg, [start, curve @ ..]) = (&legs[at], &pieces[at]);
            start + C::rise_of_one(curve, t - leg.stamp)
        };
        let (from, to) = (drift(first, a), drift(last, b));
        let slope = (to - from) / (b - a);
        let stray = |at: usize| (pieces[at][0] - from - slope * (legs[at].stamp - a)).abs();
        // Each piece stays near its own chord, and the polygon of these chords near the cell's
        // chord.
        (first + 1..=last).map(stray).fold(0.0, f64::max) + (first..=last).map(bulge).fold(0.0, f64::max)
    }

    /// Number of the root cell.
    pub(super) fn root(&self) -> u64 {
        (self.start >> LEVELS).cast_unsigned()
    }
}
