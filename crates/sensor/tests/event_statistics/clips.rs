//! Clips made from formulas, and their event counts under both laws, as other programs measured
//! them (docs/evidence.md, "clip counts").

use super::{frames, run};
use gs2e_image::Size;
use gs2e_sensor::SimulationAccount;
use gs2e_sensor::frames::array::ArrayFrames;
use gs2e_sensor::voltmeter::{SamplerKind, VoltmeterModel, VoltmeterPreset};
use std::f64::consts::TAU;

/// A clip's size, number of frames, and grey by column, row and frame.
struct Clip {
    size: Size,
    frames: i64,
    grey: fn(f64, f64, f64) -> f64,
}

/// A soft edge that moves 0.5 px per frame.
const EDGE: Clip = Clip {
    size: Size { width: 64, height: 48 },
    frames: 49,
    grey: |x, y, i| {
        let position = 10.0 + 1200.0 * i / 2400.0 + 0.15 * (y - 24.0);
        8.0 + 232.0 / (1.0 + ((x - position) / 0.8).exp())
    },
};

/// Three cycles across the width, which pass at 100 Hz.
const GRATING: Clip = Clip {
    size: Size { width: 64, height: 48 },
    frames: 49,
    grey: |x, _, i| 131.0 + 119.0 * (TAU * (3.0 * x / 64.0 - 100.0 * i / 2400.0)).sin(),
};

/// Means of 4 to 130 over the columns, modulated by 0.9 at 120 Hz.
const FLICKER: Clip = Clip {
    size: Size { width: 64, height: 32 },
    frames: 61,
    grey: |x, _, i| (4.0 + 126.0 * x / 63.0) * (1.0 + 0.9 * (TAU * 120.0 * i / 2400.0).sin()),
};

impl Clip {
    /// Frames at 2400 Hz, in whole greys and microseconds.
    fn frames(&self) -> ArrayFrames {
        let stamp = |i: i64| (i as f64 * 1e6 / 2400.0).round() as i64;
        let stamps: Vec<i64> = (0..self.frames).map(stamp).collect();
        let index = |t: i64| (t as f64 * 2400e-6).round();
        frames(self.size, &stamps, |x, y, t| {
            (self.grey)(f64::from(x), f64::from(y), index(t)).round().clamp(0.0, 255.0)
        })
    }
}

/// Compares the means of 6 seeds with a row of the table, whose own means are of at least 6.
/// `deviation` is the deviation of one seed's count: at most 6 in dvs346, 40 in gs2e-si.
fn check(clip: &Clip, sensor: &VoltmeterModel, wanted: [f64; 2], deviation: f64) {
    const SEEDS: u64 = 6;
    let frames = clip.frames();
    let runs: Vec<SimulationAccount> = (0..SEEDS).map(|seed| run(sensor, &frames, seed).1).collect();
    let mean = |count: fn(&SimulationAccount) -> u64| {
        runs.iter().map(|run| count(run) as f64).sum::<f64>() / SEEDS as f64
    };
    let found = [mean(|run| run.on), mean(|run| run.off)];
    println!("{:?}: {found:.1?}, wanted {wanted:?}", sensor.law);
    let error = deviation * (2.0 / SEEDS as f64).sqrt();
    for (found, wanted) in found.into_iter().zip(wanted) {
        let tolerance = (4.5 * error).max(1e-3 * wanted);
        assert!((found - wanted).abs() <= tolerance, "{found} is not {wanted} +- {error}");
    }
}

#[test]
fn counts_with_the_log_gain() {
    let t = |clip: &Clip, preset: VoltmeterPreset, wanted, deviation| {
        check(clip, &VoltmeterModel::new(preset.k()), wanted, deviation);
    };
    t(&EDGE, VoltmeterPreset::Dvs346, [12_619.7, 0.0], 2.0);
    t(&GRATING, VoltmeterPreset::Dvs346, [62_866.0, 61_714.0], 6.0);
    t(&FLICKER, VoltmeterPreset::Dvs346, [43_727.0, 43_759.0], 6.0);
    t(&GRATING, VoltmeterPreset::Gs2eSi, [4_189.0, 4_535.0], 40.0);
}

#[test]
fn counts_of_the_published_law() {
    let t = |clip: &Clip, preset: VoltmeterPreset, wanted, deviation| {
        let sensor = VoltmeterModel { law: SamplerKind::Official, ..VoltmeterModel::new(preset.k()) };
        check(clip, &sensor, wanted, deviation);
    };
    t(&EDGE, VoltmeterPreset::Dvs346, [12_598.6, 0.0], 2.0);
    t(&GRATING, VoltmeterPreset::Dvs346, [62_498.5, 61_346.5], 6.0);
    t(&FLICKER, VoltmeterPreset::Dvs346, [43_514.1, 43_523.3], 6.0);
    t(&GRATING, VoltmeterPreset::Gs2eSi, [4_261.0, 4_565.0], 40.0);
}
