//! One sequence of luminance makes one stream, independent of sampling, cropping and scheduling
//! (the oracles rate invariance, noiseless crossings, same bytes and time shift).

use super::{by_pixel, frames, run};
use gs2e_event::{Event, Polarity};
use gs2e_image::{Image, Size};
use gs2e_num::seed::Seed;
use gs2e_sensor::bandwidth::{BandwidthPoint, PixelBandwidth};
use gs2e_sensor::esim::EsimModel;
use gs2e_sensor::frames::FrameSequence;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::front_end::FrontEnd;
use gs2e_sensor::noise::{HotPixelNoise, PhotoreceptorNoise, ReceptorPoint, RedrawRule, ThresholdMismatch};
use gs2e_sensor::v2e::{LeakNoise, V2eModel};
use gs2e_sensor::voltmeter::{InitialVoltage, SamplerKind, VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorChoice, SensorModel, SensorSettings, v2e};

const SIZE: Size = Size { width: 24, height: 10 };

/// Stamps at this frame rate, and a last one at `end_us`.
fn stamps(rate: f64, end_us: i64) -> Vec<i64> {
    let regular = (0..).map(|i| (f64::from(i) * 1e6 / rate).round() as i64);
    regular.take_while(|&t| t < end_us).chain([end_us]).collect()
}

/// Checks that every pixel has the same events, with times within `tolerance_ns`.
fn same_events(size: Size, a: &[Event], b: &[Event], tolerance_ns: i64) {
    for (pixel, (a, b)) in by_pixel(size, a).into_iter().zip(by_pixel(size, b)).enumerate() {
        assert_eq!(a.len(), b.len(), "events of pixel {pixel}");
        for (a, b) in a.into_iter().zip(b) {
            let same = a.1 == b.1 && (a.0 - b.0).abs() <= tolerance_ns;
            assert!(same, "pixel {pixel}: {a:?} and {b:?}");
        }
    }
}

/// A sensor so noisy that every pixel fires now and then, static or not.
fn noisy() -> VoltmeterModel {
    VoltmeterModel::new([5.0, 16.0, 2e-2, 1e-5, 1e-7, 4e-3])
}

/// Noise of the photoreceptor, with and without that of the voltage. It is the same at any light.
fn with_receptor() -> [VoltmeterModel; 2] {
    let points = vec![ReceptorPoint { lux: 1.0, deviation: 0.15, cutoff_hz: 300.0 }];
    let photoreceptor_noise = PhotoreceptorNoise { spread: 0.3, points };
    // In one test a single frame interval holds all events.
    let quiet = VoltmeterModel::new([5.0, 16.0, 0.0, 1e-5, 1e-7, 0.0]).without_cap();
    let alone = VoltmeterModel { photoreceptor_noise, ..quiet };
    [VoltmeterModel { k: noisy().k, ..alone.clone() }, alone]
}

#[test]
fn static_pixels_do_not_depend_on_the_frame_rate() {
    let grey = |x: u32, y: u32, _| f64::from(x * 10 + y);
    for sensor in with_receptor().into_iter().chain([noisy()]) {
        let at = |rate| run(&sensor, &frames(SIZE, &stamps(rate, 300_000), grey), 5).0;
        let coarse = at(10.0);
        assert!(coarse.len() > 1000, "{}", coarse.len());
        for rate in [37.3, 240.0, 2400.0] {
            same_events(SIZE, &coarse, &at(rate), 1);
        }
    }
}

#[test]
fn a_signal_that_stays_the_same_can_be_sampled_finer() {
    // L + 16 runs from 16 to 256 in four octaves, so a frame at each octave represents it exactly.
    let octaves = |t: i64, end: i64| 16.0 * (4.0 * t as f64 / end as f64).exp2() - 16.0;
    let end = 80_000;
    for sensor in with_receptor().into_iter().chain([noisy()]) {
        let ramp = |stamps: &[i64]| run(&sensor, &frames(SIZE, stamps, |_, _, t| octaves(t, end)), 6).0;
        let coarse = ramp(&[0, end]);
        assert!(coarse.len() > 3000, "{}", coarse.len());
        same_events(SIZE, &coarse, &ramp(&[0, 20_000, 40_000, 60_000, end]), 1);
        // At other times a frame rounds L to 24 bits, and the drift by 3e-7 thresholds. The signal
        // drifts by 1.7e-4 per us, so events move by 2 ns, and some hundred times as far where noise
        // makes the path flat at the barrier.
        for rate in [240.0, 1429.0, 2400.0] {
            same_events(SIZE, &coarse, &ramp(&stamps(rate, end)), 500);
        }
    }
}

#[test]
fn without_noise_events_divide_the_signal_evenly() {
    let end = 1_000_000;
    let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
    let sensor = VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]);
    let white = |x: u32| f64::from(10 * x + 1);
    let clip = frames(SIZE, &[0, end], |x, _, t| if t == 0 { 0.0 } else { white(x) });
    let (events, account) = run(&sensor, &clip, 1);
    for (pixel, events) in by_pixel(SIZE, &events).into_iter().enumerate() {
        let rise = k1 * ((white(pixel as u32 % SIZE.width) + k2) / k2).ln();
        assert_eq!(events.len(), rise as usize);
        for (j, (t, polarity)) in events.into_iter().enumerate() {
            let wanted = end as f64 * 1e3 * (j + 1) as f64 / rise;
            // Times are floored to ns.
            assert!((-1e-3..1.001).contains(&(wanted - t as f64)), "{t} {wanted}");
            assert_eq!(polarity, Polarity::On);
        }
    }
    assert_eq!(run(&sensor, &clip, 2), (events, account), "the seed has no part in it");
}

#[test]
fn without_noise_leaks_are_clocks() {
    let sensor = VoltmeterModel::new([5.0, 20.0, 0.0, 1.003e-4, 1e-6, 0.0]);
    for rate in [3.0, 700.0] {
        let clip = frames(SIZE, &stamps(rate, 2_000_000), |x, _, _| f64::from(x));
        let (events, _) = run(&sensor, &clip, 1);
        for (pixel, events) in by_pixel(SIZE, &events).into_iter().enumerate() {
            let period_ns = 1e3 / (1.003e-4 + 1e-6 * (pixel % 24) as f64);
            assert_eq!(events.len(), (2e9 / period_ns) as usize);
            for (j, event) in events.iter().enumerate() {
                let wanted = period_ns * (j + 1) as f64;
                assert!((event.0 as f64 - wanted).abs() < 1.01, "{} {wanted}", event.0);
            }
        }
    }
}

/// The thresholds of the pixels of a size, measured without noise on a ramp of the logarithm from
/// grey to grey.
fn thresholds(sensor: &VoltmeterModel, size: Size, greys: [f64; 2]) -> Vec<f64> {
    let end = 1_000_000;
    let [k1, k2, ..] = sensor.k;
    let rise = k1 * ((greys[1] + k2) / (greys[0] + k2)).ln().abs();
    let clip = frames(size, &[0, end], |_, _, t| greys[usize::from(t > 0)]);
    let of_pixel = |events: Vec<(i64, Polarity)>| {
        let threshold = rise * events[0].0 as f64 / (end as f64 * 1e3);
        assert_eq!(events.len(), (rise / threshold) as usize);
        for (j, (t, polarity)) in (1..).zip(events) {
            assert_eq!(polarity == Polarity::On, greys[1] > greys[0]);
            // Each time is floored to ns; the error of the first one counts j times.
            let wanted = threshold * f64::from(j) / rise * end as f64 * 1e3;
            assert!((t as f64 - wanted).abs() < 1.01 + f64::from(j), "{t} {wanted}");
        }
        threshold
    };
    by_pixel(size, &run(sensor, &clip, 8).0).into_iter().map(of_pixel).collect()
}

#[test]
fn unequal_pixels_have_thresholds_of_their_own() {
    let size = Size { width: 90, height: 70 };
    let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
    let sensor = |k5, threshold_spread| VoltmeterModel {
        threshold_off: 0.7,
        threshold_spread,
        ..VoltmeterModel::new([k1, k2, 0.0, 0.0, k5, 0.0])
    };
    let [up, down] = [[0.0, 255.0], [255.0, 0.0]].map(|greys| thresholds(&sensor(0.0, 0.1), size, greys));
    for (values, nominal) in [(&up, 1.0), (&down, 0.7)] {
        let n = values.len() as f64;
        let z: Vec<f64> = values.iter().map(|value| (value - nominal) / 0.1).collect();
        let (mean, variance) = (z.iter().sum::<f64>() / n, z.iter().map(|z| z * z).sum::<f64>() / n);
        println!("around {nominal}: mean {mean:.3} deviations off, variance {variance:.3}");
        // The mean of n has a deviation of 1/sqrt(n), their variance one of sqrt(2/n).
        assert!(mean.abs() < 4.5 / n.sqrt() && (variance - 1.0).abs() < 4.5 * (2.0 / n).sqrt());
    }
    let product: f64 = up.iter().zip(&down).map(|(up, down)| (up - 1.0) * (down - 0.7) / 0.01).sum();
    assert!(product.abs() < 4.5 * (up.len() as f64).sqrt(), "drawn apart");
    // With a leak too weak to move an event, the drift is a curve, and the events are the same.
    assert!(
        up.iter().zip(thresholds(&sensor(1e-18, 0.1), size, [0.0, 255.0])).all(|(a, b)| (a - b).abs() < 1e-7)
    );
    // The drift balance holds for each pixel with its own thresholds, under noise too.
    let noisy = VoltmeterModel { threshold_spread: 0.2, ..noisy() };
    let (events, account) = run(&noisy, &moving(size), 9);
    assert!(events.len() > 1000 && account.drift_violations == 0, "{account:?}");
}

/// One noisy member of each kind of law, with labels.
pub(super) fn models() -> [SensorChoice; 7] {
    let hot_pixels = HotPixelNoise { share: 0.2, rate: 900.0, ..HotPixelNoise::default() };
    let noisy = VoltmeterModel { settings: SensorSettings { labels: true, ..noisy().settings }, ..noisy() };
    let unequal = VoltmeterModel {
        threshold_spread: 0.1,
        settings: SensorSettings { hot_pixels, ..noisy.settings },
        ..noisy.clone()
    };
    let official = VoltmeterModel { law: SamplerKind::Official, threshold_spread: 0.1, ..noisy.clone() };
    let threshold = ThresholdMismatch { on: 0.1, off: 0.15, spread: 0.02 };
    let esim = EsimModel {
        threshold,
        mismatch: RedrawRule::PerFrame,
        settings: SensorSettings { hot_pixels, labels: true, ..SensorSettings::default() },
        ..EsimModel::default()
    };
    let leak = LeakNoise { rate: 300.0, jitter: 0.2, cov: 0.2 };
    let usual = V2eModel::from(v2e::V2ePreset::Noisy);
    let v2e = V2eModel {
        threshold,
        leak,
        shot: 900.0,
        cutoff: 200.0,
        settings: SensorSettings { hot_pixels, labels: true, ..usual.settings },
        ..usual
    };
    let point = |lux, deviation, cutoff_hz| ReceptorPoint { lux, deviation, cutoff_hz };
    let points = vec![point(1.0, 0.3, 100.0), point(250.0, 0.1, 900.0)];
    let front_end = FrontEnd { lux: Some(100.0), ..FrontEnd::default() };
    let receptor = VoltmeterModel {
        photoreceptor_noise: PhotoreceptorNoise { spread: 0.4, points },
        initial: InitialVoltage::Stationary,
        settings: SensorSettings { front_end, ..unequal.settings },
        ..unequal.clone()
    };
    let point = |lux, cutoff_hz| BandwidthPoint { lux, cutoff_hz };
    let points = vec![point(1.0, 100.0), point(250.0, 900.0)];
    let filtered = VoltmeterModel { bandwidth: PixelBandwidth { order: 2, points }, ..receptor.clone() };
    let voltmeters = [noisy, unequal, official, receptor, filtered].map(SensorChoice::Voltmeter);
    let [plain, unequal, official, receptor, filtered] = voltmeters;
    [plain, unequal, official, receptor, filtered, SensorChoice::Esim(esim), SensorChoice::V2e(v2e)]
}

/// A clip that moves, with dark, bright and static parts.
pub(super) fn moving(size: Size) -> ArrayFrames {
    frames(size, &stamps(2400.0, 12_000), |x, y, t| {
        let phase = f64::from(x) * 0.4 + f64::from(y) * 0.2 - t as f64 * 5e-4;
        if x < 4 { f64::from(y) } else { 120.0 + 120.0 * phase.sin() }
    })
}

#[test]
fn threads_change_no_event() {
    let clip = moving(Size { width: 96, height: 90 });
    for model in models() {
        let in_pool = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(model.as_model(), &clip, 3))
        };
        let one = in_pool(1);
        assert!(one.0.len() > 2000, "{}", one.0.len());
        for threads in [2, 3, 64] {
            assert!(in_pool(threads) == one, "{threads} threads");
        }
    }
}

/// Events of a crop of the clip whose corner is at `origin`, in the crop's coordinates.
fn of_crop(
    model: &SensorChoice,
    clip: &ArrayFrames,
    [x0, y0]: [u16; 2],
    size: Size,
    origin: [u16; 2],
) -> Vec<Event> {
    let mut pixels = model.as_model().start(size, origin, Seed(4)).unwrap();
    let (mut clip, mut events) = (clip.clone(), Vec::new());
    while let Some(mut frame) = clip.next().unwrap() {
        let row = |y: u32| {
            let from = ((u32::from(y0) + y) * SIZE.width + u32::from(x0)) as usize;
            frame.luminance.pixels()[from..from + size.width as usize].to_vec()
        };
        let part = (0..size.height).flat_map(row).collect();
        frame.luminance = Image::from_vec(size, part);
        pixels.advance(&frame, &mut events).unwrap();
    }
    pixels.finish(&mut events).unwrap();
    events
}

#[test]
fn crops_and_tiles_are_parts_of_the_whole() {
    let clip = moving(SIZE);
    let [left, top] = [600, 400];
    for model in models() {
        let whole = of_crop(&model, &clip, [0, 0], SIZE, [left, top]);
        for (x0, y0, width, height) in
            [(0, 0, 24, 10), (3, 2, 7, 5), (23, 9, 1, 1), (0, 4, 24, 1), (5, 0, 1, 10)]
        {
            let size = Size { width, height };
            let inside = |e: &&Event| {
                (x0..x0 + width as u16).contains(&e.x) && (y0..y0 + height as u16).contains(&e.y)
            };
            let wanted: Vec<Event> =
                whole.iter().filter(inside).map(|e| Event { x: e.x - x0, y: e.y - y0, ..*e }).collect();
            assert!(!wanted.is_empty());
            assert_eq!(of_crop(&model, &clip, [x0, y0], size, [left + x0, top + y0]), wanted);
        }
    }
}

#[test]
fn events_handed_over_early_are_the_beginning_of_the_whole() {
    let mut clip = moving(SIZE);
    let whole = run(&noisy(), &clip, 4).0;
    let mut pixels = noisy().start(SIZE, [0, 0], Seed(4)).unwrap();
    let mut events = Vec::new();
    while let Some(frame) = clip.next().unwrap() {
        pixels.advance(&frame, &mut events).unwrap();
        assert_eq!(events[..], whole[..events.len()]);
        // One root cell, and the microsecond in which it ends, may still wait.
        let certain = whole.partition_point(|event| event.t.0 < frame.t.0 - (1 << 20) - 1000);
        assert!(events.len() >= certain, "{} of {certain} events are out at {:?}", events.len(), frame.t);
    }
    pixels.finish(&mut events).unwrap();
    assert_eq!(events, whole);
}

#[test]
fn a_longer_clip_begins_as_the_shorter_one() {
    let all = stamps(2400.0, 12_000);
    let sensor = noisy();
    let grey = |x: u32, y: u32, t: i64| 100.0 + f64::from(x + y) + 90.0 * (t as f64 * 1e-3).sin();
    let long = run(&sensor, &frames(SIZE, &all, grey), 8).0;
    let short = run(&sensor, &frames(SIZE, &all[..20], grey), 8).0;
    // The clips agree up to the leaf that holds the last stamp.
    let end = all[19] * 1000 - (1 << 13);
    let part = |events: &[Event]| events.iter().copied().filter(|e| e.t.0 < end).collect::<Vec<_>>();
    assert!(short.len() > 100);
    assert_eq!(part(&long), part(&short));
}

#[test]
fn stamps_that_begin_elsewhere_change_nothing() {
    let greys: Vec<f32> = (0..5 * SIZE.pixels()).map(|i| (i * 37 % 256) as f32).collect();
    let at = |first: i64| {
        let stamps: Vec<i64> = [0, 300, 1700, 1701, 9000].map(|t| first + t).to_vec();
        let samples = ArraySamples::Floats(greys.clone(), FullScale::Grey255);
        run(&noisy(), &ArrayFrames::new(SIZE, samples, &stamps).unwrap(), 1)
    };
    let wanted = at(0);
    for first in [16_800_000, 1 << 31, 1_000_000_000_000_000, -5] {
        assert_eq!(at(first), wanted);
    }
}
