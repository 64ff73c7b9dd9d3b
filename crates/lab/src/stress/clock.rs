//! Time: its origin, the range of intervals, the capacity of a microsecond; and invariance of
//! events under frame rate, threads and neighbouring pixels.

mod sameness;

use super::clips::{Train, by_pixel, make_clip, run_sensor};
use super::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use gs2e_event::file::shift_event;
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use gs2e_sensor::voltmeter::VoltmeterModel;

/// All cases of time.
#[must_use]
pub(crate) fn clock_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |words, run: fn() -> CaseResult| StressCase::new(StressArea::Clock, words, run);
    let mut all = vec![
        case(
            ["first-stamp", "16.8 s, 2^31 us, 1e15 us, negative: the events of 0", "events"],
            sameness::origins_case,
        ),
        case(["absolute-stamps", "the same in files: integers, to the microsecond", "events"], || {
            absolute_stamps(|first_us, ns| {
                let event =
                    Event { t: Timestamp(ns), x: 0, y: 0, polarity: Polarity::On, label: EventLabel::Signal };
                shift_event(event, first_us).map(|event| event.t.floor_micros())
            })
        }),
        case(
            ["frames-1-us-apart", "a ramp of 15 octaves in 15 us, with and without noise", "ns"],
            doubling_frames,
        ),
        case(["gap-of-an-hour", "frames 1 ms apart, an hour between two of them", "ns"], slow_leak),
        case(["events-in-1-us", "2e6 events of a pixel in a microsecond: count, order", "events"], fast_leak),
    ];
    all.extend(sameness::sameness_cases());
    all
}

/// First stamps of sequences, us.
const FIRST: [i64; 6] = [0, 16_800_000, 1 << 31, 1_000_000_000_000_000, -5, -3_000_000_000];

/// The stamp in a file, us, of an event at this time after the first stamp, ns.
#[must_use]
pub fn absolute_stamps(clock: impl Fn(i64, i64) -> Option<i64>) -> CaseResult {
    let mut worst = WorstPoint::default();
    for first_us in FIRST {
        let times: Vec<i64> = (0..2000).map(|i| i * 1_333 + i * i).collect();
        // 128 bits, so that the expected sum cannot overflow itself.
        let wanted = |ns: i64| i128::from(first_us) + i128::from(ns.div_euclid(1000));
        let right = |ns: &&i64| clock(first_us, **ns).map(i128::from) == Some(wanted(**ns));
        let differing = times.len() - times.iter().filter(right).count();
        worst.see_same(differing, times.len(), || format!("first stamp {first_us} us"));
    }
    worst.found()
}

const PIXEL: Size = Size { width: 1, height: 1 };
/// Limit of the error of an event time, ns: times are whole nanoseconds, rounded down.
const LIMIT_NS: f64 = 1.0;

/// A sensor with this gain over `ln(L + 16)` and this leak per us, without noise or with almost
/// none: the two use different code.
fn plain_sensors(gain: f64, leak: f64) -> [(&'static str, VoltmeterModel); 2] {
    [("no noise", 0.0), ("faint noise", 1e-150)].map(|(name, sigma)| {
        let k = [gain, 16.0, 0.0, leak, 0.0, sigma];
        (name, VoltmeterModel::new(k).without_cap())
    })
}

/// Compares the events of one pixel in a clip of this length with even times, `every_ns` apart.
fn hold_even(worst: &mut WorstPoint, events: &[Event], [length_ns, every_ns]: [f64; 2], what: &str) {
    let unsorted = events.windows(2).filter(|w| w[1].file_order() < w[0].file_order()).count();
    worst.see(StressPoint::exact_count(unsorted as u64, 0), || format!("{what}: out of order"));
    let number = StressPoint::absolute_error(events.len() as f64, (length_ns / every_ns).floor(), 0.0);
    worst.see(number, || format!("{what}: number"));
    let train: Train = by_pixel(PIXEL, events).swap_remove(0);
    for (i, (t, _)) in train.iter().enumerate() {
        // The middle of the nanosecond, because times are rounded down.
        let point = StressPoint::absolute_error(*t as f64 + 0.5, (i + 1) as f64 * every_ns, LIMIT_NS);
        worst.see(point, || format!("{what}: event {i}"));
    }
}

/// Each frame doubles `L + 16`, which 32 bits represent exactly.
fn doubling_frames() -> CaseResult {
    const OCTAVES: i64 = 15;
    const GAIN: f64 = 100.0;
    let stamps: Vec<i64> = (0..=OCTAVES).collect();
    let clip = make_clip(PIXEL, &stamps, |_, _, t| 16.0 * (1_i64 << t) as f64 - 16.0);
    let rise = GAIN * OCTAVES as f64 * std::f64::consts::LN_2;
    let mut worst = WorstPoint::default();
    for (name, sensor) in plain_sensors(GAIN, 0.0) {
        let (events, _) = run_sensor(&sensor, &clip, 1);
        let length = OCTAVES as f64 * 1e3;
        hold_even(&mut worst, &events, [length, length / rise], name);
    }
    worst.found()
}

/// A leak of one event in 1.001 s.
fn slow_leak() -> CaseResult {
    const HOUR: i64 = 3_600_000_000;
    const EVERY_US: f64 = 1_001_000.0;
    let stamps = [0, 1000, 2000, 2000 + HOUR, 3000 + HOUR];
    let clip = make_clip(PIXEL, &stamps, |_, _, _| 77.0);
    let mut worst = WorstPoint::default();
    for (name, sensor) in plain_sensors(1.0, 1.0 / EVERY_US) {
        let (events, _) = run_sensor(&sensor, &clip, 1);
        hold_even(&mut worst, &events, [(3000 + HOUR) as f64 * 1e3, EVERY_US * 1e3], name);
    }
    worst.found()
}

/// A leak of two million events per us, between two frames that are 1 us apart.
fn fast_leak() -> CaseResult {
    const EVENTS: u64 = 2_000_000;
    let mut worst = WorstPoint::default();
    let clip = make_clip(PIXEL, &[0, 1], |_, _, _| 77.0);
    // Half an event more, so that none falls on the end.
    for (name, sensor) in plain_sensors(1.0, EVENTS as f64 + 0.5) {
        let (events, account) = run_sensor(&sensor, &clip, 1);
        let unsorted = events.windows(2).filter(|w| w[1].file_order() < w[0].file_order()).count();
        worst.see(StressPoint::exact_count(unsorted as u64, 0), || format!("{name}: out of order"));
        let outside = events.iter().filter(|e| !(0..=1000).contains(&e.t.0)).count();
        worst.see(StressPoint::exact_count(outside as u64, 0), || {
            format!("{name}: outside of the microsecond")
        });
        worst.see(StressPoint::exact_count(events.len() as u64, EVENTS), || format!("{name}: number"));
        worst.see(StressPoint::exact_count(account.on, EVENTS), || format!("{name}: ON by the account"));
    }
    worst.found()
}
