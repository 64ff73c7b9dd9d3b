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

#[cfg(test)]
mod tests {
    use super::super::drift::{Part, Process, Sample};
    use super::super::{Preset, Voltmeter};
    use super::*;

    const UNIT: Barriers = Barriers { up: 1.0, down: 1.0 };

    impl Emit for Vec<(f64, i32)> {
        fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
            self.push((t, if polarity == Polarity::On { 1 } else { -1 }));
            ControlFlow::Continue(())
        }
    }

    /// One piece between two greys.
    fn piece(k: [f64; 6], greys: [f32; 2], length: f64) -> Path {
        let process = Process::new(&Voltmeter::new(k));
        let [a, b] = greys.map(|luminance| Sample { luminance, log: process.log_brightness(luminance) });
        let smooth = process.between(a, b, 1.0 / length);
        let mut path = Path::default();
        path.fill([Part { from: 0.0, to: length, at: 0.0, smooth }].into_iter(), smooth.rise(length));
        path
    }

    fn events(barriers: Barriers, path: &Path) -> (Vec<(f64, i32)>, f64) {
        let (mut x, mut events) = (0.0, Vec::new());
        assert!(cross(barriers, &mut x, path, &mut events).is_continue());
        (events, x)
    }

    #[test]
    fn without_leak_events_divide_the_signal_evenly() {
        // k1 V is linear in time: event j at the time where it has risen by j.
        let [k1, k2, ..] = Preset::Dvs346.k();
        for (greys, sign) in [([0.0, 255.0], 1), ([255.0, 0.0], -1)] {
            let (found, x) = events(UNIT, &piece([k1, k2, 0.0, 0.0, 0.0, 0.0], greys, 1e6));
            let rise = k1 * (275.0f64 / 20.0).ln();
            assert_eq!(found.len(), 13);
            for (j, (t, polarity)) in found.into_iter().enumerate() {
                let wanted = 1e6 * (j + 1) as f64 / rise;
                assert!((t - wanted).abs() < 1e-12 * 1e6 && polarity == sign, "{t} {wanted}");
            }
            assert!((x - f64::from(sign) * (rise - 13.0)).abs() < 1e-13);
        }
    }

    #[test]
    fn with_leak_the_drift_at_event_j_is_level_j() {
        // Leak against signal: down first, then up again.
        let path = piece([10.0, 20.0, 0.0, 1e-7, 3e-2, 0.0], [255.0, 200.0], 3e6);
        let barriers = Barriers { up: 1.3, down: 0.7 };
        let (found, x) = events(barriers, &path);
        let mut count = [0.0, 0.0];
        let mut level = 0.0;
        assert!(found.len() > 5000);
        for &(t, polarity) in &found {
            count[usize::from(polarity > 0)] += 1.0;
            level = 1.3 * count[1] - 0.7 * count[0];
            // The drift reaches 20,000, where an ulp is 4e-12; its slope is 8e-3 per ns, an ulp of t 5e-10 ns.
            assert!((path.at(t) - level).abs() < 2e-11, "{t}: {} {level}", path.at(t));
        }
        assert!((path.end() - level - x).abs() < 1e-8 && x < 1.3 && x > -0.7);
    }

    #[test]
    fn a_turn_makes_events_of_both_kinds() {
        let path = piece([40.0, 20.0, 0.0, 0.0, 1e-2, 0.0], [255.0, 0.0], 1e5);
        let (found, _) = events(UNIT, &path);
        let ons = found.iter().take_while(|event| event.1 > 0).count();
        assert!(ons > 0 && ons < found.len(), "{found:?}");
        assert!(found[ons..].iter().all(|event| event.1 < 0) && found.is_sorted_by(|a, b| a.0 < b.0));
    }
}
