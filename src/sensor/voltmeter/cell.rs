//! One pixel in one root cell of the dyadic clock: the exact law (numerics.md 2.1).
//!
//! The noise is a Brownian tree: every draw belongs to a cell of the clock, so neither frames nor neighbours nor
//! threads can change it. Cells in which no barrier is within reach are crossed in one step; the others are halved down
//! to leaves, in which the path is a bridge between known ends and its first touches are drawn exactly.

use super::bridge::{Barriers, Live, Side, touch_probability, touch_time};
use super::drift::Path;
use crate::event::Polarity;
use crate::seed::{Cell, Draws, Seed, Space};
use std::ops::ControlFlow;

/// Halvings of a root cell down to one nanosecond.
pub(super) const LEVELS: u8 = 20;
/// Length of a root cell, ns.
pub(super) const ROOT: i64 = 1 << LEVELS;
/// Longest leaf, ns.
const LEAF: u32 = 1 << 13;
/// Drift in a leaf is straight to this many thresholds.
const STRAIGHT: f64 = 1e-6;

/// Takes a pixel's events as they are found: time in ns since the window's start, and polarity. To break ends the
/// simulation.
pub(super) trait Emit {
    fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()>;
}

/// What the walk of one pixel through one root cell needs to know.
#[derive(Debug)]
pub(super) struct Walk<'a> {
    pub(super) seed: Seed,
    /// The pixel on the sensor.
    pub(super) at: [u16; 2],
    /// Number of the root cell.
    pub(super) root: u64,
    pub(super) barriers: Barriers,
    /// Noise per square root of a nanosecond, in the whole root cell.
    pub(super) sigma: f64,
    /// Drift since the start of the root cell.
    pub(super) path: &'a Path,
}

/// Buffers of a walk, and what it counts.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    cells: Vec<Pending>,
    spans: Vec<Span>,
    pub(super) leaves: u64,
    pub(super) splits: u64,
}

/// A cell that is still to be crossed.
#[derive(Debug, Clone, Copy)]
struct Pending {
    level: u8,
    start: u32,
    /// Increment of the Brownian motion over it.
    increment: f64,
    /// Drift at its end.
    drift: f64,
}

impl Pending {
    fn length(self) -> u32 {
        1 << (LEVELS - self.level)
    }
}

/// A stretch of a leaf that is still to be crossed.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// Voltage at its end, had no event happened.
    end: f64,
    /// ns.
    length: f64,
}

impl Walk<'_> {
    /// Moves the voltage `x` across the root cell.
    pub(super) fn cross(&self, x: &mut f64, scratch: &mut Scratch, emit: &mut impl Emit) -> ControlFlow<()> {
        let root = self.cell(0, 0);
        let increment = (ROOT as f64).sqrt() * self.seed.normal(root, Space::Tree, 0);
        scratch.cells.clear();
        scratch.cells.push(Pending { level: 0, start: 0, increment, drift: self.path.end() });
        let mut drift = 0.0;
        while let Some(cell) = scratch.cells.pop() {
            let [from, length] = [f64::from(cell.start), f64::from(cell.length())];
            let y = *x + (cell.drift - drift) + self.sigma * cell.increment;
            let v = self.sigma * self.sigma * length;
            let straying = self.path.straying([from, from + length], [drift, cell.drift]);
            match self.barriers.shrunk(straying).live(*x, y, v) {
                Live::Neither => *x = y,
                _ if is_leaf(cell, straying) => {
                    scratch.leaves += 1;
                    let mut leaf = Leaf {
                        barriers: self.barriers,
                        variance: self.sigma * self.sigma,
                        draws: self.seed.draws(self.cell(cell.level, cell.start), Space::Leaf),
                        time: from,
                    };
                    *x = leaf.cross(*x, Span { end: y, length }, &mut scratch.spans, emit)?;
                }
                _ => {
                    scratch.splits += 1;
                    let [left, right] = self.split(cell);
                    scratch.cells.extend([right, left]);
                    continue;
                }
            }
            drift = cell.drift;
        }
        ControlFlow::Continue(())
    }

    fn cell(&self, level: u8, start: u32) -> Cell {
        let index = self.root << level | u64::from(start >> (LEVELS - level));
        Cell { x: self.at[0], y: self.at[1], level, index }
    }

    /// The two halves: the middle of a Brownian motion between known ends is normal around their mean.
    fn split(&self, cell: Pending) -> [Pending; 2] {
        let z = self.seed.normal(self.cell(cell.level, cell.start), Space::Tree, 1);
        let half = cell.length() / 2;
        let left = 0.5 * cell.increment + 0.5 * f64::from(cell.length()).sqrt() * z;
        let (level, middle) = (cell.level + 1, cell.start + half);
        [
            Pending { level, start: cell.start, increment: left, drift: self.path.at(f64::from(middle)) },
            Pending { level, start: middle, increment: cell.increment - left, drift: cell.drift },
        ]
    }
}

fn is_leaf(cell: Pending, straying: f64) -> bool {
    cell.level == LEVELS || cell.length() <= LEAF && straying <= STRAIGHT
}

/// A stretch of time in which the drift is straight and the ends are known.
#[derive(Debug)]
struct Leaf {
    barriers: Barriers,
    /// Of the noise, per ns.
    variance: f64,
    draws: Draws,
    /// Now, ns since the window's start.
    time: f64,
}

impl Leaf {
    /// Moves the voltage `x` across the leaf; the voltage at its end.
    fn cross(
        &mut self,
        mut x: f64,
        whole: Span,
        spans: &mut Vec<Span>,
        emit: &mut impl Emit,
    ) -> ControlFlow<(), f64> {
        spans.clear();
        spans.push(whole);
        while let Some(mut span) = spans.pop() {
            let v = self.variance * span.length;
            let side = match self.barriers.live(x, span.end, v) {
                Live::Up => Some(Side::Up),
                Live::Down => Some(Side::Down),
                Live::Both if span.length > 1.0 => {
                    let middle = 0.5 * (x + span.end) + 0.5 * v.sqrt() * self.draws.normal();
                    let length = 0.5 * span.length;
                    spans.extend([Span { length, ..span }, Span { end: middle, length }]);
                    continue;
                }
                Live::Both => Some(self.barriers.likelier(x, span.end)),
                Live::Neither => None,
            };
            let touch = side.and_then(|side| Some((side, self.touch(side, x, span, v)?)));
            let Some((side, after)) = touch else {
                x = span.end;
                self.time += span.length;
                continue;
            };
            self.time += after;
            emit.event(self.time, polarity(side))?;
            x = 0.0;
            span.length -= after;
            spans.push(span);
            let step = side.step(self.barriers);
            spans.iter_mut().for_each(|span| span.end -= step);
        }
        ControlFlow::Continue(x)
    }

    /// The time until the path first touches that barrier, if it does within the span.
    fn touch(&mut self, side: Side, x: f64, span: Span, v: f64) -> Option<f64> {
        let (a, g) = (side.distance(self.barriers, x), side.distance(self.barriers, span.end));
        if g > 0.0 && self.draws.uniform() >= touch_probability(a, g, v) {
            return None;
        }
        let (z, u) = (self.draws.normal(), self.draws.uniform());
        Some(span.length * touch_time(a, g.abs(), v, z, u))
    }
}

fn polarity(side: Side) -> Polarity {
    match side {
        Side::Up => Polarity::On,
        Side::Down => Polarity::Off,
    }
}
