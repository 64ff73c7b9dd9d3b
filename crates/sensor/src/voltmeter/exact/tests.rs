//! The exact law as a whole: frames that are refused, caps, extremes, and instruction sets.

use super::*;
use crate::noise::{PhotoreceptorNoise, ReceptorPoint};
use crate::voltmeter::VoltmeterPreset;
use crate::{SensorModel, SensorSettings};
use gs2e_image::Image;
use gs2e_num::units::Timestamp;

const SIZE: Size = Size { width: 3, height: 2 };

fn frame(index: usize, ns: i64, luminance: [f32; 6]) -> DenseFrame {
    DenseFrame { index, t: Timestamp(ns), luminance: Image::from_vec(SIZE, luminance.to_vec()), rate: None }
}

/// The counts for these frames, or the first error.
fn run(sensor: &VoltmeterModel, frames: &[DenseFrame]) -> Result<SimulationAccount, SensorError> {
    let mut pixels = sensor.start(SIZE, [0, 0], Seed(1))?;
    let mut events = Vec::new();
    for frame in frames {
        pixels.advance(frame, &mut events)?;
    }
    pixels.finish(&mut events)
}

fn dvs346() -> VoltmeterModel {
    VoltmeterModel::new(VoltmeterPreset::Dvs346.k())
}

#[test]
fn frames_that_cannot_be_used_are_refused_with_their_number() {
    let t = |frames: &[DenseFrame], message: &str| {
        assert_eq!(run(&dvs346(), frames).unwrap_err().to_string(), message);
    };
    let grey = [9.0; 6];
    t(&[frame(0, 5, grey)], "frame 0: the first stamp is 5 ns, not 0");
    t(&[frame(0, 0, grey), frame(1, 0, grey)], "frame 1: its stamp 0 ns is not after 0 ns");
    t(
        &[frame(0, 0, grey), frame(1, 1 << 56, grey)],
        "frame 1: its stamp 72057594037927936 ns is beyond 72057594037927936 ns",
    );
    t(
        &[frame(0, 0, grey), frame(1, 1000, [0.0, 1.0, 2.0, 3.0, f32::NAN, 4.0])],
        "frame 1: the luminance of pixel (1, 1) is NaN, not a finite number",
    );
    let other = Image::filled(Size { width: 2, height: 3 }, 0.0);
    let other = DenseFrame { index: 0, t: Timestamp(0), luminance: other, rate: None };
    t(&[other], "frame 0: it is 2x3, the sequence is 3x2");
}

/// Frames with events of both polarities, quiet pixels, and more than one leg in a window.
fn lively() -> Vec<DenseFrame> {
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
        let mut pixels = ExactSampler::new(sensor, u32::MAX, array);
        pixels.level = level;
        let mut events: Vec<gs2e_event::Event> = Vec::new();
        lively().iter().for_each(|frame| pixels.advance(frame, &mut events).unwrap());
        (pixels.finish(&mut events).unwrap(), events)
    };
    let noisy = VoltmeterModel::new([8.0, 16.0, 2e-2, 1e-5, 1e-6, 4e-3]);
    let quiet = VoltmeterModel::new([8.0, 16.0, 0.0, 1e-5, 1e-6, 0.0]);
    let curved = VoltmeterModel { between: BetweenFrames::Catmull, ..noisy.clone() };
    let points = vec![ReceptorPoint { lux: 250.0, deviation: 0.05, cutoff_hz: 300.0 }];
    let photoreceptor_noise = PhotoreceptorNoise { spread: 0.3, points };
    let receptor = VoltmeterModel { photoreceptor_noise, ..noisy.clone() };
    for sensor in [noisy, quiet, curved, receptor, dvs346()] {
        let wanted = on(&sensor, best);
        assert!(wanted.0.events > 100, "{:?}", wanted.0);
        levels.iter().for_each(|level| assert_eq!(on(&sensor, *level), wanted, "{level:?}"));
    }
}

#[test]
fn sensors_that_cannot_be_set_up_are_refused() {
    let mut sensor = dvs346();
    let at =
        |sensor: &VoltmeterModel, origin| sensor.start(SIZE, origin, Seed(1)).err().map(|e| e.to_string());
    assert_eq!(at(&sensor, [u16::MAX - 2, u16::MAX - 1]), None);
    let wanted = "frames of 3x2 at (65534, 0) exceed the 65536 columns and rows that events can address";
    assert_eq!(at(&sensor, [u16::MAX - 1, 0]).as_deref(), Some(wanted));
    sensor.k[0] = f64::NAN;
    assert_eq!(at(&sensor, [0, 0]).as_deref(), Some("k1 is NaN, not a finite number above 0"));
}

#[test]
fn the_cap_names_pixel_frames_and_luminance() {
    let steps = [[0.0; 6], [0.0; 6], [0.0, 0.0, 0.0, 0.0, 0.0, 255.0]];
    let frames: Vec<DenseFrame> = (0..3).map(|i| frame(i, 400_000 * i as i64, steps[i])).collect();
    // Grey 0 to 255 is 13.8 thresholds.
    let mut sensor = VoltmeterModel {
        settings: SensorSettings { max_events_per_pixel_frame: 13, ..dvs346().settings },
        ..dvs346()
    };
    assert_eq!(run(&sensor, &frames).unwrap().max_per_pixel_frame, 13);
    for k in [dvs346().k, [5.265, 20.0, 0.0, 0.0, 0.0, 0.0]] {
        sensor = VoltmeterModel {
            k,
            settings: SensorSettings { max_events_per_pixel_frame: 12, ..sensor.settings },
            ..sensor
        };
        assert_eq!(
            run(&sensor, &frames).unwrap_err().to_string(),
            "pixel (2, 1) fires more than 12 events between frames 1 and 2 (luminance 0 to 255 of 255)"
        );
    }
}

#[test]
fn the_cap_counts_between_frames_whatever_the_clock_cuts() {
    // 10 events in each of 5 intervals of 3 ms, each of which spans several root cells.
    let greys = |i: usize| [0.0f32, 113.6][i % 2];
    let frames: Vec<DenseFrame> = (0..6).map(|i| frame(i, 3_000_000 * i as i64, [greys(i); 6])).collect();
    let account = run(
        &VoltmeterModel {
            settings: SensorSettings { max_events_per_pixel_frame: 10, ..dvs346().settings },
            ..dvs346()
        },
        &frames,
    )
    .unwrap();
    assert_eq!((account.max_per_pixel_frame, account.active_pixels), (10, 6));
}

#[test]
fn negative_luminance_is_black_and_counted() {
    let frames = |grey: f32| [frame(0, 0, [grey; 6]), frame(1, 1_000_000, [100.0; 6])];
    let black = run(&dvs346(), &frames(0.0)).unwrap();
    let negative = run(&dvs346(), &frames(-1e-3)).unwrap();
    assert_eq!(negative, SimulationAccount { negative_luminance: 6, ..black });
}

#[test]
fn a_sequence_without_time_has_no_events() {
    assert_eq!(run(&dvs346(), &[]).unwrap(), SimulationAccount::default());
    assert_eq!(run(&dvs346(), &[frame(0, 0, [200.0; 6])]).unwrap(), SimulationAccount::default());
}

#[test]
fn extremes_of_brightness_and_time_stay_finite() {
    let greys = [0.0, 1e-12, 255.0, 1e6, f32::MIN_POSITIVE, 1.0];
    let swapped = [1e6, 255.0, 0.0, 1e-12, 1.0, 0.0];
    for k in [VoltmeterPreset::Dvs346.k(), VoltmeterPreset::Gs2eSi.k(), [5.265, 20.0, 0.0, 0.0, 0.0, 0.0]] {
        // Two frames a microsecond apart, then a gap of an hour.
        let stamps = [0, 1000, 2000, 3_600_000_000_000];
        let last = if k[2] > 0.0 { 3 } else { 4 };
        let frames: Vec<DenseFrame> =
            (0..last).map(|i| frame(i, stamps[i], if i % 2 == 0 { greys } else { swapped })).collect();
        let account = run(&VoltmeterModel::new(k), &frames).unwrap();
        assert_eq!(account.drift_violations, 0, "{account:?}");
        assert!(account.on > 0 && account.off > 0 && account.drift_worst.is_finite());
    }
}
