//! Events without noise, or with almost none: each has its exact time, for any number of events.

use crate::stress::answers::{KnownAnswer, find_answers};
use crate::stress::clips::{Train, by_pixel, make_clip, run_sensor};
use crate::stress::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use gs2e_event::Polarity;
use gs2e_image::Size;
use gs2e_sensor::voltmeter::VoltmeterModel;

/// A frame interval of 2400 a second, us.
const FRAME: i64 = 417;
const PIXEL: Size = Size { width: 1, height: 1 };
/// Limit of the error of an event time, ns. Times are whole nanoseconds, rounded down; half a
/// nanosecond is added before they are compared, so rounding explains half of the limit.
const LIMIT_NS: f64 = 1.0;

/// The cases, each without noise and with almost no noise: the two use different code. The last
/// number is the variance of the noise over a frame.
pub(super) fn burst_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |name, regime, run: fn(f64) -> CaseResult, variance| {
        StressCase::new(StressArea::Sensor, [name, regime, "ns"], move || run(variance))
    };
    vec![
        case("ramp", "sigma = 0: events divide a ramp evenly", ramp_case, 0.0),
        case("ramp-faint-noise", "s^2 T = 1e-300", ramp_case, 1e-300),
        case("burst", "mu T = +-1e5 in one frame, sigma = 0", burst_case, 0.0),
        case("burst-faint-noise", "mu T = +-1e5 in one frame, s^2 T = 1e-300", burst_case, 1e-300),
        case("flash", "0 -> 255 -> 0 in 2 us, sigma = 0", flash_case, 0.0),
        case("flash-faint-noise", "0 -> 255 -> 0 in 2 us, s^2 T = 1e-300", flash_case, 1e-300),
    ]
}

/// A sensor with this gain and leak per us, and with this variance of the noise over a frame.
fn burst_sensor([k1, k2]: [f64; 2], leak: f64, variance: f64) -> VoltmeterModel {
    let k = [k1, k2, 0.0, leak, 0.0, (variance / FRAME as f64).sqrt()];
    VoltmeterModel::new(k).without_cap()
}

/// The events of one pixel for these greys.
fn event_train(sensor: &VoltmeterModel, stamps_us: &[i64], greys: &[f64]) -> Train {
    let grey = |t: i64| greys[stamps_us.iter().position(|stamp| *stamp == t).unwrap_or(0)];
    let (events, _) = run_sensor(sensor, &make_clip(PIXEL, stamps_us, |_, _, t| grey(t)), 1);
    by_pixel(PIXEL, &events).swap_remove(0)
}

/// Compares a train with expected times in ns: the exact number, the polarities, and each time.
fn hold_train(worst: &mut WorstPoint, found: &Train, wanted: &[(f64, Polarity)], what: &str) {
    worst
        .see(StressPoint::exact_count(found.len() as u64, wanted.len() as u64), || format!("{what}: number"));
    let other = found.iter().zip(wanted).filter(|(found, wanted)| found.1 != wanted.1).count();
    worst.see(StressPoint::exact_count(other as u64, 0), || format!("{what}: polarity"));
    for (i, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        // The middle of the nanosecond, because times are rounded down.
        let point = StressPoint::absolute_error(found.0 as f64 + 0.5, wanted.0, LIMIT_NS);
        worst.see(point, || format!("{what}: event {i}"));
    }
}

/// From one grey to another within a frame, so that the drift is linear in time.
fn ramp_case(variance: f64) -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("step") {
        let [k1, k2, from, to] = [given[0], given[1], given[2], given[3]];
        let (rise, length) = (wanted[0], FRAME as f64 * 1e3);
        let found = event_train(&burst_sensor([k1, k2], 0.0, variance), &[0, FRAME], &[from, to]);
        let polarity = if rise > 0.0 { Polarity::On } else { Polarity::Off };
        let events = (1..).map(f64::from).take_while(|j| *j < rise.abs());
        let wanted: Vec<_> = events.map(|j| (length * j / rise.abs(), polarity)).collect();
        hold_train(&mut worst, &found, &wanted, &format!("{from:e} -> {to:e}"));
    }
    worst.found()
}

fn burst_case(variance: f64) -> CaseResult {
    const EVENTS: u32 = 100_000;
    let mut worst = WorstPoint::default();
    for (sign, polarity) in [(1.0, Polarity::On), (-1.0, Polarity::Off)] {
        // Half an event more, so that none falls on the end.
        let drift = f64::from(EVENTS) + 0.5;
        let sensor = burst_sensor([1.0, 1.0], sign * drift / FRAME as f64, variance);
        let found = event_train(&sensor, &[0, FRAME], &[77.0, 77.0]);
        let at = |j: u32| (FRAME as f64 * 1e3 * f64::from(j) / drift, polarity);
        let wanted: Vec<_> = (1..=EVENTS).map(at).collect();
        hold_train(&mut worst, &found, &wanted, polarity_name(polarity));
    }
    worst.found()
}

fn polarity_name(polarity: Polarity) -> &'static str {
    match polarity {
        Polarity::On => "ON",
        Polarity::Off => "OFF",
    }
}

/// Up and down again. OFF events have a threshold of .999, so that none falls on the end.
fn flash_case(variance: f64) -> CaseResult {
    const OFF: f64 = 0.999;
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("step") {
        let [k1, k2, from, to] = [given[0], given[1], given[2], given[3]];
        if from > 0.0 || to < 1.0 {
            continue;
        }
        let rise = wanted[0];
        let sensor = VoltmeterModel { threshold_off: OFF, ..burst_sensor([k1, k2], 0.0, variance) };
        let found = event_train(&sensor, &[0, 1, 2], &[0.0, to, 0.0]);
        let up = rise.floor();
        let ons = (1..).map(f64::from).take_while(|j| *j <= up).map(|j| (1e3 * j / rise, Polarity::On));
        // After the ON events, the voltage is D - up. The j-th OFF event is where D is up - j OFF.
        let offs = (1..).map(|j| up - f64::from(j) * OFF).take_while(|level| *level > 0.0);
        let offs = offs.filter(|level| *level < rise).map(|level| (2e3 - 1e3 * level / rise, Polarity::Off));
        let wanted: Vec<_> = ons.chain(offs).collect();
        hold_train(&mut worst, &found, &wanted, &format!("0 -> {to:e} -> 0"));
    }
    worst.found()
}

/// The drift of a step of brightness, measured by the time of its last event over 55 hours: a
/// nanosecond of that is 5e-15 of the step.
pub(super) fn steps_case() -> CaseResult {
    const END_US: i64 = 200_000_000_000;
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("step") {
        let [k1, k2, from, to] = [given[0], given[1], given[2], given[3]];
        let rise = wanted[0];
        // A step of less than 2.5 is divided into two and a half events; a larger one has
        // thresholds of 1.
        let threshold = (rise.abs() / 2.5).min(1.0);
        let sensor = VoltmeterModel {
            threshold_on: threshold,
            threshold_off: threshold,
            ..burst_sensor([k1, k2], 0.0, 0.0)
        };
        let found = event_train(&sensor, &[0, END_US], &[from, to]);
        // Without an event the size is NaN, which is beyond the limit.
        let last = found.last().map_or(f64::NAN, |event| event.0 as f64 + 0.5);
        // The drift is linear in time, so the last event measures the whole step.
        let size = found.len() as f64 * threshold * (END_US as f64 * 1e3 / last);
        worst.see(StressPoint::absolute_error(size, rise.abs(), 1e-12), || {
            format!("{from:e} -> {to:e}, k1 = {k1}")
        });
    }
    worst.found()
}
