//! One pixel in one leaf of the clock: a Brownian bridge between known ends, with its first
//! passages drawn exactly.
//!
//! ```text
//!  up    ------------x-------------------   the path touches the barrier: an event
//!                  ./ :
//!  x  *.    ./\./\/   : the voltage is reset to 0, and every
//!       \./\/         : later end moves down by one threshold
//!  -down --------------------------------
//!      now           touch            until
//! ```
//!
//! With the drift straight and both ends fixed, the drift has no further influence on the path in
//! between. The loop draws whether the path touches a barrier, and when. After a touch the rest of
//! the leaf is again a bridge, from 0 to the shifted end, so the loop goes on with it. Where both
//! barriers are within reach, no closed form tells which comes first; the span is halved by one
//! normal draw until only one barrier is.

use super::bridge::{BarrierSide, Barriers, LiveBarriers, touch_probability, touch_time};
use gs2e_event::Polarity;
use gs2e_num::seed::CellDraws;
use std::ops::ControlFlow;

/// Receives the events of one pixel in order of time.
pub trait EmitEvents {
    /// Takes an event at `t` ns since the window's start. `Break` ends the simulation.
    fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()>;
}

/// The part of a leaf from the present time on, up to a known end.
#[derive(Debug, Clone, Copy)]
pub struct LeafSpan {
    /// Voltage at its end if no further event happens, in thresholds.
    pub end: f64,
    /// Time of its end, ns since the window's start.
    pub until: f64,
}

/// A cell in which the drift is straight and both ends are known.
#[derive(Debug)]
pub struct ClockLeaf {
    /// The two thresholds.
    pub barriers: Barriers,
    /// Variance of the noise per nanosecond.
    pub variance: f64,
    /// Random draws of the cell.
    pub draws: CellDraws,
    /// Present time, ns since the window's start.
    pub time: f64,
}

impl ClockLeaf {
    /// Moves the voltage from `x` across the leaf, and returns the voltage at its end.
    pub fn cross(
        &mut self,
        mut x: f64,
        whole: LeafSpan,
        spans: &mut Vec<LeafSpan>,
        emit: &mut impl EmitEvents,
    ) -> ControlFlow<(), f64> {
        // An explicit stack in place of recursion: a burst makes thousands of events in one leaf.
        spans.clear();
        spans.push(whole);
        while let Some(span) = spans.pop() {
            let length = span.until - self.time;
            // The bridge forgets the drift: the ends are known, and only the variance of the rest
            // counts.
            let v = self.variance * length;
            let side = match self.barriers.live(x, span.end, v) {
                LiveBarriers::Neither => None,
                LiveBarriers::Up => Some(BarrierSide::Up),
                LiveBarriers::Down => Some(BarrierSide::Down),
                // The middle of the bridge is normal around the mean of its ends with variance v/4.
                LiveBarriers::Both if length > 1.0 => {
                    let end = 0.5 * (x + span.end) + 0.5 * v.sqrt() * self.draws.normal();
                    // The first half lies on top of the stack, because it comes first in time.
                    spans.extend([span, LeafSpan { end, until: self.time + 0.5 * length }]);
                    continue;
                }
                // Below one nanosecond the order of two touches has no meaning any more, and
                // halving might never end.
                LiveBarriers::Both => Some(self.barriers.likelier(x, span.end)),
            };
            let touched = side.and_then(|side| Some((side, self.touch(side, [x, span.end], v)?)));
            let Some((side, share)) = touched else {
                (x, self.time) = (span.end, span.until);
                continue;
            };
            // Rounding could place the touch after the span's end, and later events before it.
            self.time = (self.time + share * length).min(span.until);
            emit.event(self.time, side_polarity(side))?;
            // The reset subtracts a threshold from all that follows, so the known ends move with
            // it.
            x = 0.0;
            // The same end once more: after the reset, the rest of the span is a bridge from 0.
            spans.push(span);
            let step = side.step(self.barriers);
            spans.iter_mut().for_each(|span| span.end -= step);
        }
        ControlFlow::Continue(x)
    }

    /// The first touch of the barrier by the path between two voltages, as a share of the path's
    /// length. `None` if the path does not touch it.
    fn touch(&mut self, side: BarrierSide, [x, y]: [f64; 2], v: f64) -> Option<f64> {
        // `a` is above 0: a path that ends beyond a barrier has touched it, and goes on from 0.
        let (a, g) = (side.distance(self.barriers, x), side.distance(self.barriers, y));
        // A path that ends beyond the barrier touches it for certain, so no draw is spent on the
        // question.
        if g > 0.0 && self.draws.uniform() >= touch_probability(a, g, v) {
            return None;
        }
        // Always both, in this order: the number of draws is part of the law.
        let (z, u) = (self.draws.normal(), self.draws.uniform());
        // A path beyond the barrier is as likely as its mirror image, so the side of the end does
        // not matter to the time of the touch.
        Some(touch_time(a, g.abs(), v, z, u))
    }
}

fn side_polarity(side: BarrierSide) -> Polarity {
    match side {
        BarrierSide::Up => Polarity::On,
        BarrierSide::Down => Polarity::Off,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::RenewalProcess;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

    const UNIT: Barriers = Barriers { up: 1.0, down: 1.0 };

    impl EmitEvents for Vec<(f64, Polarity)> {
        fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
            self.push((t, polarity));
            ControlFlow::Continue(())
        }
    }

    fn draws(index: u64) -> CellDraws {
        Seed(11).draws(SeedCell { x: 0, y: 0, level: 0, index }, DrawSpace::Leaf)
    }

    /// Events of a leaf of 1024 ns from `x` to `y` with total variance `v`, and the voltage at its
    /// end.
    fn leaf(x: f64, y: f64, v: f64, draws: CellDraws) -> (Vec<(f64, Polarity)>, f64) {
        let length = 1024.0;
        let mut leaf = ClockLeaf { barriers: UNIT, variance: v / length, draws, time: 0.0 };
        let mut events = Vec::new();
        match leaf.cross(x, LeafSpan { end: y, until: length }, &mut Vec::new(), &mut events) {
            ControlFlow::Continue(end) => (events, end),
            ControlFlow::Break(()) => unreachable!("the sink never breaks"),
        }
    }

    /// Share of `n` leaves with a first event of that polarity. `end` draws the far end of each
    /// leaf.
    fn first(n: u64, polarity: Polarity, x: f64, v: f64, end: impl Fn(&mut CellDraws) -> f64) -> f64 {
        let count = (0..n).filter(|&i| {
            let mut draws = draws(i);
            let y = end(&mut draws);
            leaf(x, y, v, draws).0.first().is_some_and(|event| event.1 == polarity)
        });
        count.count() as f64 / n as f64
    }

    /// A planted defect: the value of `first` if only the barrier nearer to the start were
    /// considered.
    fn first_off_of_nearer_barrier(n: u64, x: f64, v: f64, end: impl Fn(&mut CellDraws) -> f64) -> f64 {
        let count = (0..n).filter(|&i| {
            let mut draws = draws(i);
            let y = end(&mut draws);
            // If the end is beyond the far barrier, the defect takes that barrier and ignores the
            // near one.
            let side = if y >= UNIT.up { BarrierSide::Up } else { BarrierSide::Down };
            let g = side.distance(UNIT, y);
            side == BarrierSide::Down && draws.uniform() < touch_probability(side.distance(UNIT, x), g, v)
        });
        count.count() as f64 / n as f64
    }

    fn standard_errors(found: f64, wanted: f64, n: u64) -> f64 {
        (found - wanted) / (wanted * (1.0 - wanted) / n as f64).sqrt()
    }

    #[test]
    fn bridges_between_both_barriers() {
        // Probability that the lower barrier is touched first, by the sum over image pairs of the
        // reflection principle.
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
        // From -0.99 with drift 3 and variance 0.05: the exit problem from 0 between barriers at
        // 1.99 and -0.01.
        let exit = RenewalProcess { drift: 3.0, variance: 0.05, up: 1.99, down: 0.01 };
        let wanted = 1.0 - exit.on_share();
        let end = |draws: &mut CellDraws| -0.99 + 3.0 + 0.05f64.sqrt() * draws.normal();
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
