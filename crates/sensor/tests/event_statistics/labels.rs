//! Labels compared with known brightness: constant, without noise, or with a known share of noise.

use super::identity::{models, moving};
use super::{frames, run};
use gs2e_event::{Event, EventLabel, Polarity};
use gs2e_image::Size;
use gs2e_sensor::esim::EsimModel;
use gs2e_sensor::frames::array::ArrayFrames;
use gs2e_sensor::noise::{HotPixelNoise, ReferenceRule, RefractoryPeriod, ThresholdMismatch};
use gs2e_sensor::v2e::{LeakNoise, V2eModel};
use gs2e_sensor::voltmeter::{BetweenFrames, InitialVoltage, SamplerKind, VoltmeterModel};
use gs2e_sensor::{SensorChoice, SensorModel, SensorSettings, v2e};

const SIZE: Size = Size { width: 40, height: 25 };

/// Runs a sensor and returns its events, which must all have this label.
fn all(sensor: &dyn SensorModel, clip: &ArrayFrames, label: EventLabel) -> Vec<Event> {
    let (events, _) = run(sensor, clip, 3);
    let other = events.iter().find(|event| event.label != label);
    assert_eq!(other, None, "of {} events", events.len());
    events
}

fn voltmeter(k: [f64; 6]) -> VoltmeterModel {
    VoltmeterModel {
        settings: SensorSettings { labels: true, ..SensorSettings::default() },
        ..VoltmeterModel::new(k)
    }
}

/// v2e without noise, with thresholds of a tenth.
fn clean() -> V2eModel {
    let threshold = ThresholdMismatch { on: 0.1, off: 0.1, spread: 0.0 };
    V2eModel {
        threshold,
        settings: SensorSettings { labels: true, ..V2eModel::from(v2e::V2ePreset::Clean).settings },
        ..V2eModel::from(v2e::V2ePreset::Clean)
    }
}

#[test]
fn without_noise_all_is_signal() {
    let clip = moving(SIZE);
    let exact = VoltmeterModel { threshold_spread: 0.1, ..voltmeter([5.0, 16.0, 0.0, 0.0, 0.0, 0.0]) };
    let refractory = RefractoryPeriod { period_us: 500.0, reference: ReferenceRule::AtEvent };
    let threshold = ThresholdMismatch { on: 0.1, off: 0.15, spread: 0.02 };
    let sensors = [
        SensorChoice::Voltmeter(VoltmeterModel { between: BetweenFrames::Catmull, ..exact.clone() }),
        SensorChoice::Voltmeter(VoltmeterModel { law: SamplerKind::Official, ..exact.clone() }),
        SensorChoice::Voltmeter(exact),
        SensorChoice::Esim(EsimModel {
            threshold,
            settings: SensorSettings { labels: true, ..SensorSettings::default() },
            ..EsimModel::default()
        }),
        SensorChoice::Esim(EsimModel {
            threshold,
            settings: SensorSettings { refractory, labels: true, ..SensorSettings::default() },
            ..EsimModel::default()
        }),
        SensorChoice::V2e(V2eModel { cutoff: 0.0, ..clean() }),
        SensorChoice::V2e(V2eModel {
            cutoff: 100.0,
            settings: SensorSettings { refractory, ..clean().settings },
            ..clean()
        }),
    ];
    for sensor in sensors {
        let count = all(sensor.as_model(), &clip, EventLabel::Signal).len();
        assert!(count > 1000, "{count} of {sensor:?}");
    }
}

/// Before a step of 42 thresholds the cubic swings back: between frames of one grey it falls by
/// 4/27 of half the step, three thresholds, and returns. A cubic with a given rise of 21 thresholds
/// per interval at its end does the same. A straight line would label all of that as noise.
#[test]
fn brightness_between_frames_is_that_of_the_law() {
    let step = frames(SIZE, &[0, 1000, 2000, 3000], |_, _, t| if t < 1500 { 0.0 } else { 240.0 });
    // 116 greys with the offset, in ms: 15 times the logarithm's slope is 21.
    let rate = |i| if i < SIZE.pixels() { 0.0 } else { 21.0 / 15.0 * 116.0 * 1e3 };
    let flat = frames(SIZE, &[0, 1000], |_, _, _| 100.0);
    let flat = flat.with_rates((0..2 * SIZE.pixels()).map(rate).collect()).unwrap();
    for (between, clip) in [(BetweenFrames::Catmull, step), (BetweenFrames::Hermite, flat)] {
        let sensor = VoltmeterModel { between, ..voltmeter([15.0, 16.0, 0.0, 0.0, 0.0, 0.0]) };
        let events = all(&sensor, &clip, EventLabel::Signal);
        let swing = events.iter().filter(|event| event.t.0 < 900_000);
        let (on, off): (Vec<&Event>, Vec<&Event>) = swing.partition(|event| event.polarity == Polarity::On);
        // The cubic falls to -3.08 or -3.11. After nine tenths it is at -1.7, and has passed -2
        // again.
        assert_eq!((off.len(), on.len()), (3 * SIZE.pixels(), SIZE.pixels()), "{between:?}");
    }
}

#[test]
fn without_a_change_all_is_noise() {
    let clip = frames(SIZE, &[0, 50_000, 100_000], |x, y, _| f64::from(5 * x + y));
    let hot_pixels = HotPixelNoise { share: 0.1, rate: 900.0, ..HotPixelNoise::default() };
    let noisy = VoltmeterModel {
        settings: SensorSettings { hot_pixels, ..voltmeter([5.0, 16.0, 2e-2, 1e-5, 1e-7, 4e-3]).settings },
        ..voltmeter([5.0, 16.0, 2e-2, 1e-5, 1e-7, 4e-3])
    };
    let (leak, refractory) = (
        LeakNoise { rate: 300.0, jitter: 0.2, cov: 0.2 },
        // Several thresholds leak away during a dead time.
        RefractoryPeriod { period_us: 12_000.0, reference: ReferenceRule::AtEvent },
    );
    let v2e = V2eModel {
        leak,
        shot: 300.0,
        cutoff: 100.0,
        settings: SensorSettings { hot_pixels, ..clean().settings },
        ..clean()
    };
    let sensors = [
        SensorChoice::Voltmeter(VoltmeterModel { law: SamplerKind::Official, ..noisy.clone() }),
        SensorChoice::Voltmeter(VoltmeterModel { initial: InitialVoltage::Stationary, ..noisy.clone() }),
        SensorChoice::Voltmeter(VoltmeterModel {
            settings: SensorSettings { hot_pixels: HotPixelNoise::default(), ..noisy.settings },
            ..noisy
        }),
        SensorChoice::Esim(EsimModel {
            settings: SensorSettings { hot_pixels, labels: true, ..SensorSettings::default() },
            ..EsimModel::default()
        }),
        SensorChoice::V2e(V2eModel {
            settings: SensorSettings { refractory, ..v2e.settings },
            ..v2e.clone()
        }),
        SensorChoice::V2e(V2eModel {
            shot: 0.0,
            settings: SensorSettings { refractory, hot_pixels: HotPixelNoise::default(), ..v2e.settings },
            ..v2e.clone()
        }),
        SensorChoice::V2e(v2e),
    ];
    for sensor in sensors {
        let count = all(sensor.as_model(), &clip, EventLabel::Noise).len();
        assert!(count > 1000, "{count} of {sensor:?}");
    }
}

/// `P(T <= t)` for the first passage of a Brownian motion with drift 1 and variance `v` through 1:
/// the inverse Gaussian law.
fn passed_by(t: f64, v: f64) -> f64 {
    let normal = |x: f64| 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    let root = (v * t).sqrt();
    normal((t - 1.0) / root) + (2.0 / v).exp() * normal(-(t + 1.0) / root)
}

/// The left half does not move. In the right half the logarithm rises evenly, by 40 thresholds, and
/// the voltage has noise of variance 0.15 per threshold's time. Brightness has gone half of the way
/// when half of that time has passed since the previous event, so the share of noise is the share
/// of shorter first passages. OFF events, one in exp(2/0.15), are neglected.
#[test]
fn half_of_the_way_separates_signal_from_noise() {
    let (end, variance) = (80_000, 0.15);
    let k6 = (variance * 40.0 / f64::from(end)).sqrt();
    let sensor = voltmeter([40.0 / 16f64.ln(), 16.0, 0.0, 0.0, 0.0, k6]);
    let octaves = |t: i64| 16.0 * (4.0 * t as f64 / f64::from(end)).exp2() - 16.0;
    let stamps = [0, 20_000, 40_000, 60_000, i64::from(end)];
    let grey = |x: u32, _: u32, t: i64| if x < SIZE.width / 2 { 100.0 } else { octaves(t) };
    let (events, _) = run(&sensor, &frames(SIZE, &stamps, grey), 11);
    let (left, right): (Vec<Event>, Vec<Event>) =
        events.into_iter().partition(|event| u32::from(event.x) < SIZE.width / 2);
    assert!(left.len() > 1000 && left.iter().all(|event| event.label == EventLabel::Noise), "{}", left.len());
    // Only the first 20 of each pixel: near the end of a pixel's time, early events are too
    // frequent.
    let mut seen = vec![0; SIZE.pixels()];
    let (mut count, mut noise) = (0, 0);
    for event in right {
        let seen = &mut seen[usize::from(event.y) * SIZE.width as usize + usize::from(event.x)];
        *seen += 1;
        if *seen <= 20 {
            count += 1;
            noise += u32::from(event.label == EventLabel::Noise);
        }
    }
    assert_eq!(count, 20 * SIZE.pixels() / 2);
    let share = f64::from(noise) / count as f64;
    let wanted = passed_by(0.5, variance);
    let z = (share - wanted) / (wanted * (1.0 - wanted) / count as f64).sqrt();
    let defect = (share - passed_by(0.45, variance)) / (wanted * (1.0 - wanted) / count as f64).sqrt();
    println!("noise {share:.4} of {count}, wanted {wanted:.4}: z {z:.2}, of 0.45 for a half {defect:.1}");
    assert!(z.abs() < 4.5 && defect.abs() > 4.5);
}

/// Brightness rises by 95 thresholds per second, with a leak of fewer or of more: each event has
/// the same share of both. A leak against falling brightness contributes nothing to its events.
#[test]
fn a_leak_is_weighed_against_brightness() {
    let ramp = |way: f64| {
        frames(SIZE, &[0, 30_000, 100_000], move |_, _, t| 100.0 * (way * (t as f64 * 1e-5)).exp())
    };
    let [up, down] = [0.95, -0.95].map(ramp);
    for (rate, label) in [
        (0.0, EventLabel::Signal),
        (60.0, EventLabel::Signal),
        (80.0, EventLabel::Signal),
        (100.0, EventLabel::Noise),
    ] {
        let leaky = V2eModel { leak: LeakNoise { rate, jitter: 0.0, cov: 0.0 }, cutoff: 0.0, ..clean() };
        let events = all(&leaky, &up, label);
        let falling = all(&leaky, &down, EventLabel::Signal);
        // Counts in a tenth of a second.
        for (events, thresholds, polarity) in
            [(events, 9.5 + 0.1 * rate, Polarity::On), (falling, 9.5 - 0.1 * rate, Polarity::Off)]
        {
            assert_eq!(events.len(), thresholds as usize * SIZE.pixels(), "leak {rate}");
            assert!(events.iter().all(|event| event.polarity == polarity));
        }
    }
}

fn without_labels(sensor: &SensorChoice) -> SensorChoice {
    sensor.clone().with_settings(SensorSettings { labels: false, ..sensor.settings() })
}

#[test]
fn labels_change_no_event() {
    let clip = moving(SIZE);
    for sensor in models() {
        let (labelled, account) = run(sensor.as_model(), &clip, 3);
        let plain = all(without_labels(&sensor).as_model(), &clip, EventLabel::Signal);
        let stripped: Vec<Event> =
            labelled.iter().map(|e| Event { label: EventLabel::Signal, ..*e }).collect();
        assert!(stripped == plain, "{sensor:?}");
        assert_eq!(account, run(without_labels(&sensor).as_model(), &clip, 3).1);
        let noise = labelled.iter().filter(|event| event.label == EventLabel::Noise).count();
        assert!(noise > 0 && noise < labelled.len(), "{noise} of {} in {sensor:?}", labelled.len());
    }
}
