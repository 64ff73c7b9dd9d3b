//! The law without noise: events are where the drift crosses a level. No random number is drawn.

use super::bridge::{Barriers, Side};
use super::cell::Emit;
use super::drift::{Path, Smooth};
use crate::event::Polarity;
use std::ops::ControlFlow;

/// Moves the voltage `x` along a path.
pub(super) fn cross(barriers: Barriers, x: &mut f64, path: &Path, emit: &mut impl Emit) -> ControlFlow<()> {
    for part in path.parts() {
        let length = part.to - part.from;
        let turn = part.smooth.turn(length);
        let mut from = 0.0;
        for to in turn.into_iter().chain([length]) {
            let run = Run { smooth: &part.smooth, begin: part.from, from, to };
            *x = run.cross(barriers, *x, emit)?;
            from = to;
        }
    }
    ControlFlow::Continue(())
}

/// A stretch of time in which the drift goes one way.
struct Run<'a> {
    smooth: &'a Smooth,
    /// Start of the piece, ns since the window's start.
    begin: f64,
    /// Start of the run since the start of the piece.
    from: f64,
    /// Its end.
    to: f64,
}

impl Run<'_> {
    /// The voltage at the end, from `x` at the start.
    fn cross(&self, barriers: Barriers, x: f64, emit: &mut impl Emit) -> ControlFlow<(), f64> {
        let base = self.smooth.rise(self.from);
        let rise = self.smooth.rise(self.to) - base;
        let (side, polarity) =
            if rise >= 0.0 { (Side::Up, Polarity::On) } else { (Side::Down, Polarity::Off) };
        let (first, step) = (side.step(barriers) - x, side.step(barriers));
        let mut crossed = 0.0;
        let mut from = self.from;
        loop {
            let target = first + crossed * step;
            if target.abs() > rise.abs() {
                return ControlFlow::Continue(x + rise - crossed * step);
            }
            from = solve(self.smooth, base + target, [from, self.to]);
            emit.event(self.begin + from, polarity)?;
            crossed += 1.0;
        }
    }
}

/// Where in `[low, high]` the monotone drift is `level`: Newton's method kept inside a bracket, to the last bit.
fn solve(smooth: &Smooth, level: f64, [mut low, mut high]: [f64; 2]) -> f64 {
    let rising = smooth.rise(high) >= smooth.rise(low);
    let mut t = 0.5 * (low + high);
    // Each round halves the bracket or is a Newton step; 200 are more than bisection alone needs.
    for _ in 0..200 {
        let error = smooth.rise(t) - level;
        if error == 0.0 {
            return t;
        }
        if (error > 0.0) == rising {
            high = t
        } else {
            low = t
        }
        let newton = t - error / smooth.rate(t);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - t).abs() <= f64::EPSILON * t.abs() || next <= low || next >= high {
            return next;
        }
        t = next;
    }
    t
}
