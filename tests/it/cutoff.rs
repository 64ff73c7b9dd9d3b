//! Early cut-off, damage and explanations beyond the rows of the engine's behaviour table.

use crate::support::steps::{Step, recipe, steps};
use crate::support::workspace::{Workspace, alter};
use gs2e_demo::{StillLife, still_life};
use gs2e_scene::ply::write_ply;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;

const NONE: [&str; 0] = [];

/// The tiny recipe over files: views in `transforms.json`, the embedded scene in `scene.ply`.
fn captured() -> Workspace {
    let place = Workspace::new();
    place.write("transforms.json", transforms().to_string());
    let life = StillLife { gaussians: 300, ..StillLife::default() };
    let mut ply = Vec::new();
    write_ply(&still_life(&life), &mut ply).unwrap();
    place.write("scene.ply", ply);
    place.write("tiny.yaml", over_files("tiny").to_string());
    place
}

fn over_files(scene: &str) -> Value {
    let mut value = recipe(scene);
    value["source"] = json!({ "nerfstudio": { "path": "transforms.json" } });
    value["reconstruct"] = json!({ "given": { "path": "scene.ply" } });
    value
}

/// Six views of the origin on a short arc, camera to world in OpenGL axes.
fn transforms() -> Value {
    let frame = |i: u32| {
        let (sin, cos) = (0.002 * f64::from(i)).sin_cos();
        let rows = [
            [cos, 0.0, sin, 4.0 * sin],
            [0.0, 1.0, 0.0, 0.0],
            [-sin, 0.0, cos, 4.0 * cos],
            [0.0, 0.0, 0.0, 1.0],
        ];
        json!({ "file_path": format!("{i:03}.png"), "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..6).map(frame).collect();
    json!({ "w": 48, "h": 32, "fl_x": 45.0, "fl_y": 45.0, "cx": 24.0, "cy": 16.0, "frames": frames })
}

/// The steps of the tiny scene that a plan would certainly run, and those that may follow.
fn stale(steps: &BTreeMap<String, Step>) -> (Vec<&str>, Vec<&str>) {
    let of = |action: &str| {
        steps.iter().filter(|(_, s)| s.action == action).map(|(name, _)| name.as_str()).collect()
    };
    (of("run"), of("may-run"))
}

#[test]
fn white_space_in_a_source_runs_only_its_reader() {
    let place = captured();
    assert_eq!(place.build("tiny.yaml").len(), 8);
    place.write("transforms.json", serde_json::to_string_pretty(&transforms()).unwrap());
    let plan = steps(&place, "tiny.yaml");
    assert_eq!(plan["tiny/capture"].code, "input-changed");
    let of_base = ["checks", "events", "sharp", "trajectory"].map(|step| format!("tiny/base/{step}"));
    let behind: Vec<&str> =
        of_base.iter().map(String::as_str).chain(["tiny/checks", "tiny/fidelity"]).collect();
    assert_eq!(stale(&plan), (vec!["tiny/capture"], behind));
    assert_eq!(place.build("tiny.yaml"), ["tiny/capture"]);
    assert_eq!(place.stale("tiny.yaml"), NONE);
}

/// Two steps with different keys share one blob, which is damaged. Repairing one step does not harm
/// the other.
#[test]
fn a_damaged_blob_of_two_steps() {
    for cores in ["1", "2"] {
        let place = Workspace::new();
        let mut value = recipe("tiny");
        let with_gaps = |gaps: &str| json!({ "name": gaps, "refine": { "factor": 2, "gaps": gaps } });
        value["trajectories"] = json!([with_gaps("bridge"), with_gaps("refuse")]);
        place.write("tiny.yaml", value.to_string());
        place.ok("build tiny.yaml");
        let before = steps(&place, "tiny.yaml");
        let poses = |name: &str| before[name].outputs["poses.txt"].clone();
        assert_eq!(poses("tiny/bridge/trajectory"), poses("tiny/refuse/trajectory"), "the premise");
        alter(&poses("tiny/bridge/trajectory"), true);
        let made = place.build(&format!("-j {cores} tiny.yaml"));
        assert!(made.iter().all(|step| step.ends_with("/trajectory")), "{made:?}");
        assert_eq!(steps(&place, "tiny.yaml"), before);
    }
}

/// The database is only an index: if it is lost or replaced by another file, the records count.
#[test]
fn a_lost_database_runs_nothing() {
    let place = captured();
    place.ok("build tiny.yaml");
    for damage in [None, Some("no database"), Some("")] {
        match damage {
            None => fs::remove_file(place.path(".gs2e/state.db")).unwrap(),
            Some(text) => place.write(".gs2e/state.db", text),
        }
        assert_eq!(place.stale("tiny.yaml"), NONE, "{damage:?}, looked at");
        assert_eq!(place.build("tiny.yaml"), NONE, "{damage:?}");
    }
}

/// One number of a recipe: its place, its values, and every step that it touches.
#[test]
fn why_names_the_number_and_the_steps_that_it_touches() {
    let place = captured();
    place.ok("build tiny.yaml");
    let mut edited = over_files("tiny");
    edited["trajectories"][0]["refine"]["factor"] = json!(3);
    edited["sensor"] = json!({ "voltmeter": { "preset": "dvs346-paper", "threshold": { "on": 1.25 } } });
    place.write("tiny.yaml", edited.to_string());
    let message = place.ok("why tiny --recipes tiny.yaml").stdout;
    let has =
        |line: &str| assert!(message.lines().any(|l| l.trim() == line), "no line `{line}` in\n{message}");
    has("tiny/base/trajectory: the recipe changed: trajectories.base.refine.factor: 2 -> 3");
    has("tiny/base/events: depends on base/trajectory");
    has("tiny/base/sharp: depends on base/trajectory");
    has("tiny/base/checks: depends on base/trajectory");
    has("tiny/capture: up to date");
    // This is known already, although the step has no key before the trajectory is made.
    has("changed since the last run: sensor.voltmeter.threshold.on: 1.0 -> 1.25");
    assert_eq!(message.matches("changed since").count(), 2, "{message}");
}
