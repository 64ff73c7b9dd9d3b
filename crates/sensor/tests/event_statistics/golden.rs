//! The golden sequences of `tests/golden/events`: statistics by other implementations of the exact
//! law and of the published one.

use super::{by_pixel, mean_and_deviation, run};
use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_sensor::SimulationAccount;
use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
use gs2e_sensor::voltmeter::{DriftGain, SamplerKind, VoltmeterModel, VoltmeterPreset};
use gs2e_testing::golden;
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const SIZE: Size = Size { width: 64, height: 48 };
const SEEDS: u64 = 24;

/// The events of one seed.
type Run = (Vec<Event>, SimulationAccount);

/// A clip and its known figures under one parameter set.
struct Golden {
    frames: ArrayFrames,
    greys: Vec<u8>,
    stamps: Vec<i64>,
    k: [f64; 6],
    drift: Vec<f64>,
    per_frame: [Vec<f32>; 2],
    figures: Value,
}

fn npy<T: npyz::Deserialize>(reader: impl Read) -> Vec<T> {
    npyz::NpyFile::new(reader).unwrap().into_vec().unwrap()
}

fn npz<T: npyz::Deserialize>(path: &Path, name: &str) -> Vec<T> {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let array = archive.by_name(&format!("{name}.npy")).unwrap();
    npyz::NpyFile::new(array).unwrap().into_vec().unwrap()
}

impl Golden {
    fn read(folder: &Path, clip: &str, preset: VoltmeterPreset, law: SamplerKind) -> Self {
        let open = |file: String| File::open(folder.join(file)).unwrap();
        let greys: Vec<u8> = npy(open(format!("{clip}_frames.npy")));
        let stamps: Vec<i64> = npy(open(format!("{clip}_ts_us.npy")));
        let set = preset.name().trim_end_matches("-paper").replace('-', "_");
        let all: Value = serde_json::from_reader(open("golden.json".to_owned())).unwrap();
        let k = &all["params_official_units(us,grey0-255)"][&set];
        let law = match law {
            SamplerKind::Exact => "exact",
            SamplerKind::Official => "official",
        };
        let measured = folder.join(format!("{clip}_{set}_{law}.npz"));
        Self {
            frames: ArrayFrames::new(SIZE, ArraySamples::Bytes(greys.clone()), &stamps).unwrap(),
            greys,
            stamps,
            k: std::array::from_fn(|i| k[i].as_f64().unwrap()),
            drift: npz(&folder.join(format!("{clip}_{set}_drift.npz")), "drift_integral"),
            per_frame: ["per_frame_mean", "per_frame_std"].map(|name| npz(&measured, name)),
            figures: all["sequences"][clip]["results"][format!("{set}/{law}")].clone(),
        }
    }

    fn figure(&self, name: &str) -> f64 {
        self.figures[name].as_f64().unwrap()
    }

    /// Variance of a pixel's noise over the clip, by the midpoint form of the README.
    fn noise(&self, pixel: usize) -> f64 {
        let n = SIZE.pixels();
        let [_, k2, k3, _, _, k6] = self.k;
        let interval = |j: usize| {
            let grey = |frame: usize| f64::from(self.greys[frame * n + pixel]);
            let l = 0.5 * (grey(j) + grey(j + 1));
            (k3 * l.sqrt() / (l + k2) + k6).powi(2) * (self.stamps[j + 1] - self.stamps[j]) as f64
        };
        (0..self.stamps.len() - 1).map(interval).sum()
    }

    /// Checks the drift identity of one run, for every pixel.
    fn check_drift(&self, events: &[Event]) {
        for (pixel, events) in by_pixel(SIZE, events).into_iter().enumerate() {
            let on = events.iter().filter(|event| event.1 == Polarity::On).count() as f64;
            let net = 2.0 * on - events.len() as f64;
            let bound = 1.0 + 6.0 * self.noise(pixel).sqrt();
            assert!(
                (net - self.drift[pixel]).abs() <= bound,
                "pixel {pixel}: {net} against {}",
                self.drift[pixel]
            );
        }
    }
}

/// Checks that the means of two samples of 24 agree within 4.5 standard errors or within 0.1 %.
fn agree(name: &str, [mean, deviation]: [f64; 2], [wanted, wanted_deviation]: [f64; 2]) {
    let error = ((deviation.powi(2) + wanted_deviation.powi(2)) / SEEDS as f64).sqrt();
    let difference = mean - wanted;
    println!("  {name}: {mean:.2}, wanted {wanted:.2}, z {:.2}", difference / error.max(1e-9));
    assert!(
        difference.abs() <= (4.5 * error).max(1e-3 * wanted),
        "{name}: {mean} is not {wanted} +- {error}"
    );
}

/// Counts in the interval that ends at each frame. An event at a stamp belongs to the interval
/// before it.
fn per_frame(events: &[Event], stamps: &[i64]) -> Vec<f64> {
    let mut counts = vec![0.0; stamps.len() - 1];
    for event in events {
        counts[stamps.partition_point(|&stamp| stamp * 1000 < event.t.0) - 1] += 1.0;
    }
    counts
}

/// Times between consecutive events of a pixel in us, over all pixels.
fn intervals(events: &[Event]) -> Vec<f64> {
    let pixels = by_pixel(SIZE, events);
    pixels.iter().flat_map(|events| events.windows(2).map(|w| (w[1].0 - w[0].0) as f64 * 1e-3)).collect()
}

fn check(clip: &str, preset: VoltmeterPreset, law: SamplerKind) {
    let golden = Golden::read(&golden::folder("events"), clip, preset, law);
    let sensor = VoltmeterModel { gain: DriftGain::Midpoint, law, ..VoltmeterModel::new(golden.k) };
    let runs: Vec<(Vec<Event>, SimulationAccount)> =
        (0..SEEDS).map(|seed| run(&sensor, &golden.frames, seed)).collect();
    println!("{clip}, {}, {law:?}, {SEEDS} seeds:", preset.name());
    let over = |value: fn(&Run) -> f64| mean_and_deviation(&runs.iter().map(value).collect::<Vec<f64>>());
    let golden_of = |polarity: &str| ["mean", "std"].map(|what| golden.figure(&format!("{polarity}_{what}")));
    agree("ON", over(|run| run.1.on as f64), golden_of("on"));
    agree("OFF", over(|run| run.1.off as f64), golden_of("off"));
    for (events, account) in &runs {
        assert!(events.is_sorted_by_key(Event::file_order));
        assert_eq!((events.len() as u64, account.drift_violations), (account.events, 0));
        // The published law draws the rest of a frame again, so its events and its drift disagree.
        if law == SamplerKind::Exact {
            golden.check_drift(events);
        }
    }
    check_times(&golden, &runs);
}

/// Checks the times of events: per frame, on average, and between neighbours.
fn check_times(golden: &Golden, runs: &[Run]) {
    let counts: Vec<Vec<f64>> = runs.iter().map(|run| per_frame(&run.0, &golden.stamps)).collect();
    for frame in 0..golden.stamps.len() - 1 {
        let found = mean_and_deviation(&counts.iter().map(|counts| counts[frame]).collect::<Vec<f64>>());
        let wanted = golden.per_frame.each_ref().map(|figures| f64::from(figures[frame]));
        agree(&format!("frame {}", frame + 1), found, wanted);
    }
    let duration = golden.stamps[golden.stamps.len() - 1] as f64 * 1e3;
    let times: Vec<f64> =
        runs.iter().flat_map(|run| run.0.iter().map(|event| event.t.0 as f64 / duration)).collect();
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    let wanted = golden.figure("mean_norm_time");
    println!("  mean time {mean:.5}, wanted {wanted:.5}");
    // Most of an event's time is determined by the clip: its spread over the seeds is far below the
    // spread of single events, 0.3.
    assert!((mean - wanted).abs() < 0.3 / (times.len() as f64).sqrt());
    let mut intervals: Vec<f64> = runs.iter().flat_map(|run| intervals(&run.0)).collect();
    intervals.sort_unstable_by(f64::total_cmp);
    let Some(quantiles) = golden.figures["iei_quantiles_us"].as_object() else {
        return assert!(intervals.len() < 20 * runs.len(), "{} intervals", intervals.len());
    };
    for (share, wanted) in quantiles {
        let at = (share.parse::<f64>().unwrap() * (intervals.len() - 1) as f64).round() as usize;
        let (found, wanted) = (intervals[at], wanted.as_f64().unwrap());
        println!("  interval quantile {share}: {found:.1} us, wanted {wanted:.1}");
        assert!((found - wanted).abs() <= 0.03 * wanted);
    }
}

#[test]
fn edge_of_dvs346() {
    check("edge", VoltmeterPreset::Dvs346, SamplerKind::Exact);
}

#[test]
fn edge_of_gs2e_si() {
    check("edge", VoltmeterPreset::Gs2eSi, SamplerKind::Exact);
}

#[test]
fn grating_of_dvs346() {
    check("grating", VoltmeterPreset::Dvs346, SamplerKind::Exact);
}

#[test]
fn grating_of_gs2e_si() {
    check("grating", VoltmeterPreset::Gs2eSi, SamplerKind::Exact);
}

#[test]
fn edge_of_dvs346_by_the_published_law() {
    check("edge", VoltmeterPreset::Dvs346, SamplerKind::Official);
}

#[test]
fn edge_of_gs2e_si_by_the_published_law() {
    check("edge", VoltmeterPreset::Gs2eSi, SamplerKind::Official);
}

#[test]
fn grating_of_dvs346_by_the_published_law() {
    check("grating", VoltmeterPreset::Dvs346, SamplerKind::Official);
}

#[test]
fn grating_of_gs2e_si_by_the_published_law() {
    check("grating", VoltmeterPreset::Gs2eSi, SamplerKind::Official);
}
