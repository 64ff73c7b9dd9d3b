//! How much memory a step takes: what the estimate says, and no more for a longer sequence.

use crate::support::steps::{recipe, steps};
use crate::support::workspace::Workspace;
use serde_json::{Value, json};
use std::process::{Command, Stdio};
use wait4::Wait4 as _;

/// The largest resident memory of a build that makes nothing but `output` of one trajectory, bytes, and its estimate.
fn peak(output: &str, gaussians: u32, [width, height]: [u32; 2], factor: u32) -> (f64, f64) {
    let place = Workspace::new();
    let mut value = recipe("tiny");
    value["source"] = json!({ "procedural": { "gaussians": gaussians, "views": 6, "arc": 0.5 } });
    value["camera"] = json!({ "width": width, "height": height });
    value["trajectories"][0]["refine"]["factor"] = json!(factor);
    // The first build takes away what is not asked after: making the scene, and every other step but the checks.
    value["outputs"] = json!([]);
    place.write("tiny.yaml", value.to_string());
    place.ok("build tiny.yaml");
    value["outputs"] = json!([output]);
    place.write("tiny.yaml", value.to_string());
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.args(["build", "-q", "-j", "1", "tiny.yaml"]).current_dir(place.path("")).stdout(Stdio::null());
    let used = command.spawn().unwrap().wait4().unwrap();
    assert!(used.status.success());
    let key = steps(&place, "tiny.yaml")[&format!("tiny/base/{output}")].key.clone().unwrap();
    let record = std::fs::read(place.path(&format!(".gs2e/ac/{}/{key}.json", &key[..2]))).unwrap();
    let record: Value = serde_json::from_slice(&record).unwrap();
    (used.rusage.maxrss as f64, record["provenance"]["memory"].as_f64().unwrap())
}

/// Frames are never all in memory, events never at all.
#[test]
fn a_longer_sequence_takes_no_more() {
    let (short, _) = peak("events", 4096, [346, 260], 1);
    let (long, _) = peak("events", 4096, [346, 260], 16);
    assert!((long / short - 1.0).abs() < 0.05, "{short} bytes for N frames, {long} for 16 N");
    assert!(long < 256e6, "{long}");
}

/// The budget of a run is only as good as the estimate: within a quarter, for three sizes of scene and picture.
#[test]
fn a_step_takes_what_its_estimate_says() {
    for (output, gaussians, size) in [
        ("events", 4_096, [346, 260]),
        ("events", 100_000, [320, 180]),
        ("events", 20_000, [1280, 720]),
        ("sharp", 20_000, [1280, 720]),
    ] {
        let (found, estimate) = peak(output, gaussians, size, 1);
        let ratio = found / estimate;
        eprintln!(
            "{output}, {gaussians} Gaussians, {size:?}: {:.1} MB, estimate {:.1} MB",
            found * 1e-6,
            estimate * 1e-6
        );
        assert!(
            (0.75..1.25).contains(&ratio),
            "{output}, {gaussians}, {size:?}: {found} bytes, estimate {estimate}"
        );
    }
}
