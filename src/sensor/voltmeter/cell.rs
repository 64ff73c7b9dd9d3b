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

/// Brownian motion over a root cell: draw 0 of the tree.
pub(super) fn root_noise(seed: Seed, [x, y]: [u16; 2], root: u64) -> f64 {
    ROOT_DEVIATION * seed.normal(Cell { x, y, level: 0, index: root }, Space::Tree, 0)
}

/// Its standard deviation, `sqrt(2^20 ns)`.
const ROOT_DEVIATION: f64 = 1024.0;

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
    /// Its end, ns since the window's start.
    until: f64,
}

impl Walk<'_> {
    /// Moves the voltage `x` across the root cell.
    pub(super) fn cross(&self, x: &mut f64, scratch: &mut Scratch, emit: &mut impl Emit) -> ControlFlow<()> {
        let increment = root_noise(self.seed, self.at, self.root);
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
                    *x = leaf.cross(*x, Span { end: y, until: from + length }, &mut scratch.spans, emit)?;
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
        while let Some(span) = spans.pop() {
            let length = span.until - self.time;
            let v = self.variance * length;
            let side = match self.barriers.live(x, span.end, v) {
                Live::Neither => None,
                Live::Up => Some(Side::Up),
                Live::Down => Some(Side::Down),
                Live::Both if length > 1.0 => {
                    let end = 0.5 * (x + span.end) + 0.5 * v.sqrt() * self.draws.normal();
                    spans.extend([span, Span { end, until: self.time + 0.5 * length }]);
                    continue;
                }
                Live::Both => Some(self.barriers.likelier(x, span.end)),
            };
            let touched = side.and_then(|side| Some((side, self.touch(side, [x, span.end], v)?)));
            let Some((side, share)) = touched else {
                (x, self.time) = (span.end, span.until);
                continue;
            };
            self.time = (self.time + share * length).min(span.until);
            emit.event(self.time, polarity(side))?;
            x = 0.0;
            spans.push(span);
            let step = side.step(self.barriers);
            spans.iter_mut().for_each(|span| span.end -= step);
        }
        ControlFlow::Continue(x)
    }

    /// When the path between those voltages first touches that barrier, as a share of its length, if it does.
    fn touch(&mut self, side: Side, [x, y]: [f64; 2], v: f64) -> Option<f64> {
        let (a, g) = (side.distance(self.barriers, x), side.distance(self.barriers, y));
        if g > 0.0 && self.draws.uniform() >= touch_probability(a, g, v) {
            return None;
        }
        let (z, u) = (self.draws.normal(), self.draws.uniform());
        Some(touch_time(a, g.abs(), v, z, u))
    }
}

fn polarity(side: Side) -> Polarity {
    match side {
        Side::Up => Polarity::On,
        Side::Down => Polarity::Off,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::statistics::Renewal;

    const UNIT: Barriers = Barriers { up: 1.0, down: 1.0 };

    impl Emit for Vec<(f64, Polarity)> {
        fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
            self.push((t, polarity));
            ControlFlow::Continue(())
        }
    }

    fn draws(index: u64) -> Draws {
        Seed(11).draws(Cell { x: 0, y: 0, level: 0, index }, Space::Leaf)
    }

    /// Events of a leaf of 1024 ns from `x` to `y` with variance `v` in all, and the voltage at its end.
    fn leaf(x: f64, y: f64, v: f64, draws: Draws) -> (Vec<(f64, Polarity)>, f64) {
        let length = 1024.0;
        let mut leaf = Leaf { barriers: UNIT, variance: v / length, draws, time: 0.0 };
        let mut events = Vec::new();
        match leaf.cross(x, Span { end: y, until: length }, &mut Vec::new(), &mut events) {
            ControlFlow::Continue(end) => (events, end),
            ControlFlow::Break(()) => unreachable!("the sink never breaks"),
        }
    }

    /// Share of `n` leaves whose first event is of that polarity. `end` draws each leaf's far end.
    fn first(n: u64, polarity: Polarity, x: f64, v: f64, end: impl Fn(&mut Draws) -> f64) -> f64 {
        let count = (0..n).filter(|&i| {
            let mut draws = draws(i);
            let y = end(&mut draws);
            leaf(x, y, v, draws).0.first().is_some_and(|event| event.1 == polarity)
        });
        count.count() as f64 / n as f64
    }

    /// What `first` would be if only the barrier nearer to the start were looked at: a planted defect.
    fn first_off_of_nearer_barrier(n: u64, x: f64, v: f64, end: impl Fn(&mut Draws) -> f64) -> f64 {
        let count = (0..n).filter(|&i| {
            let mut draws = draws(i);
            let y = end(&mut draws);
            // Beyond the far barrier the defect takes that one for sure, without a look at the near one.
            let side = if y >= UNIT.up { Side::Up } else { Side::Down };
            let g = side.distance(UNIT, y);
            side == Side::Down && draws.uniform() < touch_probability(side.distance(UNIT, x), g, v)
        });
        count.count() as f64 / n as f64
    }

    fn standard_errors(found: f64, wanted: f64, n: u64) -> f64 {
        (found - wanted) / (wanted * (1.0 - wanted) / n as f64).sqrt()
    }

    #[test]
    fn bridges_between_both_barriers() {
        // First down, by the two-image sum of numerics.md 2.1, evaluated there (O11).
        for (x, y, v, wanted) in
            [(0.99, -0.99, 0.1, 0.2223), (0.95, -0.95, 0.3, 0.2584), (0.99, -0.999, 0.02, 0.7087)]
        {
            let n = 100_000;
            let found = first(n, Polarity::Off, x, v, |_| y);
            let z = standard_errors(found, wanted, n);
            println!("({x}, {y}, {v}): {found:.4}, wanted {wanted}, z {z:.2} (limit 4.5)");
            assert!(z.abs() < 4.5);
        }
    }

    #[test]
    fn the_nearer_barrier_counts_where_the_end_is_beyond_the_other() {
        // From -0.99 with drift 3 and variance 0.05: the exit problem from 0 between barriers at 1.99 and -0.01.
        let exit = Renewal { drift: 3.0, variance: 0.05, up: 1.99, down: 0.01 };
        let wanted = 1.0 - exit.on_share();
        let end = |draws: &mut Draws| -0.99 + 3.0 + 0.05f64.sqrt() * draws.normal();
        let n = 100_000;
        let z = standard_errors(first(n, Polarity::Off, -0.99, 0.05, end), wanted, n);
        let defect = standard_errors(first_off_of_nearer_barrier(n, -0.99, 0.05, end), wanted, n);
        println!("P(first OFF) {wanted:.4}: z {z:.2}, of the planted defect {defect:.0} (limit 4.5)");
        assert!(z.abs() < 4.5 && defect.abs() > 4.5);
    }

    #[test]
    fn bursts_are_a_loop() {
        let (events, end) = leaf(0.0, 5000.5, 0.0, draws(0));
        assert_eq!(events.len(), 5000);
        for (i, &(t, polarity)) in events.iter().enumerate() {
            let wanted = 1024.0 * (i + 1) as f64 / 5000.5;
            assert!((t - wanted).abs() < 1e-9 && polarity == Polarity::On, "{i}: {t}, wanted {wanted}");
        }
        // 5000 subtractions of 1 from a number below 2^13: each rounds by at most 2^-41.
        assert!((end - 0.5).abs() < 5000.0 * 2f64.powi(-41));
    }

    #[test]
    fn extremes_neither_hang_nor_leave_the_barriers() {
        for v in [1e-300, 1e-12, 1.0, 1e4] {
            for y in [-300.0, -1.0, 0.0, 0.999, 1.0, 300.0] {
                let (events, end) = leaf(0.9, y, v, draws(3));
                assert!(end.abs() < 1.0, "{v:e} {y}: {end}");
                assert!(
                    events.is_sorted_by(|a, b| a.0 <= b.0)
                        && events.iter().all(|e| (0.0..=1024.0).contains(&e.0))
                );
            }
        }
    }
}
