//! `gs2e doctor`: the machine as the program sees it, and a trial of its renderers.

use crate::support::workspace::Workspace;
use serde_json::Value;

#[test]
fn the_machine_is_described_without_writing_anything() {
    let place = Workspace::new();
    let said = place.ok("doctor --no-trial").stdout;
    for label in ["gs2e", "processor", "memory", "store", "disk", "CPU renderer", "used by default", "ffmpeg"]
    {
        assert!(said.lines().any(|line| line.starts_with(label)), "{label}\n{said}");
    }
    assert!(said.contains(".gs2e, not there yet"), "{said}");
    let value: Value = serde_json::from_str(&place.ok("doctor --no-trial --json").stdout).unwrap();
    assert!(value["cores"].as_u64().unwrap() >= 1, "{value}");
    assert!(value["disk_free"].as_u64().is_some() && value["gpus"].is_array(), "{value}");
    assert_eq!(value["version"], env!("CARGO_PKG_VERSION"));
    // A program that is not there has no version.
    assert!(value["programs"].as_object().unwrap().contains_key("colmap"), "{value}");
    assert!(!place.path(".gs2e").exists());
}

#[test]
fn each_renderer_is_tried_and_compared_with_the_cpu() {
    let place = Workspace::new();
    let output = place.command_with_gpu("doctor --json").output().unwrap();
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(value["cpu_trial"].as_str().unwrap().contains("frames/s"), "{value}");
    for gpu in value["gpus"].as_array().unwrap() {
        let trial = gpu["trial"].as_str().unwrap();
        // Renderings of one scene by two renderers of one arithmetic are far closer than that.
        let db = trial.split(", ").find_map(|part| part.strip_suffix(" dB to the CPU")?.parse::<f64>().ok());
        assert!(db.is_some_and(|db| db > 60.0), "{gpu}");
    }
    if std::env::var("REQUIRE_GPU").as_deref() == Ok("1") {
        assert!(!value["gpus"].as_array().unwrap().is_empty(), "{value}");
    }
}

#[test]
fn a_store_that_cannot_be_used_is_named() {
    let place = Workspace::new();
    place.write("newer/VERSION", "gs2e store, format 99\n");
    let said = place.ok("doctor --no-trial --store newer").stdout;
    assert!(said.contains("newer has format 99"), "{said}");
}
