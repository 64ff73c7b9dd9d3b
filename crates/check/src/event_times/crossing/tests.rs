//! Sound and planted clocks of a planted world with unequal pixels and a noise floor, from rounded
//! frames.

use super::*;
use crate::planted::{FRAMES, PlantedWorld, WorldSettings, wave_picture};
use gs2e_image::Image;
use gs2e_num::units::Timestamp;
use gs2e_sensor::SensorChoice;

/// Thresholds and spread of a DAVIS346, with the noise of bright and of dim light.
fn settings() -> impl Iterator<Item = WorldSettings> {
    let of = |(pace, floor_hz, initial)| WorldSettings {
        thresholds: [1.0, 1.907],
        spread: 0.157,
        contrast: 0.8,
        pace,
        floor_hz,
        initial,
        ..WorldSettings::default()
    };
    use gs2e_sensor::voltmeter::InitialVoltage::{Stationary, Zero};
    [
        (0.3, [0.0; 2], Zero),
        (0.1, [0.2, 0.05], Zero),
        (0.8, [0.2, 0.05], Zero),
        (0.3, [0.2, 0.05], Stationary),
        (0.3, [2.0, 3.0], Zero),
    ]
    .into_iter()
    .map(of)
}

/// Frames of 8 bits.
fn rounded_frame(setting: WorldSettings, j: usize, t_us: i64) -> BrightnessFrame {
    let picture = wave_picture(setting, j);
    let cut = picture.pixels().iter().map(|l| !(0.5..=254.5).contains(l)).collect();
    let grey = picture.pixels().iter().map(|l| l.round().clamp(0.0, 255.0)).collect();
    BrightnessFrame { t_us, brightness: Image::from_vec(picture.size(), grey), cut }
}

fn rounded_frames(world: &PlantedWorld, setting: WorldSettings) -> Vec<BrightnessFrame> {
    let stamps = world.trajectory.stamps_us.iter().enumerate();
    stamps.map(|(j, t_us)| rounded_frame(setting, j, *t_us)).collect()
}

/// The clock of a world whose events have other times.
fn clock_of(world: &PlantedWorld, frames: &[BrightnessFrame], time: impl Fn(f64) -> f64) -> CrossingFit {
    clock_of_lines(world, frames, 1, time)
}

/// The clock by the events on every `apart`-th line.
fn clock_of_lines(
    world: &PlantedWorld,
    frames: &[BrightnessFrame],
    apart: u64,
    time: impl Fn(f64) -> f64,
) -> CrossingFit {
    let law = DriftLaw::for_crossings(&SensorChoice::Voltmeter(world.sensor.clone())).unwrap();
    let last = frames[FRAMES - 1].t_us;
    let moved = world.events.iter().map(|event| {
        #[expect(clippy::cast_possible_truncation, reason = "times of a small world")]
        let t = Timestamp((1e3 * time(event.t.0 as f64 * 1e-3)) as i64);
        Event { t, ..*event }
    });
    let mut events: Vec<Event> = moved.filter(|e| (0..=last).contains(&e.t.floor_micros())).collect();
    events.sort_by_key(|event| event.t);
    let mut rest = events.as_slice();
    let mut observer = CrossingObserver::of_lines(law, frames[0].clone(), last, apart);
    for frame in &frames[1..] {
        observer.take_frame(frame.clone());
        let due;
        (due, rest) = rest.split_at(rest.partition_point(|event| event.t.floor_micros() <= frame.t_us));
        observer.see(due);
    }
    observer.finish().unwrap().found
}

#[test]
fn clocks_of_unequal_and_noisy_pixels_are_measured() {
    for setting in settings() {
        let world = PlantedWorld::new(setting);
        let frames = rounded_frames(&world, setting);
        let sound = clock_of(&world, &frames, |t| t);
        println!("{} px per frame, {:?}: {sound:?}", setting.pace, setting.floor_hz);
        // Four standard errors, and the truncated microsecond.
        assert!(sound.offset_us.value.abs() < 0.5 + 4.0 * sound.offset_us.deviation, "{sound:?}");
        assert!(sound.scale.value.abs() < 1e-5 + 4.0 * sound.scale.deviation, "{sound:?}");
        // A step is 417 us. The larger a fault is, the more events meet the rate of another step.
        for (d, within) in [(-20.0, 3.0), (50.0, 10.0)] {
            let found = clock_of(&world, &frames, |t| t + d).offset_us.value - sound.offset_us.value;
            assert!((found - d).abs() < within, "{d} us: {found}");
        }
        for (scale, within) in [(0.99, 0.005), (1.001, 2e-4)] {
            let found = clock_of(&world, &frames, |t| scale * t).scale.value - sound.scale.value;
            assert!((found - (scale - 1.0)).abs() < within, "{scale}: {found}");
        }
    }
}

/// Noise of an EVK4, a fifth of a threshold: all pairs are used, and the bias is within what is expected.
#[test]
fn noise_that_returns_biases_a_clock_as_expected() {
    use gs2e_sensor::voltmeter::InitialVoltage::Stationary;
    for pace in [0.1, 0.3, 0.8] {
        let receptor = 0.2 / 5.265;
        let initial = Stationary;
        let setting = WorldSettings {
            spread: 0.043,
            contrast: 0.8,
            pace,
            receptor,
            initial,
            ..WorldSettings::default()
        };
        let world = PlantedWorld::new(setting);
        let frames = rounded_frames(&world, setting);
        let sound = clock_of(&world, &frames, |t| t);
        println!("{pace} px per frame, {} events: {sound:?}", world.events.len());
        assert!(3 * sound.events > world.events.len() as u64, "{sound:?}");
        // Four standard errors, and the truncated microsecond.
        let within = |i: usize, bar: ErrorBar, least: f64| {
            bar.value.abs() < least + sound.biases[i] + 4.0 * bar.deviation
        };
        assert!(within(0, sound.offset_us, 0.5) && within(1, sound.scale, 1e-5), "{sound:?}");
        let found = clock_of(&world, &frames, |t| t - 50.0).offset_us.value - sound.offset_us.value;
        // Noise decides which pairs are beyond the bound, so that the errors of both are not the same.
        assert!((found + 50.0).abs() < 8.0 + 3.0 * sound.offset_us.deviation, "{pace}: {found}");
    }
}

/// Some of the lines show the same clock, with a larger error.
#[test]
fn some_lines_of_the_picture_show_the_clock() {
    let setting = settings().next().unwrap();
    let world = PlantedWorld::new(setting);
    let frames = rounded_frames(&world, setting);
    let all = clock_of(&world, &frames, |t| t + 50.0);
    let some = clock_of_lines(&world, &frames, 3, |t| t + 50.0);
    println!("all {all:?}, some {some:?}");
    assert!((0.2..0.5).contains(&(some.events as f64 / all.events as f64)));
    // The standard error grows with the root of 3, and varies by a third with its 64 blocks or fewer.
    let growth = some.offset_us.deviation / all.offset_us.deviation;
    assert!((1.0..3.0).contains(&growth), "{growth}");
    // A third of the events is in both.
    let apart = (some.offset_us.value - all.offset_us.value).abs();
    assert!(apart < 4.0 * some.offset_us.deviation, "{apart}");
}

#[test]
fn long_streams_are_compared_on_some_lines() {
    let size = |height| Size { width: 640, height };
    for (events, height, apart) in [
        (0, 360, 1),
        (1 << 20, 360, 1),
        (10 << 20, 360, 10),
        (1 << 40, 360, 11),
        (1 << 40, 48, 1),
        (1 << 40, 8, 1),
    ] {
        assert_eq!(lines_apart(events, size(height)), apart, "{events} events, {height} lines");
    }
}

/// Without the means of each pixel, those of low thresholds make the events look early.
#[test]
fn levels_of_unequal_pixels_are_biased() {
    let setting = settings().next().unwrap();
    let mut world = PlantedWorld::new(setting);
    let frames = rounded_frames(&world, setting);
    let pairs = clock_of(&world, &frames, |t| t).offset_us;
    world.sensor.threshold_spread = 0.0;
    let levels = clock_of(&world, &frames, |t| t).offset_us;
    println!("pairs {pairs:?}, levels {levels:?}");
    assert!(levels.value < -5.0 * pairs.value.abs() && levels.value < -4.0 * levels.deviation);
}
