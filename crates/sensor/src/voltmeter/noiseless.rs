//! The law without noise: an event happens where the drift crosses a level. No random number is
//! drawn.

use super::bridge::{BarrierSide, Barriers, WideBarriers};
use super::curve::{DriftCurve, One};
use super::leaf::EmitEvents;
use super::window::TimeStep;
use fearless_simd::{Select as _, Simd, SimdBase as _, f64x8};
use gs2e_event::Polarity;
use std::marker::PhantomData;
use std::ops::ControlFlow;

/// Moves a pixel of voltage `x` across the window along its curve of each leg, and returns the
/// voltage at the end.
#[inline(always)]
pub(super) fn cross_window<C: DriftCurve>(
    window: &TimeStep<'_>,
    barriers: Barriers,
    mut x: f64,
    curves: impl Iterator<Item = One>,
    emit: &mut impl EmitEvents,
) -> ControlFlow<(), f64> {
    for (leg, curve) in window.legs.iter().zip(curves) {
        let span = [leg.from - leg.stamp, leg.to - leg.stamp];
        let run = DriftRun::<C> { curve: &curve, stamp: leg.stamp, family: PhantomData };
        x = run.cross(barriers, x, span, emit)?;
    }
    ControlFlow::Continue(x)
}

/// Eight pixels with drift proportional to time.
#[derive(Debug)]
pub(super) struct StraightDrift<S: Simd> {
    /// Drift over the window.
    rise: f64x8<S>,
    /// Drift up to the first event, and drift between events.
    first: f64x8<S>,
    step: f64x8<S>,
    /// Time per drift, ns.
    pace: f64x8<S>,
    /// Length of the window, ns.
    length: f64,
}

impl<S: Simd> StraightDrift<S> {
    /// Pixels that start at the voltages `x` and drift by `rise` over `length` ns.
    #[inline(always)]
    pub(super) fn new(barriers: WideBarriers<S>, [x, rise]: [f64x8<S>; 2], length: f64) -> Self {
        // A pixel without drift keeps a distance from both barriers, so the choice for 0 does not
        // matter.
        let step = rise.simd_ge(0.0).select(barriers.up, -barriers.down);
        Self { rise, first: step - x, step, pace: f64x8::splat(x.simd, length) / rise, length }
    }

    /// Emits the events of one pixel, and returns the voltage that they subtract.
    #[inline(always)]
    pub(super) fn cross(&self, lane: usize, emit: &mut impl EmitEvents) -> ControlFlow<(), f64> {
        let Self { rise, first, step, pace, length } = self;
        let [rise, first, step, pace] = [rise, first, step, pace].map(|eight| eight[lane]);
        let polarity = if rise >= 0.0 { Polarity::On } else { Polarity::Off };
        let mut crossed = 0.0;
        loop {
            // From the count. Adding thresholds one by one would add up their rounding.
            let target = first + crossed * step;
            // A voltage that ends exactly at the barrier has reached it.
            if target.abs() > rise.abs() {
                return ControlFlow::Continue(crossed * step);
            }
            // Rounding may put the last event after the window.
            emit.event((target * pace).clamp(0.0, *length), polarity)?;
            crossed += 1.0;
        }
    }
}

/// The drift of a pixel along a leg.
struct DriftRun<'a, C> {
    curve: &'a One,
    /// Start of the curve, ns since the window's start.
    stamp: f64,
    family: PhantomData<C>,
}

impl<C: DriftCurve> DriftRun<'_, C> {
    /// The voltage at the end of a span of the curve, from `x` at its start.
    fn cross(
        &self,
        barriers: Barriers,
        mut x: f64,
        span: [f64; 2],
        emit: &mut impl EmitEvents,
    ) -> ControlFlow<(), f64> {
        let [mut from, end] = span;
        for to in C::turns_of_one(self.curve, span).into_iter().flatten().chain([end]) {
            x = self.cross_one_way(barriers, x, [from, to], emit)?;
            from = to;
        }
        ControlFlow::Continue(x)
    }

    /// [`DriftRun::cross`] for a span in which the drift is monotonic.
    fn cross_one_way(
        &self,
        barriers: Barriers,
        x: f64,
        [start, to]: [f64; 2],
        emit: &mut impl EmitEvents,
    ) -> ControlFlow<(), f64> {
        let base = C::rise_of_one(self.curve, start);
        let rise = C::rise_of_one(self.curve, to) - base;
        let (side, polarity) =
            if rise >= 0.0 { (BarrierSide::Up, Polarity::On) } else { (BarrierSide::Down, Polarity::Off) };
        let (first, step) = (side.step(barriers) - x, side.step(barriers));
        // Infinite without a rise, but then no target is reached and it is not used.
        let pace = (to - start) / rise;
        let mut crossed = 0.0;
        let mut from = start;
        loop {
            let target = first + crossed * step;
            if target.abs() > rise.abs() {
                return ControlFlow::Continue(x + rise - crossed * step);
            }
            let guess = start + target * pace;
            // Levels follow in order of time, so the search begins at the previous event.
            from = solve_monotonic::<C>(self.curve, base + target, guess, [from, to], rise >= 0.0);
            // Times of the curve count from its frame, times of events from the window's start.
            emit.event(self.stamp + from, polarity)?;
            crossed += 1.0;
        }
    }
}

/// The time in `[low, high]` at which a monotonic drift reaches `level`: Newton's method from `t`,
/// kept inside a bracket, to the last bit.
fn solve_monotonic<C: DriftCurve>(
    curve: &One,
    level: f64,
    t: f64,
    [mut low, mut high]: [f64; 2],
    rising: bool,
) -> f64 {
    let mut t = t.clamp(low, high);
    if C::is_straight(curve) {
        return t;
    }
    // Each round halves the bracket or is a Newton step. Bisection alone needs fewer than 200.
    for _ in 0..200 {
        let error = C::rise_of_one(curve, t) - level;
        if error == 0.0 {
            return t;
        }
        if (error > 0.0) == rising {
            high = t;
        } else {
            low = t;
        }
        let newton = t - error / C::rate_of_one(curve, t);
        // Where the drift turns, its rate is 0. The step is then infinite or NaN, and the bracket
        // is halved.
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
    use super::super::curve::of_one;
    use super::super::drift::DriftProcess;
    use super::super::line::LineDrift;
    use super::super::{VoltmeterModel, VoltmeterPreset};
    use super::*;

    const UNIT: Barriers = Barriers { up: 1.0, down: 1.0 };

    impl EmitEvents for Vec<(f64, i32)> {
        fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
            self.push((t, if polarity == Polarity::On { 1 } else { -1 }));
            ControlFlow::Continue(())
        }
    }

    /// One piece between two greys.
    fn piece(k: [f64; 6], greys: [f64; 2], length: f64) -> One {
        let process = DriftProcess::new(&VoltmeterModel::new(k));
        of_one::<LineDrift>(&process, greys.map(|l| [l + process.k2, 0.0]), length)
    }

    fn events(barriers: Barriers, curve: &One, length: f64) -> (Vec<(f64, i32)>, f64) {
        let mut events = Vec::new();
        let run = DriftRun::<LineDrift> { curve, stamp: 0.0, family: PhantomData };
        match run.cross(barriers, 0.0, [0.0, length], &mut events) {
            ControlFlow::Continue(x) => (events, x),
            ControlFlow::Break(()) => unreachable!("the sink never breaks"),
        }
    }

    #[test]
    fn without_leak_events_divide_the_signal_evenly() {
        // k1 V is linear in time, so event j happens where it has risen by j.
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        for (greys, sign) in [([0.0, 255.0], 1), ([255.0, 0.0], -1)] {
            let (found, x) = events(UNIT, &piece([k1, k2, 0.0, 0.0, 0.0, 0.0], greys, 1e6), 1e6);
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
        // The leak works against the signal: the drift goes down first, then up again.
        let curve = piece([10.0, 20.0, 0.0, 1e-7, 3e-2, 0.0], [255.0, 200.0], 3e6);
        let barriers = Barriers { up: 1.3, down: 0.7 };
        let (found, x) = events(barriers, &curve, 3e6);
        let mut count = [0.0, 0.0];
        let mut level = 0.0;
        assert!(found.len() > 5000);
        for &(t, polarity) in &found {
            count[usize::from(polarity > 0)] += 1.0;
            level = 1.3 * count[1] - 0.7 * count[0];
            // The drift reaches 20,000, where an ulp is 4e-12; its slope is 8e-3 per ns, an ulp of
            // t 5e-10 ns.
            let drift = LineDrift::rise_of_one(&curve, t);
            assert!((drift - level).abs() < 2e-11, "{t}: {drift} {level}");
        }
        assert!((LineDrift::rise_of_one(&curve, 3e6) - level - x).abs() < 1e-8 && x < 1.3 && x > -0.7);
    }

    #[test]
    fn a_turn_makes_events_of_both_kinds() {
        let curve = piece([40.0, 20.0, 0.0, 0.0, 1e-2, 0.0], [255.0, 0.0], 1e5);
        let (found, _) = events(UNIT, &curve, 1e5);
        let ons = found.iter().take_while(|event| event.1 > 0).count();
        assert!(ons > 0 && ons < found.len(), "{found:?}");
        assert!(found[ons..].iter().all(|event| event.1 < 0) && found.is_sorted_by(|a, b| a.0 < b.0));
    }
}
