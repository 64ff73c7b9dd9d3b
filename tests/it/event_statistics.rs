//! Events against statistics that other programs measured, and against closed forms.

use gs2e::event::{Event, Polarity};
use gs2e::frames::array::{ArrayFrames, Samples};
use gs2e::image::Size;
use gs2e::seed::Seed;
use gs2e::sensor::voltmeter::{Gain, Preset, Voltmeter};
use gs2e::sensor::{Account, simulate};
use std::fs::File;
use std::ops::ControlFlow;
use std::path::PathBuf;

fn goldens() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/golden/events");
    if !folder.exists() {
        eprintln!("not run: ../shared is absent");
        return None;
    }
    Some(folder)
}

fn npy<T: npyz::Deserialize>(path: PathBuf) -> Vec<T> {
    npyz::NpyFile::new(File::open(path).unwrap()).unwrap().into_vec().unwrap()
}

fn run(sensor: &Voltmeter, frames: &ArrayFrames, seed: u64) -> (Vec<Event>, Account) {
    let mut events = Vec::new();
    let mut frames = frames.clone();
    let account =
        simulate(&mut frames, sensor, Seed(seed), &mut events, &mut |_| ControlFlow::Continue(())).unwrap();
    (events, account)
}

#[test]
fn golden_counts() {
    let Some(folder) = goldens() else { return };
    for clip in ["edge", "grating"] {
        let samples = Samples::Bytes(npy(folder.join(format!("{clip}_frames.npy"))));
        let stamps: Vec<i64> = npy(folder.join(format!("{clip}_ts_us.npy")));
        let frames = ArrayFrames::new(Size { width: 64, height: 48 }, samples, &stamps).unwrap();
        for preset in [Preset::Dvs346, Preset::Gs2eSi] {
            for gain in [Gain::Midpoint, Gain::Log] {
                let sensor = Voltmeter { gain, ..Voltmeter::new(preset.k()) };
                let t = std::time::Instant::now();
                let mut on = Vec::new();
                let mut off = Vec::new();
                let mut worst: f64 = 0.0;
                let mut last = Account::default();
                for seed in 0..24 {
                    let (events, account) = run(&sensor, &frames, seed);
                    assert_eq!(events.len() as u64, account.events);
                    assert_eq!(
                        events.iter().filter(|e| e.polarity == Polarity::On).count() as u64,
                        account.on
                    );
                    assert!(events.is_sorted_by_key(Event::file_order));
                    on.push(account.on as f64);
                    off.push(account.off as f64);
                    worst = worst.max(account.drift_worst);
                    last = account;
                }
                let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
                let sd = |v: &[f64]| {
                    (v.iter().map(|x| (x - mean(v)).powi(2)).sum::<f64>() / (v.len() as f64 - 1.0)).sqrt()
                };
                println!(
                    "{clip} {} {gain:?}: on {:.1} sd {:.1} off {:.1} sd {:.1} worst {worst:.3} {last:?} {:?}",
                    preset.name(),
                    mean(&on),
                    sd(&on),
                    mean(&off),
                    sd(&off),
                    t.elapsed()
                );
            }
        }
    }
}
