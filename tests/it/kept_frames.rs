//! Frames that a build keeps: a sensor is changed without a renderer, and the bytes are those of a rendering.

use crate::support::steps::{recipe, steps};
use crate::support::workspace::{Workspace, same_tree};
use serde_json::{Value, json};
use std::path::PathBuf;

/// A scene with these outputs, and a sensor with this threshold.
fn scene(outputs: &[&str], threshold: f64, settings: &[(&str, Value)]) -> String {
    let mut value = recipe("tiny");
    value["outputs"] = json!(outputs);
    value["sensor"]["voltmeter"]["threshold"] = json!({ "on": threshold, "off": threshold });
    for (name, setting) in settings {
        value[*name] = setting.clone();
    }
    value.to_string()
}

fn files(place: &Workspace) -> Vec<PathBuf> {
    let found = walkdir::WalkDir::new(place.path(".gs2e/frames")).into_iter().filter_map(Result::ok);
    found.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect()
}

/// Builds with one threshold and then with another one. The second build takes its frames from the first, all
/// of them or some, and its release is that of a build that renders them.
fn check(outputs: &[&str], settings: &[(&str, Value)], takes_all: bool) {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", scene(outputs, 0.1, settings));
    let first = place.ok("build").stderr;
    assert!(first.contains("MB of frames kept"), "{first}");
    assert_eq!(files(&place).len(), 1);
    place.write("recipes/tiny.yaml", scene(outputs, 0.05, settings));
    let planned = place.ok("plan");
    assert!(planned.stdout.contains("; its frames are kept"), "{}", planned.stdout);
    let second = place.ok("release --to shown").stderr;
    assert_eq!(second.contains("from kept frames"), takes_all, "{second}");
    place.ok("release --store other --to rendered --keep-frames off");
    same_tree(&place.path("shown"), &place.path("rendered"));
}

#[test]
fn a_changed_threshold_needs_no_renderer() {
    check(&["events"], &[], true);
}

#[test]
fn frames_of_a_pass_with_other_outputs_serve_the_sensor_alone() {
    let blur = json!({ "frames": 3 });
    check(&["events", "sharp", "blur", "depth", "flow"], &[("blur", blur)], true);
}

#[test]
fn rates_and_frames_of_a_tolerance_are_kept() {
    check(&["events"], &[("sampling", json!({ "between": "hermite" }))], true);
    // Another threshold needs other frames; those of the pilot are the same.
    check(&["events"], &[("sampling", json!({ "tolerance": 0.2 }))], false);
}

#[test]
fn many_scenes_keep_no_frames_unless_asked() {
    let place = Workspace::new();
    // Scenes of other Gaussians: of equal ones, the second would take the frames of the first.
    for (name, seed) in [("a", 1), ("b", 2)] {
        let mut value = recipe(name);
        value["source"]["procedural"]["seed"] = json!(seed);
        place.write(&format!("recipes/{name}.yaml"), value.to_string());
    }
    place.ok("build");
    assert_eq!(files(&place).len(), 0);
    place.ok("build --store kept --keep-frames 1GB");
    let kept = walkdir::WalkDir::new(place.path("kept/frames")).into_iter().filter_map(Result::ok);
    assert_eq!(kept.filter(|entry| entry.file_type().is_file()).count(), 2);
    let ended = place.gs2e("build --keep-frames some");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("wanted a number of bytes such as 8GB"), "{}", ended.stderr);
}

#[test]
fn frames_of_another_path_or_style_are_not_shown() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", scene(&["events"], 0.3, &[]));
    place.ok("build");
    for settings in [("render", json!({ "rules": "soft" })), ("camera", json!({ "width": 40, "height": 32 }))]
    {
        place.write("recipes/tiny.yaml", scene(&["events"], 0.3, &[settings]));
        let ended = place.ok("build").stderr;
        assert!(ended.contains("MB of frames kept"), "{ended}");
    }
    assert_eq!(files(&place).len(), 3);
}

#[test]
fn damaged_frames_are_rendered() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", scene(&["events"], 0.3, &[]));
    place.ok("build");
    let file = files(&place).remove(0);
    let mut bytes = std::fs::read(&file).unwrap();
    for at in (0..bytes.len()).step_by(5000) {
        bytes[at] ^= 4;
    }
    std::fs::write(&file, bytes).unwrap();
    place.write("recipes/tiny.yaml", scene(&["events"], 0.2, &[]));
    let second = place.ok("release --to shown").stderr;
    assert!(!second.contains("from kept frames"), "{second}");
    place.ok("release --store other --to rendered --keep-frames off");
    same_tree(&place.path("shown"), &place.path("rendered"));
}

#[test]
fn a_comparison_renders_again_and_a_collection_counts_frames() {
    let place = Workspace::new();
    place.write("recipes/tiny.yaml", scene(&["events"], 0.3, &[]));
    place.ok("build");
    // Kept frames would hide a renderer that gives other bytes.
    let ended = place.ok("build --recheck 100%").stderr;
    assert!(ended.contains("steps rerun") && !ended.contains("kept frames"), "{ended}");
    let kept = place.ok("gc --min-age 0").stderr;
    assert!(!kept.contains("of frames"), "{kept}");
    assert_eq!(steps(&place, "recipes")["tiny/base/events"].action, "keep");
    // Frames of a path that no recipe has any more.
    place.write("recipes/tiny.yaml", scene(&["events"], 0.3, &[("render", json!({ "rules": "soft" }))]));
    place.ok("build");
    std::thread::sleep(std::time::Duration::from_millis(1100));
    let swept = place.ok("gc --min-age 1s --json");
    assert!(swept.stderr.contains("deleted 1 files of frames"), "{}", swept.stderr);
    let record: Value = serde_json::from_str(swept.stdout.lines().last().unwrap()).unwrap();
    assert_eq!(record["frames"], 1, "{record}");
    assert_eq!(files(&place).len(), 1);
}
