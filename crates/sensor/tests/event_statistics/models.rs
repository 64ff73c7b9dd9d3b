//! The sensors of ESIM and v2e, compared with closed forms: crossings, dead times, leak, shot noise
//! and the low-pass filter.

use super::{by_pixel, frames, ks, run};
use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_sensor::SensorSettings;
use gs2e_sensor::esim::{EsimModel, IntensityScale};
use gs2e_sensor::noise::{HotPixelNoise, RedrawRule, ReferenceRule, RefractoryPeriod, ThresholdMismatch};
use gs2e_sensor::v2e::{FilterSteps, LeakNoise, V2eModel, V2ePreset};
use std::f64::consts::TAU;

const SIZE: Size = Size { width: 40, height: 25 };
const SMALL: Size = Size { width: 2, height: 1 };
/// Alpha 1e-4 over some twenty statistics: 5e-6 each.
const Z_LIMIT: f64 = 4.6;
const KS_LIMIT: f64 = 2.47;

fn threshold(on: f64, off: f64) -> ThresholdMismatch {
    ThresholdMismatch { on, off, spread: 0.0 }
}

/// No spread, no noise, no filter.
fn ideal_v2e(on: f64, off: f64) -> V2eModel {
    V2eModel { threshold: threshold(on, off), ..V2eModel::from(V2ePreset::Clean) }
}

fn every(step_us: i64, end_us: i64) -> Vec<i64> {
    (0..=end_us / step_us).map(|i| i * step_us).collect()
}

/// Checks that a pixel's events lie where a brightness that runs straight from `from` to `to` in
/// `end_ns` crosses whole thresholds.
fn check_crossings(events: &[(i64, Polarity)], [from, to]: [f64; 2], step: f64, end_ns: f64) {
    let change = to - from;
    assert_eq!(events.len(), (change.abs() / step) as usize, "{from} to {to} in steps of {step}");
    let wanted = if change > 0.0 { Polarity::On } else { Polarity::Off };
    for (j, &(t, polarity)) in events.iter().enumerate() {
        let at = end_ns * (j + 1) as f64 * step / change.abs();
        // Luminance has 24 bits: the logarithm is off by 6e-8 at either end, of a change of at
        // least 0.2. Times are floored to ns.
        assert!((at - t as f64 - 0.5).abs() < 0.51 + 6e-7 * end_ns, "event {j} at {t}, wanted {at}");
        assert_eq!(polarity, wanted);
    }
}

#[test]
fn without_noise_events_lie_where_the_logarithm_crosses() {
    let end = 1_000_000;
    let white = |x: u32, t: i64| if (t == 0) == (x == 0) { 7.0 } else { 255.0 };
    let clip = frames(SMALL, &[0, end], |x, _, t| white(x, t));
    let esim = EsimModel { threshold: threshold(0.11, 0.07), eps: 0.01, ..EsimModel::default() };
    let (events, account) = run(&esim, &clip, 1);
    let seen = |l: f64| (0.01 + l / 255.0).ln();
    let pixels = by_pixel(SMALL, &events);
    check_crossings(&pixels[0], [seen(7.0), seen(255.0)], 0.11, 1e9);
    check_crossings(&pixels[1], [seen(255.0), seen(7.0)], 0.07, 1e9);
    assert_eq!(account.drift_violations, 0);
    assert!(account.drift_worst > 0.0 && account.drift_worst <= 1.0);
    let linear = EsimModel { intensity: IntensityScale::Linear, ..esim };
    let pixels = by_pixel(SMALL, &run(&linear, &clip, 1).0);
    check_crossings(&pixels[0], [7.0 / 255.0, 1.0], 0.11, 1e9);
    check_crossings(&pixels[1], [1.0, 7.0 / 255.0], 0.07, 1e9);
    // v2e's mapping is linear up to 20, with the slope ln(20)/20, and continuous.
    let (events, account) = run(&ideal_v2e(0.11, 0.07), &clip, 1);
    let pixels = by_pixel(SMALL, &events);
    let low = 7.0 * 20f64.ln() / 20.0;
    check_crossings(&pixels[0], [low, 255f64.ln()], 0.11, 1e9);
    check_crossings(&pixels[1], [255f64.ln(), low], 0.07, 1e9);
    assert_eq!(account.drift_violations, 0);
}

#[test]
fn a_signal_straight_in_brightness_can_be_cut_anywhere() {
    // 255 (eps + L/255) runs over three octaves; so does L for v2e, above 20.
    let end = 90_000;
    let octaves = |t: i64| 30.0 * (3.0 * t as f64 / end as f64).exp2();
    let esim = EsimModel {
        threshold: ThresholdMismatch { spread: 0.02, ..threshold(0.05, 0.05) },
        ..EsimModel::default()
    };
    let at = |stamps: &[i64]| run(&esim, &frames(SIZE, stamps, |_, _, t| octaves(t) - 0.255), 3).0;
    let v2e = V2eModel { shot: 300.0, ..V2eModel::from(V2ePreset::Clean) };
    let filtered = |stamps: &[i64]| run(&v2e, &frames(SIZE, stamps, |_, _, _| 90.0), 3).0;
    let same = |a: &[Event], b: &[Event], tolerance_ns: i64| {
        assert!(a.len() > 10_000 && a.len() == b.len(), "{} and {}", a.len(), b.len());
        for (a, b) in by_pixel(SIZE, a).iter().zip(by_pixel(SIZE, b)) {
            assert!(a.len() == b.len());
            let near = |(a, b): (&(i64, Polarity), &(i64, Polarity))| {
                (a.0 - b.0).abs() <= tolerance_ns && a.1 == b.1
            };
            assert!(a.iter().zip(&b).all(near));
        }
    };
    for step in [10_000, 750, 100] {
        // A frame rounds the logarithm by 6e-8; the signal goes 2.3e-8 a ns.
        same(&at(&[0, end]), &at(&every(step, end)), 5);
        same(&filtered(&[0, end]), &filtered(&every(step, end)), 1);
    }
}

/// Times of the events when brightness rises by a threshold every 100 us, with a dead time of 250
/// us.
fn dead_times(reference: ReferenceRule) -> Vec<i64> {
    let refractory = RefractoryPeriod { period_us: 250.0, reference };
    let esim = EsimModel {
        threshold: threshold(0.01, 0.01),
        intensity: IntensityScale::Linear,
        settings: SensorSettings { refractory, ..SensorSettings::default() },
        ..EsimModel::default()
    };
    let clip = frames(SMALL, &every(470, 9870), |_, _, t| 0.0255 * t as f64);
    by_pixel(SMALL, &run(&esim, &clip, 1).0)[0].iter().map(|event| event.0).collect()
}

#[test]
fn dead_times_end_with_the_selected_reference() {
    let t = |reference, interval: i64| {
        let times = dead_times(reference);
        assert_eq!(times.len(), (9_870_000 - 100_000) as usize / interval as usize + 1, "{reference:?}");
        for (j, t) in times.iter().enumerate() {
            // Greys of 24 bits are off by 6e-8 of at most 1; a threshold is 0.01 in 1e5 ns.
            assert!((t - 100_000 - interval * j as i64).abs() < 3 + j as i64, "{reference:?} {j}: {t}");
        }
    };
    // The next whole threshold after the dead time; one threshold after it; or its end, since an
    // event is overdue.
    t(ReferenceRule::Passing, 300_000);
    t(ReferenceRule::AtEnd, 350_000);
    t(ReferenceRule::AtEvent, 250_000);
}

/// Shortest time between events of one pixel, ns.
fn least_gap(size: Size, events: &[Event]) -> i64 {
    let pixels = by_pixel(size, events);
    pixels.iter().flat_map(|events| events.windows(2).map(|w| w[1].0 - w[0].0)).min().unwrap()
}

#[test]
fn no_event_falls_into_a_dead_time() {
    let clip = frames(SIZE, &every(417, 40_000), |x, y, t| {
        120.0 + 119.0 * (f64::from(x * 3 + y) * 0.1 + t as f64 * 6e-4).sin()
    });
    let hot_pixels = HotPixelNoise { share: 0.5, rate: 3000.0, ..HotPixelNoise::default() };
    for reference in [ReferenceRule::AtEvent, ReferenceRule::AtEnd, ReferenceRule::Passing] {
        let refractory = RefractoryPeriod { period_us: 321.5, reference };
        let esim = EsimModel {
            threshold: threshold(0.05, 0.05),
            settings: SensorSettings { refractory, hot_pixels, ..SensorSettings::default() },
            ..EsimModel::default()
        };
        let leak = LeakNoise { rate: 300.0, jitter: 0.3, cov: 0.2 };
        let shot = 2000.0;
        let v2e = V2eModel {
            leak,
            shot,
            cutoff: 300.0,
            settings: SensorSettings { refractory, hot_pixels, ..V2eModel::from(V2ePreset::Noisy).settings },
            ..V2eModel::from(V2ePreset::Noisy)
        };
        for (name, (events, account)) in [("esim", run(&esim, &clip, 2)), ("v2e", run(&v2e, &clip, 2))] {
            let gap = least_gap(SIZE, &events);
            println!("{name} {reference:?}: {} events, least gap {gap} ns", account.events);
            assert!(account.events > 5000 && gap >= 321_500);
        }
        let free = run(
            &EsimModel {
                settings: SensorSettings { refractory: RefractoryPeriod::default(), ..esim.settings },
                ..esim
            },
            &clip,
            2,
        )
        .0;
        assert!(least_gap(SIZE, &free) < 321_500, "without a dead time there would be such events");
    }
}

#[test]
fn a_leak_without_jitter_is_a_clock() {
    // The period is the nominal one at any threshold of the pixel.
    let leak = LeakNoise { rate: 7.3, ..LeakNoise::default() };
    let v2e = V2eModel { leak, ..V2eModel::from(V2ePreset::Clean) };
    for step in [2_000_000, 33_333, 417] {
        let (events, _) = run(&v2e, &frames(SMALL, &every(step, 2_000_000), |_, _, _| 60.0), 1);
        let seconds = *every(step, 2_000_000).last().unwrap() as f64 * 1e-6;
        for events in by_pixel(SMALL, &events) {
            assert_eq!(events.len(), (7.3 * seconds) as usize);
            for (j, event) in events.iter().enumerate() {
                let wanted = 1e9 * (j + 1) as f64 / 7.3;
                assert!(
                    (event.0 as f64 - wanted).abs() < 1.01 && event.1 == Polarity::On,
                    "{event:?} {wanted}"
                );
            }
        }
    }
}

#[test]
fn leaks_spread_by_decades_and_jitter_from_frame_to_frame() {
    let first = |leak: LeakNoise, step: i64| {
        let v2e = V2eModel { leak, ..ideal_v2e(0.2, 0.2) };
        let (events, _) = run(&v2e, &frames(SIZE, &every(step, 400_000), |_, _, _| 60.0), 11);
        by_pixel(SIZE, &events).iter().map(|events| events[0].0 as f64 * 1e-9).collect::<Vec<f64>>()
    };
    let normal = |z: f64| 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2);
    // The first event comes after one period, `1/(rate 10^(cov z))`.
    let spread = first(LeakNoise { rate: 20.0, jitter: 0.0, cov: 0.1 }, 100_000);
    let decades = |scale: f64| {
        let mut z: Vec<f64> = spread.iter().map(|t| -(20.0 * t).log10() / scale).collect();
        z.sort_unstable_by(f64::total_cmp);
        ks(&z, normal)
    };
    let [found, defect] = [decades(0.1), decades(0.15)];
    println!("leak spread: KS {found:.2}, of a spread half as large again {defect:.2} (limit {KS_LIMIT})");
    assert!(found < KS_LIMIT && defect > KS_LIMIT);
    // The level falls by `rate dt (1 - j z)` per frame: after n frames by a normal of mean n and
    // deviation j sqrt(n).
    let jitter = first(LeakNoise { rate: 20.0, jitter: 0.3, cov: 0.0 }, 1000);
    let mean = jitter.iter().sum::<f64>() / jitter.len() as f64;
    let deviation = (jitter.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / jitter.len() as f64).sqrt();
    // To first order a period of 50 frames has the deviation 0.3 sqrt(50) frames of 1 ms. A sample
    // of 1000 estimates it within 1/sqrt(2000) of its value, 4.6 of which are 10 %.
    let wanted = 0.3e-3 * 50f64.sqrt();
    println!("leak jitter: mean {mean:.5} s, deviation {deviation:.6} s, wanted 0.05 and {wanted:.6}");
    assert!((mean - 0.05).abs() < Z_LIMIT * wanted / 1000f64.sqrt() + 1e-5);
    assert!((deviation / wanted - 1.0).abs() < 0.103);
}

#[test]
fn shot_noise_is_poisson_and_rarer_in_the_light() {
    let seconds = 2.0;
    for (grey, step) in [(0.0, 2_000_000), (128.0, 1000), (255.0, 10_000), (1e4, 500_000)] {
        let v2e = V2eModel { shot: 40.0, ..ideal_v2e(0.2, 0.2) };
        let (events, _) = run(&v2e, &frames(SIZE, &every(step, 2_000_000), |_, _, _| grey), 21);
        let rate = 40.0 * (1.0 - 0.75 * (f64::min(grey, 255.0) + 20.0) / 275.0);
        let expected = rate * seconds * SIZE.pixels() as f64;
        let z = (events.len() as f64 - expected) / expected.sqrt();
        let on = events.iter().filter(|e| e.polarity == Polarity::On).count() as f64;
        let balance = (2.0 * on - events.len() as f64) / (events.len() as f64).sqrt();
        // Given their number, the events of a Poisson process are uniform over the time.
        let mut times: Vec<f64> = events.iter().map(|e| e.t.0 as f64 * 0.5e-9).collect();
        times.sort_unstable_by(f64::total_cmp);
        let uniform = ks(&times, |t| t);
        let mut gaps: Vec<f64> = by_pixel(SIZE, &events).iter().map(|e| e[0].0 as f64 * 1e-9).collect();
        gaps.sort_unstable_by(f64::total_cmp);
        let exponential = ks(&gaps, |t| 1.0 - (-rate * t).exp());
        println!("grey {grey}: rate z {z:.2}, balance z {balance:.2}, KS {uniform:.2} and {exponential:.2}");
        assert!(z.abs() < Z_LIMIT && balance.abs() < Z_LIMIT && uniform < KS_LIMIT && exponential < KS_LIMIT);
        let defect = (events.len() as f64 - 1.05 * expected) / expected.sqrt();
        assert!(defect.abs() > Z_LIMIT, "a rate 5 % off would be noticed: z {defect:.1}");
    }
}

#[test]
fn shots_reset_the_leak() {
    // A leak event needs a whole period T without a shot: its rate is s/(e^(sT) - 1), in addition
    // to the shots' own s.
    let leak = LeakNoise { rate: 20.0, ..LeakNoise::default() };
    let v2e = V2eModel { leak, shot: 30.0, ..ideal_v2e(0.2, 0.2) };
    let seconds = 4.0;
    let (events, _) = run(&v2e, &frames(SIZE, &every(4000, 4_000_000), |_, _, _| 50.0), 31);
    let shots = 30.0 * (1.0 - 0.75 * 70.0 / 275.0);
    let leaks = shots / ((shots / 20.0f64).exp() - 1.0);
    let count = |polarity| events.iter().filter(|e| e.polarity == polarity).count() as f64;
    let scale = seconds * SIZE.pixels() as f64;
    let found = [count(Polarity::On) / scale, count(Polarity::Off) / scale];
    let wanted = [leaks + 0.5 * shots, 0.5 * shots];
    for (found, wanted) in found.into_iter().zip(wanted) {
        // Leaks are more even than a Poisson process, whose deviation is used here. From the start
        // to the first event at most one period is missing or extra: a share of 0.05/4 of the
        // leaks, less the share that shots reset.
        let z = (found - wanted) / (wanted / scale).sqrt();
        println!("rate {found:.3}, wanted {wanted:.3}, z {z:.2}");
        assert!(z.abs() < Z_LIMIT);
    }
    let noise = v2e.noise(50.0);
    assert!((noise.total_hz - wanted[0] - wanted[1]).abs() < 1e-12 * noise.total_hz);
    assert!((noise.on_share.unwrap() - wanted[0] / (wanted[0] + wanted[1])).abs() < 1e-12);
}

#[test]
fn a_step_comes_through_the_filter_exponentially() {
    // A step from 30 to 200 within a microsecond, then still.
    let answer = |stamps: &[i64], filter| {
        let v2e = V2eModel { cutoff: 40.0, filter, ..ideal_v2e(0.1, 0.1) };
        let clip = frames(SMALL, stamps, |_, _, t| if t == 0 { 30.0 } else { 200.0 });
        by_pixel(SMALL, &run(&v2e, &clip, 1).0)[0].iter().map(|event| event.0).collect::<Vec<i64>>()
    };
    let tau = 1e9 / (TAU * 40.0 * 220.0 / 275.0);
    let change = (200.0f64 / 30.0).ln();
    let whole = answer(&[0, 1, 30_000], FilterSteps::Exact);
    assert_eq!(whole.len(), (change * (1.0 - (-30e6 / tau).exp()) / 0.1) as usize);
    for (j, &t) in whole.iter().enumerate() {
        let wanted = -tau * (1.0 - 0.1 * (j + 1) as f64 / change).ln();
        // The step itself takes a microsecond.
        assert!((t as f64 - wanted).abs() < 1001.0, "event {j} at {t}, wanted {wanted}");
    }
    let cut: Vec<i64> = [0, 1].into_iter().chain(every(500, 30_000).into_iter().skip(1)).collect();
    let parts = answer(&cut, FilterSteps::Exact);
    assert!(parts.len() == whole.len() && parts.iter().zip(&whole).all(|(a, b)| (a - b).abs() <= 1));
    // Euler's steps of 0.5 ms are each 4 % too large to second order: `ln(1 - e)` for `-e`, e =
    // 0.1.
    let euler = answer(&cut, FilterSteps::Euler);
    let last = (*euler.last().unwrap().min(whole.last().unwrap())) as f64;
    assert!(euler.len().abs_diff(whole.len()) <= 1 && last > 1e6);
    assert!(euler.iter().zip(&whole).any(|(a, b)| (a - b).abs() > 10_000), "the two differ");
}

#[test]
fn thresholds_are_a_pixel_s_own_or_a_frame_s() {
    let clip = |steps: i64| {
        let end = 100_000;
        frames(SIZE, &every(end / steps, end), move |_, _, t| 10.0 + 240.0 * t as f64 / end as f64)
    };
    let wide = ThresholdMismatch { spread: 0.04, ..threshold(0.2, 0.2) };
    let sensor = |mismatch| EsimModel { threshold: wide, mismatch, ..EsimModel::default() };
    let counts = |mismatch, steps| {
        let events = run(&sensor(mismatch), &clip(steps), 5).0;
        by_pixel(SIZE, &events).iter().map(Vec::len).collect::<Vec<usize>>()
    };
    // A pixel's own threshold gives the same number of events at any number of frames.
    assert_eq!(counts(RedrawRule::PerSensor, 1), counts(RedrawRule::PerSensor, 100));
    let spread = |counts: &[usize]| counts.iter().max().unwrap() - counts.iter().min().unwrap();
    let [own, redrawn] = [RedrawRule::PerSensor, RedrawRule::PerFrame].map(|m| counts(m, 100));
    println!("spread of counts: own {}, redrawn {}", spread(&own), spread(&redrawn));
    assert!(spread(&own) > 2 * spread(&redrawn), "many draws even out");
    // The lowest of a hundred draws is crossed first: more events than with one.
    assert!(redrawn.iter().sum::<usize>() > own.iter().sum::<usize>());
}

#[test]
fn extremes_neither_lose_nor_disorder_events() {
    let hour = 3_600_000_000;
    for (c, cap) in [(1e-3, 20_000), (1e3, 1000)] {
        for end in [1, 2000, hour] {
            let clip =
                frames(SMALL, &[0, end, 2 * end], |x, _, t| if (t == end) == (x == 0) { 255.0 } else { 0.0 });
            let esim = EsimModel {
                threshold: threshold(c, c),
                eps: 1e-5,
                settings: SensorSettings { max_events_per_pixel_frame: cap, ..SensorSettings::default() },
                ..EsimModel::default()
            };
            let v2e = V2eModel {
                settings: SensorSettings { max_events_per_pixel_frame: cap, ..ideal_v2e(c, c).settings },
                ..ideal_v2e(c, c)
            };
            let ranges = [(1.0f64 + 1e-5).ln() - 1e-5f64.ln(), 255f64.ln()];
            for ((events, account), range) in
                [run(&esim, &clip, 1), run(&v2e, &clip, 1)].into_iter().zip(ranges)
            {
                assert!(events.is_sorted_by_key(Event::file_order) && account.drift_violations == 0);
                assert!(events.iter().all(|e| e.t.0 > 0 && e.t.0 <= 2000 * end));
                let each = (range / c) as u64;
                // There and back: the residual of the way there is one of the steps of the way
                // back.
                assert!(
                    account.on.abs_diff(2 * each) <= 1 && account.off.abs_diff(2 * each) <= 1,
                    "{account:?}"
                );
                assert_eq!(account.max_per_pixel_frame, each);
            }
        }
    }
    let leak = LeakNoise { rate: 0.1, ..LeakNoise::default() };
    let noisy = V2eModel {
        leak,
        shot: 5.0,
        settings: SensorSettings { max_events_per_pixel_frame: 100_000, ..ideal_v2e(0.2, 0.2).settings },
        ..ideal_v2e(0.2, 0.2)
    };
    let (events, account) = run(&noisy, &frames(SMALL, &[0, hour], |_, _, _| 100.0), 1);
    let expected = 2.0 * 3600.0 * noisy.noise(100.0).total_hz;
    let z = (account.events as f64 - expected) / expected.sqrt();
    assert!(expected > 20_000.0 && z.abs() < Z_LIMIT, "{account:?}, wanted {expected}");
    assert!(events.is_sorted_by_key(Event::file_order));
}

#[test]
fn the_cap_fails_by_name_or_keeps_the_first() {
    let clip = frames(SMALL, &[0, 1000], |x, _, t| if t == 0 || x == 1 { 0.0 } else { 255.0 });
    let esim = EsimModel {
        threshold: threshold(0.01, 0.01),
        settings: SensorSettings { max_events_per_pixel_frame: 100, ..SensorSettings::default() },
        ..EsimModel::default()
    };
    let mut go_on = |_: &_| std::ops::ControlFlow::Continue(());
    let seed = gs2e_num::seed::Seed(1);
    let failed = gs2e_sensor::simulate_one(&mut clip.clone(), &esim, seed, &mut Vec::new(), &mut go_on);
    let wanted = "pixel (0, 0) fires more than 100 events between frames 0 and 1 (luminance 0 to 255 of 255)";
    assert_eq!(failed.unwrap_err().to_string(), wanted);
    let (kept, account) = run(
        &EsimModel { settings: SensorSettings { allow_cap: true, ..esim.settings }, ..esim.clone() },
        &clip,
        1,
    );
    let all = run(
        &EsimModel { settings: SensorSettings { max_events_per_pixel_frame: 1000, ..esim.settings }, ..esim },
        &clip,
        1,
    )
    .0;
    assert_eq!(kept, all[..100]);
    assert_eq!(account.capped, all.len() as u64 - 100);
}
