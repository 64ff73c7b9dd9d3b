//! `why` after an edit of the recipe: the edited value, and the steps that run because of it.

use crate::support::workspace::{TINY, Workspace};
use serde_json::{Value, json};

/// The head of `why` for a scene after an edit of its recipe; empty if there is no head.
fn head(place: &Workspace, recipe: &str) -> Vec<String> {
    place.write("tiny.yaml", recipe);
    let found = place.ok("why tiny --recipes tiny.yaml").stdout;
    let mut lines = found.lines();
    if lines.next() != Some("tiny: the recipe was edited since the last build") {
        return Vec::new();
    }
    lines.take_while(|line| line.starts_with("  ")).map(|line| line.trim().to_owned()).collect()
}

#[test]
fn an_edited_number_is_named_with_the_steps_that_it_touches() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    let t = |from: &str, to: &str, wanted: &[&str]| {
        assert!(TINY.contains(from), "{from}");
        assert_eq!(head(&place, &TINY.replace(from, to)), wanted, "{from} -> {to}");
    };
    t("version: 1\n", "version: 1 # the first\n", &[]);
    let from_events = ["will run: base/events", "may run: base/checks"];
    let then = |edit: &'static str, steps: [&'static str; 2]| [[edit].as_slice(), &steps].concat();
    t("on: 1.0", "on: 1.2", &then("sensor.voltmeter.threshold.on: 1.0 -> 1.2", from_events));
    t("seed: 7", "seed: 8", &then("seed: 7 -> 8", from_events));
    t(
        "width: 64",
        "width: 66",
        &["camera.width: 64 -> 66", "will run: base/events, base/sharp", "may run: base/checks"],
    );
    t(
        "0.25*sin(t) + 1.1",
        "0.5*sin(t) + 1.1",
        &[
            "trajectories.base.speed.function: \"0.25*sin(t) + 1.1\" -> \"0.5*sin(t) + 1.1\"",
            "will run: base/trajectory",
            "may run: base/events, base/sharp, base/checks",
        ],
    );
    // A space in a formula is an edit, but the formula is the same.
    t(
        "0.25*sin(t) + 1.1",
        "0.25*sin(t)+1.1",
        &[
            "trajectories.base.speed.function: \"0.25*sin(t) + 1.1\" -> \"0.25*sin(t)+1.1\"",
            "no step has to run for it",
        ],
    );
}

#[test]
fn several_edits_are_all_named() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    let edited = TINY.replace("off: 1.0", "off: 0.9").replace("factor: 2", "frames: 9");
    assert_eq!(
        head(&place, &edited),
        [
            "sensor.voltmeter.threshold.off: 1.0 -> 0.9",
            "trajectories.base.refine.factor: 2 -> absent",
            "trajectories.base.refine.frames: absent -> 9",
            "will run: base/trajectory",
            "may run: base/events, base/sharp, base/checks",
        ]
    );
    // After a build there is no edit, and reverting is another edit.
    place.ok("build -q tiny.yaml");
    assert_eq!(head(&place, &edited), [""; 0]);
    let back = head(&place, TINY);
    assert_eq!(
        (back[0].as_str(), back[3].as_str()),
        ("sensor.voltmeter.threshold.off: 0.9 -> 1.0", "no step has to run for it")
    );
}

#[test]
fn a_trajectory_that_comes_or_goes_is_named() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    let more = TINY.replace("sampling:", "  - name: mini\n    refine: { factor: 3 }\nsampling:");
    let steps = "mini/trajectory";
    let found = head(&place, &more);
    assert_eq!(
        (found[0].as_str(), found[1].as_str()),
        ("trajectories.mini: added", format!("will run: {steps}").as_str())
    );
    place.ok("build -q tiny.yaml");
    assert_eq!(head(&place, TINY), ["trajectories.mini: removed", "no step has to run for it"]);
}

#[test]
fn a_scene_that_was_never_whole_has_no_head() {
    let place = Workspace::with_tiny();
    assert_eq!(head(&place, TINY), [""; 0]);
    // A lost blob is no edit.
    place.ok("build -q tiny.yaml");
    std::fs::remove_dir_all(place.path(".gs2e/cas")).unwrap();
    assert_eq!(head(&place, TINY), [""; 0]);
}

#[test]
fn programs_get_the_edits_with_each_step() {
    let place = Workspace::with_tiny();
    place.ok("build -q tiny.yaml");
    place.write("tiny.yaml", TINY.replace("rate: 2400", "rate: 1200"));
    let message = place.ok("why tiny/base/events --recipes tiny.yaml --json").stdout;
    let step: Value = serde_json::from_str(message.trim()).unwrap();
    assert_eq!(step["recipe_edits"], json!([{ "path": "sampling.rate", "old": 2400, "new": 1200 }]));
    assert_eq!((step["scene"].as_str(), step["step"].as_str()), (Some("tiny"), Some("base/events")));
}
