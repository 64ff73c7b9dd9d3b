//! The bandwidth of the pixels: events compared with closed answers of the filter, and with a fine Euler
//! grid extrapolated to steps of 0.
//!
//! Without noise, the output of the filter at an event is known: it has moved by the events so far. The
//! difference from the right output, in thresholds, is the error of a stream.

use super::{by_pixel, frames, run};
use gs2e_event::Polarity;
use gs2e_image::Size;
use gs2e_sensor::SensorSettings;
use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel};
use gs2e_testing::absent::runs_slow_tests;
use std::f64::consts::TAU;

const SIZE: Size = Size { width: 1, height: 1 };
const K1: f64 = 50.0;
const K2: f64 = 16.0;
/// Rounding of `V` to 32 bits at an end of a piece, in thresholds: half an ulp of `L`, at most that of `L +
/// k2`.
const ROUNDED: f64 = K1 * 6e-8;
/// Error of a cubic for `e^-x` over a quarter of a time constant, and of `x e^-x` over its share.
const CUT: [f64; 2] = [1.02e-5, 1.0e-5];

/// A sensor without noise. White is 255 lux, so that a grey is a lux.
fn sensor(order: u32, points: &[[f64; 2]], between: BetweenFrames) -> VoltmeterModel {
    let point = |&[lux, cutoff_hz]: &[f64; 2]| BandwidthPoint { lux, cutoff_hz };
    let front_end = FrontEnd { lux: Some(255.0), ..FrontEnd::default() };
    VoltmeterModel {
        between,
        bandwidth: PixelBandwidth { order, points: points.iter().map(point).collect() },
        settings: SensorSettings {
            front_end,
            max_events_per_pixel_frame: 100_000,
            ..SensorSettings::default()
        },
        ..VoltmeterModel::new([K1, K2, 0.0, 0.0, 0.0, 0.0])
    }
}

/// Times in seconds and signs of the events of the only pixel.
fn events(sensor: &VoltmeterModel, clip: &ArrayFrames) -> Vec<(f64, f64)> {
    let (events, account) = run(sensor, clip, 1);
    assert_eq!((account.drift_violations, account.events), (0, events.len() as u64));
    let signed = |(t, polarity)| (t as f64 * 1e-9, if polarity == Polarity::On { 1.0 } else { -1.0 });
    by_pixel(SIZE, &events).remove(0).into_iter().map(signed).collect()
}

/// The largest error of a stream in thresholds, where the output of the filter is `y`. Checks that no event
/// is missing at `end`.
fn worst_error(events: &[(f64, f64)], end: f64, y: impl Fn(f64) -> f64) -> f64 {
    let mut level = 0.0;
    let mut worst = 0.0f64;
    for (t, sign) in events {
        level += sign;
        worst = worst.max((K1 * (y(*t) - y(0.0)) - level).abs());
    }
    let rest = K1 * (y(end) - y(0.0)) - level;
    assert!(rest.abs() < 1.0 + worst, "{rest} thresholds are left");
    worst
}

/// The grey where `ln(L + k2)` is `log`.
fn grey(log: f64) -> f64 {
    libm::exp(log) - K2
}

#[test]
fn a_step_is_answered_as_by_its_closed_form() {
    // A step within 1 us, in which no threshold is reached, and then a second without frames.
    const STEP: f64 = 1e-6;
    let [from, to] = [20.0, 200.0];
    let height = libm::log((to + K2) / (from + K2));
    for cutoff_hz in [5.0, 20.0, 200.0, 1000.0] {
        let lambda = TAU * cutoff_hz;
        for order in [1, 2] {
            let clip = frames(SIZE, &[0, 1, 1_000_000], |_, _, t| if t == 0 { from } else { to });
            let found = events(&sensor(order, &[[1.0, cutoff_hz]], BetweenFrames::Linear), &clip);
            // The answer to a ramp is the mean of those to its steps: to `(lambda STEP)^2 / 24` of the height
            // that of a step in its middle.
            let y = |t: f64| {
                let x = lambda * (t - 0.5 * STEP).max(0.0);
                let left = if order == 1 { 1.0 } else { 1.0 + x };
                height * (1.0 - left * libm::exp(-x))
            };
            let worst = worst_error(&found, 1.0, y);
            // Times are rounded down to ns.
            let of_ramp = (lambda * STEP).powi(2) / 24.0 * height;
            let bound = K1 * (height * CUT[order as usize - 1] + of_ramp + height * lambda * 1e-9) + ROUNDED;
            println!("{cutoff_hz} Hz, order {order}: {} events, {worst:.2e} of {bound:.2e}", found.len());
            assert!(worst < bound && found.iter().all(|(_, sign)| *sign > 0.0));
            // The same in time: `t = -ln(1 - j/(k1 dV)) / lambda`.
            for (j, (t, _)) in found.iter().enumerate().filter(|_| order == 1) {
                let left = 1.0 - (j + 1) as f64 / (K1 * height);
                let wanted = 0.5 * STEP - libm::log(left) / lambda;
                assert!((t - wanted).abs() < bound / (K1 * height * left * lambda), "{j}: {t} {wanted}");
            }
        }
    }
}

#[test]
fn a_ramp_is_late_by_a_time_constant_a_stage() {
    // `V` rises by 2 in a second, in a straight line between two frames.
    let (slope, from) = (2.0, libm::log(20.0 + K2));
    let clip = frames(SIZE, &[0, 1_000_000], |_, _, t| grey(from + slope * 1e-6 * t as f64));
    for cutoff_hz in [20.0, 50.0, 1000.0] {
        let lambda = TAU * cutoff_hz;
        for order in [1u32, 2] {
            let found = events(&sensor(order, &[[1.0, cutoff_hz]], BetweenFrames::Linear), &clip);
            let lag = slope / lambda;
            let y = |t: f64| {
                let left = libm::exp(-lambda * t);
                slope * t
                    + if order == 1 {
                        lag * (left - 1.0)
                    } else {
                        lag * (2.0 * (left - 1.0) + lambda * t * left)
                    }
            };
            let worst = worst_error(&found, 1.0, y);
            let bound = K1 * (2.0 * lag * CUT[order as usize - 1] + slope * 1e-9) + 3.0 * ROUNDED;
            let settled = |t: f64| lambda * t > 40.0;
            let late = found
                .iter()
                .enumerate()
                .filter(|(_, (t, _))| settled(*t))
                .map(|(j, (t, _))| (t - (j + 1) as f64 / (K1 * slope) - f64::from(order) / lambda).abs());
            let late = late.fold(0.0, f64::max);
            println!("{cutoff_hz} Hz, order {order}: {worst:.2e} of {bound:.2e}, {:.1} ns", 1e9 * late);
            // A quarter of the clip at least is behind the transient.
            assert!(worst < bound && late < 1e-9 + 3.0 * ROUNDED / (K1 * slope), "{late}");
            assert!(found.iter().filter(|(t, _)| settled(*t)).count() > 25);
        }
    }
}

/// A signal and its slope per second.
type Signal<'a> = &'a dyn Fn(f64) -> [f64; 2];

/// Frames of `e^V - k2` at a rate, with rates of change, over `end` seconds.
fn rendered(signal: Signal<'_>, rate: f64, end: f64) -> ArrayFrames {
    let count = (rate * end).round() as u32;
    let stamps: Vec<i64> = (0..=count).map(|i| (f64::from(i) / rate * 1e6).round() as i64).collect();
    let each = |value: &dyn Fn([f64; 2]) -> f64| -> Vec<f32> {
        stamps.iter().map(|t| value(signal(*t as f64 * 1e-6)) as f32).collect()
    };
    let samples = ArraySamples::Floats(each(&|[log, _]| grey(log)), FullScale::Grey255);
    let rates = each(&|[log, slope]| libm::exp(log) * slope);
    ArrayFrames::new(SIZE, samples, &stamps).unwrap().with_rates(rates).unwrap()
}

/// A sine about `centre` with this height and frequency.
fn sine(centre: f64, height: f64, hz: f64) -> impl Fn(f64) -> [f64; 2] {
    let omega = TAU * hz;
    move |t| [centre + height * libm::sin(omega * t), height * omega * libm::cos(omega * t)]
}

#[test]
fn a_sine_is_smaller_and_later() {
    let (hz, height) = (30.0, 0.6);
    let signal = sine(4.0, height, hz);
    let clip = rendered(&signal, 1000.0, 0.2);
    for cutoff_hz in [10.0, 30.0, 100.0, 1000.0] {
        let found = events(&sensor(1, &[[1.0, cutoff_hz]], BetweenFrames::Hermite), &clip);
        let (lambda, phase) = (TAU * cutoff_hz, libm::atan2(hz, cutoff_hz));
        let smaller = height * libm::cos(phase);
        let y = |t: f64| {
            let left = libm::sin(phase) * libm::exp(-lambda * t);
            smaller * (libm::sin(TAU * hz * t - phase) + left)
        };
        let worst = worst_error(&found, 0.2, y);
        // Frames give a cubic: `(omega h)^4 / 384` of the height. The transient is cut into pieces, and so is
        // what the cubics leave of smoothness: no more than that again.
        let of_cubic = (TAU * hz * 1e-3).powi(4) / 384.0;
        let bound = K1 * height * (2.0 * of_cubic + CUT[0] + TAU * hz * 1e-9) + ROUNDED;
        println!("{cutoff_hz} Hz: {} events, {worst:.2e} of {bound:.2e}", found.len());
        assert!(worst < bound);
    }
}

/// `2 pi cutoff` where `ln(L + k2)` is `log`, by the points.
fn lambda_at(points: &[[f64; 2]], log: f64) -> f64 {
    let lux = grey(log);
    let at = points.iter().position(|[light, _]| lux < *light).unwrap_or(points.len());
    let cutoff = match at {
        0 => points[0][1],
        at if at == points.len() => points[at - 1][1],
        at => {
            let ([x0, y0], [x1, y1]) = (points[at - 1], points[at]);
            y0 * libm::pow(y1 / y0, libm::log(lux / x0) / libm::log(x1 / x0))
        }
    };
    TAU * cutoff
}

/// Values of the filter's output on an even grid over `end` seconds: Euler steps, two to eight per point,
/// extrapolated to steps of 0.
fn euler(signal: Signal<'_>, points: &[[f64; 2]], order: u32, end: f64) -> impl Fn(f64) -> f64 {
    const GRID: usize = 40_000;
    let with = |parts: usize| -> Vec<f64> {
        let h = end / (GRID * parts) as f64;
        let [log, _] = signal(0.0);
        let (mut y, mut z) = (log, log);
        let mut out = vec![log];
        for i in 0..GRID * parts {
            let [log, _] = signal(i as f64 * h);
            let step = h * lambda_at(points, log);
            (y, z) = (y + step * (log - y), z + step * (y - z));
            if (i + 1) % parts == 0 {
                out.push(if order == 1 { y } else { z });
            }
        }
        out
    };
    let [coarse, middle, fine] = [2, 4, 8].map(with);
    // The errors of the orders 1 and 2 in the step cancel.
    let best: Vec<f64> = (0..=GRID).map(|i| (coarse[i] - 6.0 * middle[i] + 8.0 * fine[i]) / 3.0).collect();
    move |t| {
        let place = t / end * GRID as f64;
        let i = (place as usize).min(GRID - 1);
        let share = place - i as f64;
        best[i] + (best[i + 1] - best[i]) * share
    }
}

/// Cutoffs as in docs/sensors.md.
const POINTS: [[f64; 2]; 2] = [[1.0, 20.0], [100.0, 200.0]];

#[test]
fn light_moves_the_cutoff() {
    // Greys 3 to 90 within the points, and 0.1 to 250 across both of them.
    for (centre, height, hz) in [(3.8, 0.85, 40.0), (4.18, 1.4, 15.0)] {
        let signal = sine(centre, height, hz);
        for order in [1, 2] {
            let wanted = euler(&signal, &POINTS, order, 0.1);
            for rate in [500.0, 1000.0, 4000.0] {
                let clip = rendered(&signal, rate, 0.1);
                let found = events(&sensor(order, &POINTS, BetweenFrames::Hermite), &clip);
                let worst = worst_error(&found, 0.1, &wanted);
                // The cubic between frames, twice as above; of a share of it only the filter lets pass.
                let of_cubic = (TAU * hz / rate).powi(4) / 384.0;
                let bound = K1 * height * (2.0 * of_cubic + 3.0 * CUT[0] + TAU * hz * 1e-9) + ROUNDED;
                println!(
                    "{hz} Hz, order {order}, {rate}/s: {} events, {worst:.2e} of {bound:.2e}",
                    found.len()
                );
                assert!(found.len() > 60 && worst < bound, "{worst} of {bound}");
            }
        }
    }
}

#[test]
fn a_fast_filter_only_delays() {
    let signal = sine(4.0, 0.6, 30.0);
    let clip = rendered(&signal, 1000.0, 0.095);
    let plain =
        VoltmeterModel { bandwidth: PixelBandwidth::default(), ..sensor(1, &[], BetweenFrames::Hermite) };
    let without = events(&plain, &clip);
    for order in [1, 2] {
        let with = events(&sensor(order, &[[1.0, 1e6]], BetweenFrames::Hermite), &clip);
        assert_eq!(without.len(), with.len());
        let delay = f64::from(order) / (TAU * 1e6);
        let mut worst = 0.0f64;
        for (a, b) in without.iter().zip(&with) {
            assert!((a.1 - b.1).abs() < 0.1);
            // Where the signal is flat, a rounding of 32 bits moves an event far, so errors count in
            // thresholds.
            let slope = K1 * signal(a.0)[1].abs();
            worst = worst.max((b.0 - a.0 - delay).abs() * slope);
        }
        // Two roundings to ns, two of V, and the curvature of the signal over the delay.
        let curvature = K1 * 0.6 * (TAU * 30.0).powi(2) * delay * delay;
        let bound = 2e-9 * K1 * 0.6 * TAU * 30.0 + 3.0 * ROUNDED + curvature;
        println!("order {order}: {} events, {worst:.2e} of {bound:.2e}", with.len());
        assert!(worst < bound);
    }
}

#[test]
fn light_that_stays_passes_unchanged() {
    let size = Size { width: 24, height: 10 };
    let greys = |x: u32, y: u32, _| f64::from(x * 10 + y);
    let stamps: Vec<i64> = (0..30).map(|i| i * 9_973).collect();
    let rates = vec![0.0; size.pixels() * stamps.len()];
    let clip = frames(size, &stamps, greys).with_rates(rates).unwrap();
    for order in [1, 2] {
        let noisy = VoltmeterModel {
            k: [5.0, 16.0, 2e-2, 1e-5, 1e-7, 4e-3],
            ..sensor(order, &POINTS, BetweenFrames::Hermite)
        };
        let plain = VoltmeterModel { bandwidth: PixelBandwidth::default(), ..noisy.clone() };
        let [with, without] = [noisy, plain].map(|sensor| run(&sensor, &clip, 5).0);
        assert!(with.len() > 1000 && with == without, "{}", with.len());
    }
}

#[test]
fn interpolations_of_an_exponential_agree() {
    // `V` rises in a straight line, so its slope at every frame is known to all three.
    let signal = |t: f64| [3.0 + 20.0 * t, 20.0];
    let clip = rendered(&signal, 500.0, 0.1);
    for order in [1, 2] {
        let of = |between| events(&sensor(order, &POINTS, between), &clip);
        let linear = of(BetweenFrames::Linear);
        assert!(linear.len() > 60);
        for between in [BetweenFrames::Catmull, BetweenFrames::Hermite] {
            let other = of(between);
            assert_eq!(linear.len(), other.len());
            // Slopes from frames of 32 bits: ten roundings of V move an event by 1e-7 / 20 s.
            let apart = linear.iter().zip(&other).map(|(a, b)| (a.0 - b.0).abs()).fold(0.0, f64::max);
            println!("order {order}, {between:?}: {:.1} ns", 1e9 * apart);
            assert!(apart < 4.0 * ROUNDED / (K1 * 20.0) + 1e-9, "{apart}");
        }
    }
}

/// The table of docs/design/numerics-sensor.md: largest errors in thresholds of a contrast of 0.134, for a
/// sine of 40 Hz between greys 3 and 90, and for a step from 20 to 200.
#[test]
fn errors_by_cutoff_and_frame_rate() {
    if !runs_slow_tests() {
        return;
    }
    let signal = sine(3.8, 0.85, 40.0);
    let per_threshold = 1.0 / (0.134 * K1);
    for cutoff_hz in [20.0, 200.0, 2000.0] {
        let points = [[1.0, 0.1 * cutoff_hz], [100.0, cutoff_hz]];
        for order in [1, 2] {
            let wanted = euler(&signal, &points, order, 0.1);
            let error = |rate: f64| {
                let clip = rendered(&signal, rate, 0.1);
                let found = events(&sensor(order, &points, BetweenFrames::Hermite), &clip);
                per_threshold * worst_error(&found, 0.1, &wanted)
            };
            let errors = [500.0, 1000.0, 2400.0, 4000.0].map(error);
            let [a, b, c, d] = errors;
            println!("| {cutoff_hz} Hz | {order} | {a:.1e} | {b:.1e} | {c:.1e} | {d:.1e} |");
            assert!(errors[3] < 1e-4, "{errors:?}");
        }
    }
}
