//! Brightness that is a cubic between frames: the signals that it reproduces, its order of
//! convergence, and its delay.

use super::{by_pixel, frames, run};
use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::SensorModel as _;
use gs2e_sensor::SensorSettings;
use gs2e_sensor::frames::FrameSequence as _;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::voltmeter::{BetweenFrames, DriftGain, VoltmeterModel};

const SIZE: Size = Size { width: 8, height: 3 };
const K2: f64 = 16.0;

/// Frames of `L + K2 = e^V`, with rates, from `V` and its slope per second as functions of pixel
/// and seconds.
fn of_signal(stamps_us: &[i64], signal: impl Fn(usize, f64) -> [f64; 2]) -> ArrayFrames {
    let each = |value: fn([f64; 2]) -> f64| -> Vec<f32> {
        let all =
            stamps_us.iter().flat_map(|t| (0..SIZE.pixels()).map(move |pixel| (pixel, *t as f64 * 1e-6)));
        all.map(|(pixel, t)| value(signal(pixel, t)) as f32).collect()
    };
    let samples = ArraySamples::Floats(each(|[log, _]| libm::exp(log) - K2), FullScale::Grey255);
    let rates = each(|[log, slope]| libm::exp(log) * slope);
    ArrayFrames::new(SIZE, samples, stamps_us).unwrap().with_rates(rates).unwrap()
}

fn sensor(between: BetweenFrames, noise: f64) -> VoltmeterModel {
    let k = [50.0, K2, noise, 1e-4, 0.0, 0.2 * noise];
    VoltmeterModel {
        between,
        settings: SensorSettings { max_events_per_pixel_frame: 100_000, ..SensorSettings::default() },
        ..VoltmeterModel::new(k)
    }
}

/// Number of events that differ in number or polarity, and the largest difference in time of the
/// others, ns.
fn difference(a: &[Event], b: &[Event]) -> (usize, i64) {
    let (mut differ, mut worst) = (0, 0);
    for (a, b) in by_pixel(SIZE, a).into_iter().zip(by_pixel(SIZE, b)) {
        differ += a.len().abs_diff(b.len());
        for (a, b) in a.into_iter().zip(b) {
            differ += usize::from(a.1 != b.1);
            worst = worst.max((a.0 - b.0).abs());
        }
    }
    (differ, worst)
}

#[test]
fn a_signal_cubic_in_the_logarithm_can_be_sampled_finer() {
    const END: i64 = 2000;
    // The signal rises throughout, by 2.2 to 2.7 in 2 ms.
    let signal = |pixel: usize, t: f64| {
        let (s, a) = (t / (END as f64 * 1e-6), 0.02 * pixel as f64);
        let log = 2.9 + 1.1 * s + (0.6 + a) * s * s + 0.5 * s * s * s;
        [log, (1.1 + 2.0 * (0.6 + a) * s + 1.5 * s * s) / (END as f64 * 1e-6)]
    };
    let at = |between, noise, stamps: &[i64]| run(&sensor(between, noise), &of_signal(stamps, signal), 3).0;
    let cuts = [0, 100, 417, 833, 840, 1250, 1999, END];
    // A frame rounds L + K2 by 6e-8 of its value, and so V. V rises by at least 5e-7 per ns, so
    // events move by 0.1 ns, which may cross a boundary. With noise they move within their leaves,
    // 8192 ns long with noise of 0.02 thresholds, by the time for 3e-6 thresholds (50 times 6e-8):
    // 1.2 ns, and some ten times that where a path barely touches.
    for (noise, tolerance) in [(0.0, 1), (2e-2, 100)] {
        let coarse = at(BetweenFrames::Hermite, noise, &[0, END]);
        assert!(coarse.len() > 2000, "{}", coarse.len());
        let (differ, worst) = difference(&coarse, &at(BetweenFrames::Hermite, noise, &cuts));
        println!("noise {noise}: {} events, {differ} differ, {worst} ns", coarse.len());
        assert!(differ == 0 && worst <= tolerance, "{differ} {worst}");
    }
    let lines = [&[0, END][..], &cuts].map(|stamps| at(BetweenFrames::Linear, 0.0, stamps));
    let (_, worst) = difference(&lines[0], &lines[1]);
    assert!(worst > 1000, "lines reproduce no cubic: {worst}");
}

/// Median error of event times in ns. The true time of event j is where the drift is j.
fn median_error(between: BetweenFrames, intervals: i64) -> f64 {
    const END: f64 = 0.02;
    let log = |s: f64| 4.0 + s + 0.12 * libm::sin(6.0 * s);
    let signal = |_: usize, t: f64| {
        let s = t / END;
        [log(s), (1.0 + 0.72 * libm::cos(6.0 * s)) / END]
    };
    let stamps: Vec<i64> =
        (0..=intervals).map(|i| (i as f64 * END * 1e6 / intervals as f64).round() as i64).collect();
    let sensor = VoltmeterModel {
        between,
        settings: SensorSettings { max_events_per_pixel_frame: 1000, ..SensorSettings::default() },
        ..VoltmeterModel::new([300.0, K2, 0.0, 0.0, 0.0, 0.0])
    };
    let (events, _) = run(&sensor, &of_signal(&stamps, signal), 1);
    let wanted = |level: f64| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if 300.0 * (log(middle) - log(0.0)) < level { low = middle } else { high = middle }
        }
        low * END * 1e9
    };
    let error = |(j, event): (usize, &(i64, Polarity))| (event.0 as f64 + 0.5 - wanted((j + 1) as f64)).abs();
    let mut errors: Vec<f64> = by_pixel(SIZE, &events)[0].iter().enumerate().map(error).collect();
    assert!(errors.len() > 280, "{}", errors.len());
    errors.sort_unstable_by(f64::total_cmp);
    errors[errors.len() / 2]
}

#[test]
fn events_converge_with_the_order_of_the_curve() {
    // Lines have order 2. Cubics with slopes from neighbours, which are of order 2, have 3. Cubics
    // with true slopes have 4.
    for (between, intervals, order) in [
        (BetweenFrames::Linear, 20, 2.0),
        (BetweenFrames::Catmull, 20, 3.0),
        (BetweenFrames::Hermite, 8, 4.0),
    ] {
        let errors = [1, 2].map(|finer| median_error(between, intervals * finer));
        let found = libm::log2(errors[0] / errors[1]);
        println!("{between:?}: {errors:.0?} ns, order {found:.2}");
        assert!((found - order).abs() < 0.6, "{between:?}: order {found}");
    }
    let [linear, catmull, hermite] =
        [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite].map(|b| median_error(b, 16));
    assert!(linear > 3.0 * catmull && catmull > 3.0 * hermite, "{linear} {catmull} {hermite}");
}

/// A clip that jumps, with black, bright and static parts, and rates that need not fit.
fn jumpy() -> ArrayFrames {
    let stamps: Vec<i64> = (0..30).map(|i| i * 417 + i % 3).collect();
    let clip = frames(SIZE, &stamps, |x, y, t| match x {
        0 => f64::from(y),
        1 => {
            if t / 417 % 2 == 0 {
                0.0
            } else {
                255.0
            }
        }
        _ => 120.0 + 119.0 * libm::sin(f64::from(x) + t as f64 * 1e-3),
    });
    let rate = |i: usize| if i.is_multiple_of(5) { 3e5 } else { -2e4 };
    clip.with_rates((0..SIZE.pixels() * stamps.len()).map(rate).collect()).unwrap()
}

#[test]
fn jumps_keep_the_drift_balance() {
    for (between, noise) in [
        (BetweenFrames::Catmull, 0.0),
        (BetweenFrames::Catmull, 2e-2),
        (BetweenFrames::Hermite, 0.0),
        (BetweenFrames::Hermite, 2e-2),
    ] {
        let (events, account) = run(&sensor(between, noise), &jumpy(), 2);
        println!("{between:?}, noise {noise}: {account:?}");
        assert!(events.is_sorted_by_key(Event::file_order) && events.len() > 1000);
        assert_eq!((account.drift_violations, account.events), (0, events.len() as u64));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(pool.install(|| run(&sensor(between, noise), &jumpy(), 2)), (events, account));
    }
}

#[test]
fn a_slope_from_neighbours_waits_for_the_frame_after() {
    for (between, waits) in
        [(BetweenFrames::Linear, 0), (BetweenFrames::Hermite, 0), (BetweenFrames::Catmull, 1)]
    {
        let (mut clip, sensor) = (jumpy(), sensor(between, 0.0));
        let whole = run(&sensor, &clip, 4).0;
        let mut pixels = sensor.start(SIZE, [0, 0], Seed(4)).unwrap();
        let (mut events, mut stamps): (Vec<Event>, Vec<i64>) = (Vec::new(), Vec::new());
        while let Some(frame) = clip.next().unwrap() {
            pixels.advance(&frame, &mut events).unwrap();
            stamps.push(frame.t.0);
            assert_eq!(events[..], whole[..events.len()]);
            let known = stamps[(stamps.len() - 1).saturating_sub(waits)];
            let certain = whole.iter().filter(|event| event.t.0 / 1000 < known / 1000).count();
            assert_eq!(events.len(), certain, "{between:?} at {} ns", frame.t.0);
        }
    }
}

#[test]
fn unusable_input_for_a_cubic_is_refused() {
    let bare = frames(SIZE, &[0, 417], |_, _, _| 9.0);
    let refused = |sensor: &VoltmeterModel, mut clip: ArrayFrames| {
        let frame = clip.next().unwrap().unwrap();
        let started = sensor.start(SIZE, [0, 0], Seed(4));
        started.and_then(|mut pixels| pixels.advance(&frame, &mut Vec::new())).unwrap_err().to_string()
    };
    let hermite = sensor(BetweenFrames::Hermite, 0.0);
    assert_eq!(
        refused(&hermite, bare.clone()),
        "frame 0: it has no rate of change, which `between: hermite` needs"
    );
    let midpoint = VoltmeterModel { gain: DriftGain::Midpoint, ..sensor(BetweenFrames::Catmull, 0.0) };
    assert_eq!(refused(&midpoint, bare), "`gain: midpoint` requires `between: linear`");
}
