//! Recordings of a sensor whose numbers are known.

use gs2e_calibrate::{
    CalibrateError, Calibration, PixelTrains, Recording, StaticRecording, calibrate, calibrate_static,
    sensor_text,
};
use gs2e_event::Event;
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use gs2e_sensor::esim::EsimModel;
use gs2e_sensor::frames::DenseFrame;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
use gs2e_sensor::noise::{HotPixelNoise, ReferenceRule, RefractoryPeriod, ThresholdMismatch};
use gs2e_sensor::simulate_one;
use std::ops::ControlFlow;

const SIZE: Size = Size { width: 40, height: 32 };
/// A dense frame each millisecond for 1.6 s, of which each 25th is a frame of the camera.
const DENSE: usize = 1600;
const EVERY: usize = 25;
/// Grey of black in the frames.
const BLACK: f32 = 9.0;

/// Light of a pixel: two waves over a ramp; the leftmost 12 columns stand still.
fn light(frame: usize, pixel: usize) -> f32 {
    let (x, y) = ((pixel % 40) as f32, (pixel / 40) as f32);
    let t = if x < 12.0 { 0.0 } else { frame as f32 * 1e-3 };
    let wave = 0.5 * (0.35 * x + 0.2 * y - 14.0 * t).sin() + 0.4 * (0.1 * x - 0.3 * y + 9.0 * t).sin();
    (25.0 + 2.0 * y) * wave.exp()
}

fn simulated(model: &EsimModel, samples: Vec<f32>) -> Vec<Event> {
    let stamps: Vec<i64> = (0..DENSE as i64).map(|i| 1000 * i).collect();
    let mut dense = ArrayFrames::new(SIZE, ArraySamples::Floats(samples, FullScale::Grey255), &stamps)
        .expect("frames are sound");
    let mut events: Vec<Event> = Vec::new();
    let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
    simulate_one(&mut dense, model, Seed(3), &mut events, &mut go_on).expect("nothing stops it");
    events
}

fn planted(model: &EsimModel) -> Recording {
    let pixels = SIZE.pixels();
    let samples: Vec<f32> = (0..DENSE * pixels).map(|i| light(i / pixels, i % pixels)).collect();
    let shown = |v: f32| (v + BLACK).round().clamp(0.0, 255.0);
    let frames = (0..DENSE).step_by(EVERY).flat_map(|i| &samples[i * pixels..(i + 1) * pixels]);
    let frames = frames.map(|v| shown(*v)).collect();
    let trains = PixelTrains::new(SIZE, &simulated(model, samples));
    let stamps_us = (0..DENSE as i64).map(|i| 1000 * i).step_by(EVERY).collect();
    Recording { size: SIZE, stamps_us, frames, trains }
}

/// A wall, with a share of hot pixels.
fn wall(share: f64, lux: f64) -> StaticRecording {
    let mut model = sensor();
    model.settings.hot_pixels = HotPixelNoise { share, rate: 100.0, spread: 0.2 };
    let events = simulated(&model, vec![80.0; DENSE * SIZE.pixels()]);
    let span_us = (0, 1000 * (DENSE as i64 - 1));
    StaticRecording { trains: PixelTrains::new(SIZE, &events), span_us, lux: Some(lux) }
}

fn sensor() -> EsimModel {
    let threshold = ThresholdMismatch { on: 0.16, off: 0.21, spread: 0.01 };
    EsimModel { threshold, ..EsimModel::default() }
}

fn assert_contrasts(found: &Calibration) {
    for (contrast, want) in [(found.contrast_on, 0.16), (found.contrast_off, 0.21)] {
        let (error, se) = ((contrast.value - want).abs(), contrast.se.expect("has an error"));
        assert!(error <= 0.03 * want && error <= 3.0 * se && se < 0.03 * want, "{contrast:?} {want}");
    }
}

#[test]
fn the_numbers_of_the_sensor_are_found() {
    let found = calibrate(&planted(&sensor()), &[]).unwrap();
    println!("{found:#?}\n{}", sensor_text(&found));
    assert_contrasts(&found);
    // A deviation of 0.01 of either contrast.
    let spread = (0.5 * ((0.01_f64 / 0.16).powi(2) + (0.01_f64 / 0.21).powi(2))).sqrt();
    assert!((found.spread.value - spread).abs() < 0.01, "{:?} {spread}", found.spread);
    // The offset of ESIM is 0.001 of white, and the frames are 9 grey too bright.
    let (offset, se) = (found.offset.value, found.offset.se.unwrap());
    assert!((offset - (0.255 - 9.0)).abs() < 3.0 * se, "{offset} {se}");
    assert!(!found.black_level.determined);
    // No noise at all: no leak and no hot pixels.
    assert!(found.leak_hz.value.abs() <= 3.0 * found.leak_hz.se.unwrap());
    assert_eq!(found.hot_pixels.value.to_bits(), 0.0f64.to_bits());
}

/// Hot pixels show the dead time.
#[test]
fn hot_pixels_are_counted_and_show_the_dead_time() {
    let mut model = sensor();
    model.settings.hot_pixels = HotPixelNoise { share: 0.008, rate: 100.0, spread: 0.2 };
    model.settings.refractory = RefractoryPeriod { period_us: 800.0, reference: ReferenceRule::AtEnd };
    let found = calibrate(&planted(&model), &[]).unwrap();
    let (share, se) = (found.hot_pixels.value, found.hot_pixels.se.unwrap());
    println!("{share} +- {se}, {:?}", found.dead_time_us);
    assert!(share > 0.0 && (share - 0.008).abs() < 3.0 * se);
    assert!(found.dead_time_us.determined && (found.dead_time_us.value / 800.0 - 1.0).abs() < 0.1);
    let near = |contrast: f64, want: f64| (contrast / want - 1.0).abs() < 0.06;
    assert!(near(found.contrast_on.value, 0.16) && near(found.contrast_off.value, 0.21), "{found:?}");
}

/// The first wall decides; each has a row. Without frames there is one wall.
#[test]
fn walls_show_hot_pixels_at_their_light() {
    let found = calibrate(&planted(&sensor()), &[wall(0.02, 10.0), wall(0.06, 500.0)]).unwrap();
    let near =
        |share: gs2e_calibrate::Estimate, want: f64| (share.value - want).abs() < 3.0 * share.se.unwrap();
    assert!(near(found.hot_pixels, 0.02), "{:?}", found.hot_pixels);
    for (level, [lux, share]) in found.by_light.iter().zip([[10.0, 0.02], [500.0, 0.06]]) {
        assert_eq!(level.lux, Some(lux));
        assert!(near(level.hot_pixels, share), "{level:?}");
        // Calm pixels have no noise.
        assert_eq!(level.noise_on_hz.value.to_bits(), 0.0_f64.to_bits());
    }
    assert_eq!(found.by_light.len(), 2);
    let alone = calibrate_static(&wall(0.06, 500.0)).unwrap();
    assert!(near(alone.hot_pixels, 0.06) && alone.by_light.len() == 1 && !alone.contrast_on.determined);
    let moving = StaticRecording { trains: planted(&sensor()).trains, ..wall(0.0, 1.0) };
    assert!(matches!(calibrate_static(&moving), Err(CalibrateError::Moving { .. })));
}

#[test]
fn recordings_that_say_nothing_are_refused() {
    let sound = planted(&sensor());
    let later =
        Recording { stamps_us: sound.stamps_us.iter().map(|us| us + 60_000_000).collect(), ..sound.clone() };
    assert!(matches!(calibrate(&later, &[]), Err(CalibrateError::Clocks { .. })));
    let white = Recording { frames: vec![255.0; sound.frames.len()], ..sound.clone() };
    assert!(matches!(calibrate(&white, &[]), Err(CalibrateError::Clipped { .. })));
    let trains = PixelTrains::new(SIZE, &[]);
    let empty = Recording { trains, ..sound };
    assert_eq!(calibrate(&empty, &[]).unwrap_err(), CalibrateError::Few { found: 0 });
}
