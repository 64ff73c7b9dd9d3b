use super::*;
use crate::bandwidth::BandwidthPoint;
use crate::voltmeter::InitialVoltage;
use crate::{SensorModel as _, SensorParameters as _, SensorSettings};
use gs2e_event::Event;
use gs2e_image::Image;
use gs2e_num::seed::Seed;
use gs2e_num::units::Timestamp;

const SIZE: Size = Size { width: 3, height: 2 };

/// A filter of one cutoff, on a sensor without noise.
fn quiet(order: u32, cutoff_hz: f64) -> VoltmeterModel {
    let bandwidth = PixelBandwidth { order, points: vec![BandwidthPoint { lux: 1.0, cutoff_hz }] };
    VoltmeterModel { bandwidth, ..VoltmeterModel::new([8.0, 16.0, 0.0, 0.0, 0.0, 0.0]) }
}

/// A filter that follows the light, on a sensor with every noise.
fn lively(order: u32, between: BetweenFrames) -> VoltmeterModel {
    let point = |lux, cutoff_hz| BandwidthPoint { lux, cutoff_hz };
    let mut sensor = VoltmeterModel {
        between,
        initial: InitialVoltage::Stationary,
        bandwidth: PixelBandwidth { order, points: vec![point(1.0, 20.0), point(100.0, 200.0)] },
        ..VoltmeterModel::new([8.0, 16.0, 2e-2, 1e-5, 1e-6, 4e-3])
    };
    sensor.settings.front_end.lux = Some(250.0);
    sensor
}

fn frame(index: usize, ns: i64, luminance: [f32; 6]) -> DenseFrame {
    let rate = Some(Image::filled(SIZE, 0.0));
    let luminance = Image::from_vec(SIZE, luminance.to_vec());
    DenseFrame { index, t: Timestamp(ns), luminance, rate }
}

/// The counts and events for these frames, or the first error.
fn run(
    sensor: &VoltmeterModel,
    frames: &[DenseFrame],
) -> Result<(SimulationAccount, Vec<Event>), SensorError> {
    let mut pixels = sensor.start(SIZE, [7, 9], Seed(1))?;
    let mut events = Vec::new();
    frames.iter().try_for_each(|frame| pixels.advance(frame, &mut events))?;
    Ok((pixels.finish(&mut events)?, events))
}

/// Frames with events of both polarities, and more than one in a window.
fn waves() -> Vec<DenseFrame> {
    let grey = |i: usize, pixel: usize| 120.0 + 110.0 * libm::sinf(0.3 * (i * pixel) as f32 + pixel as f32);
    (0..40).map(|i| frame(i, 416_667 * i as i64, std::array::from_fn(|pixel| grey(i, pixel)))).collect()
}

#[test]
fn instruction_sets_do_not_show() {
    let mut levels = vec![Level::baseline()];
    let best = Level::new();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        levels.extend(best.as_sse4_2().map(Level::Sse4_2));
        levels.extend(best.as_avx2().map(Level::Avx2));
    }
    let on = |sensor: &VoltmeterModel, level| {
        let array = PixelArray { size: SIZE, origin: [7, 9], seed: Seed(1), labels: false };
        let mut pixels = LowPassPixels::new(sensor, u32::MAX, array);
        pixels.level = level;
        let mut events: Vec<Event> = Vec::new();
        waves().iter().for_each(|frame| pixels.advance(frame, &mut events).unwrap());
        (pixels.finish(&mut events).unwrap(), events)
    };
    for sensor in [
        lively(1, BetweenFrames::Linear),
        lively(2, BetweenFrames::Catmull),
        lively(2, BetweenFrames::Hermite),
        quiet(1, 100.0),
    ] {
        let wanted = on(&sensor, best);
        assert!(wanted.0.events > 20 && wanted.0.drift_violations == 0, "{:?}", wanted.0);
        levels.iter().for_each(|level| assert_eq!(on(&sensor, *level), wanted, "{level:?}"));
    }
}

#[test]
fn frames_that_cannot_be_used_are_refused_with_their_number() {
    let t = |between, frames: &[DenseFrame], message: &str| {
        let sensor = VoltmeterModel { between, ..quiet(1, 100.0) };
        assert_eq!(run(&sensor, frames).unwrap_err().to_string(), message);
    };
    let grey = [9.0; 6];
    t(BetweenFrames::Linear, &[frame(0, 5, grey)], "frame 0: the first stamp is 5 ns, not 0");
    t(
        BetweenFrames::Catmull,
        &[frame(0, 0, grey), frame(1, 0, grey)],
        "frame 1: its stamp 0 ns is not after 0 ns",
    );
    t(
        BetweenFrames::Linear,
        &[frame(0, 0, grey), frame(1, 1000, [0.0, 1.0, 2.0, 3.0, f32::NAN, 4.0])],
        "frame 1: the luminance of pixel (1, 1) is NaN, not a finite number",
    );
    t(
        BetweenFrames::Hermite,
        &[DenseFrame { rate: None, ..frame(0, 0, grey) }],
        "frame 0: it has no rate of change, which `between: hermite` needs",
    );
}

#[test]
fn the_cap_counts_between_the_frames_of_the_sequence() {
    // Grey 0 to 240 is 8 ln 16 = 22.2 thresholds. In the first interval, the filter answers with 11.09 of
    // them (a half time constant after the middle), over several pieces.
    let steps = [[0.0; 6], [240.0; 6], [240.0; 6]];
    let frames: Vec<DenseFrame> = (0..3).map(|i| frame(i, 4_000_000 * i as i64, steps[i])).collect();
    let sensor = quiet(1, 100.0);
    let (account, events) = run(&sensor, &frames).unwrap();
    let first = events.iter().filter(|event| event.x == 0 && event.y == 0 && event.t.0 <= 4_000_000);
    let first = first.count() as u64;
    let most = account.max_per_pixel_frame;
    assert!(first > 5 && most >= first, "{account:?}");
    let capped = |cap| VoltmeterModel {
        settings: SensorSettings { max_events_per_pixel_frame: cap, ..sensor.settings },
        ..sensor.clone()
    };
    let most = u32::try_from(most).unwrap();
    assert!(run(&capped(most), &frames).is_ok());
    let error = run(&capped(most - 1), &frames).unwrap_err().to_string();
    assert!(error.starts_with("pixel (0, 0) fires more than"), "{error}");
    // Each frame counts for itself.
    assert!(account.events < 6 * 2 * u64::from(most));
    let dropping = VoltmeterModel {
        settings: SensorSettings { allow_cap: true, ..capped(most - 1).settings },
        ..sensor.clone()
    };
    assert!(run(&dropping, &frames).unwrap().0.capped > 0);
}

#[test]
fn short_and_long_sequences_end() {
    assert_eq!(run(&quiet(1, 100.0), &[]).unwrap().0, SimulationAccount::default());
    for between in [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite] {
        for order in [1, 2] {
            let sensor = VoltmeterModel { between, ..quiet(order, 100.0) };
            let steps = [[3.0; 6], [200.0; 6], [50.0; 6], [50.0; 6]];
            assert_eq!(run(&sensor, &[frame(0, 0, steps[0])]).unwrap().0, SimulationAccount::default());
            // A microsecond, and then hours: at last, every pixel has followed its frames. A parabola through
            // such stamps leaves all bounds.
            let first = if between == BetweenFrames::Catmull { 3_600_000_000_000 } else { 1000 };
            let stamps = [0, first, 7_200_000_000_000, 14_400_000_000_000];
            for n in [2, 3, 4] {
                let frames: Vec<DenseFrame> = (0..n).map(|i| frame(i, stamps[i], steps[i])).collect();
                let (account, events) = run(&sensor, &frames).unwrap();
                assert_eq!(account.drift_violations, 0);
                assert!(n > 2 || first > 1000 || events.is_empty(), "nothing happens in a microsecond");
                if n == 4 && between != BetweenFrames::Hermite {
                    let balance = account.on as f64 - account.off as f64;
                    let rise = 8.0 * libm::log((50.0f64 + 16.0) / (3.0 + 16.0));
                    assert!((balance / 6.0 - rise).abs() < 1.0, "{between:?} {order}: {account:?}");
                }
            }
        }
    }
}

#[test]
fn negative_and_extreme_luminance_is_taken() {
    let greys = [-1.0, 1e-12, 255.0, 1e6, f32::MIN_POSITIVE, 1.0];
    let swapped = [1e6, 255.0, 0.0, -1e-12, 1.0, f32::MAX];
    for between in [BetweenFrames::Linear, BetweenFrames::Catmull, BetweenFrames::Hermite] {
        for order in [1, 2] {
            let stamps = [0, 1000, 500_000, 100_000_000];
            let mut frames: Vec<DenseFrame> =
                (0..4).map(|i| frame(i, stamps[i], if i % 2 == 0 { greys } else { swapped })).collect();
            // A leak by light would make as many events as there is light.
            let mut sensor = lively(order, between).without_cap();
            sensor.k[4] = 0.0;
            // A rate that makes the cubic leave all bounds.
            frames[2].rate = Some(Image::filled(SIZE, -1e5));
            let (account, _) = run(&sensor, &frames).unwrap();
            assert_eq!((account.negative_luminance, account.drift_violations), (4, 0), "{account:?}");
            assert!(account.drift_worst.is_finite());
        }
    }
}

#[test]
fn sensors_that_cannot_be_filtered_are_refused() {
    use crate::voltmeter::{DriftGain, SamplerKind};
    let t = |change: fn(&mut VoltmeterModel), message: &str| {
        let mut sensor = lively(1, BetweenFrames::Linear);
        change(&mut sensor);
        assert_eq!(sensor.validate().unwrap_err().to_string(), message);
    };
    t(
        |s| s.settings.front_end.lux = None,
        "`bandwidth` with several points requires `front_end.lux`, the light of white",
    );
    t(
        |s| (s.law, s.initial) = (SamplerKind::Official, InitialVoltage::Zero),
        "`bandwidth` requires `law: exact`",
    );
    t(|s| s.gain = DriftGain::Midpoint, "`bandwidth` requires `gain: log`");
    t(|s| s.bandwidth.order = 0, "bandwidth.order is 0, not 1 or 2");
}

/// A record from before the option existed stays the same, and one with it is read back.
#[test]
fn a_record_has_the_filter_if_it_is_in_use() {
    let plain = VoltmeterModel { bandwidth: PixelBandwidth::default(), ..quiet(1, 100.0) };
    assert!(!serde_json::to_string(&plain).unwrap().contains("bandwidth"));
    let sensor = quiet(2, 100.0);
    let text = serde_json::to_string(&sensor).unwrap();
    assert!(text.ends_with(r#""bandwidth":{"order":2,"points":[{"lux":1.0,"cutoff_hz":100.0}]}}"#), "{text}");
    assert_eq!(serde_json::from_str::<VoltmeterModel>(&text).unwrap(), sensor);
    // The noise-free twin is as slow.
    let quiet = sensor.without_noise();
    assert_eq!(quiet.as_voltmeter().unwrap().bandwidth, sensor.bandwidth);
}
