//! A release states what it was made with, and nothing else: releases with one sensor or one output each.

use crate::support::workspace::{TINY, Workspace};
use std::fs;

const SENSORS: [(&str, &str, &[&str]); 3] = [
    ("voltmeter", "{ voltmeter: { preset: dvs346 } }", &["DVS-Voltmeter", "ln(L + k2)", "ECCV 2022"]),
    ("esim", "{ esim: { threshold: { on: 0.2, off: 0.2 } } }", &["ESIM", "CoRL 2018"]),
    ("v2e", "{ v2e: { preset: clean } }", &["v2e (", "CVPRW 2021"]),
];

const SENSOR: &str = "{ voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } } }";

/// All texts of a release for people and catalogues.
fn texts(recipe: &str) -> String {
    let place = Workspace::new();
    place.write("r.yaml", recipe);
    place.ok("release --to out r.yaml");
    place.ok("audit out");
    let names = ["README.md", "DATASHEET.md", "croissant.json"];
    let read = |name: &str| fs::read_to_string(place.path("out").join(name)).unwrap_or_default();
    let mut text = names.map(read).concat();
    let scene: serde_json::Value = serde_json::from_str(&read("tiny/scene.json")).unwrap();
    text += scene["attributes"]["device"].as_str().unwrap();
    text
}

fn recipe(sensor: &str, outputs: &str) -> String {
    // An exposure of the usual length is longer than this path.
    let blur = if outputs.contains("blur") { "\nblur: { frames: 3 }" } else { "" };
    let recipe = TINY.replace("outputs: [events, sharp]", &format!("outputs: [{outputs}]{blur}"));
    recipe
        .replace("  voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }", &format!("  {sensor}"))
        .replace("sensor:\n  {", "sensor: {")
}

#[test]
fn texts_name_the_sensor_that_was_used() {
    for (name, sensor, own) in SENSORS {
        let text = texts(&recipe(sensor, "events"));
        for word in own {
            assert!(text.contains(word), "{name}: {word}");
        }
        for (other, _, words) in SENSORS.iter().filter(|(other, ..)| *other != name) {
            for word in *words {
                assert!(!text.contains(word), "{name} does not use {other}: {word}");
            }
        }
    }
}

#[test]
fn texts_name_the_outputs_that_are_there() {
    const OUTPUTS: [(&str, &[&str]); 5] = [
        ("events", &["events.h5", "event-camera", "scene.events("]),
        ("sharp", &["sharp/%06d", "sharp frames", "scene.frames"]),
        ("blur", &["blur/%06d", "blurred frames", "scene.blurred"]),
        ("depth", &["depth/%06d", "depth images", "scene.depth("]),
        ("flow", &["flow/%06d", "flow images", "scene.flow("]),
    ];
    for (output, own) in OUTPUTS {
        let text = texts(&recipe(SENSOR, output));
        for word in own {
            assert!(text.contains(word), "{output}: {word}");
        }
        for (other, words) in OUTPUTS.iter().filter(|(other, _)| *other != output) {
            for word in *words {
                assert!(!text.contains(word), "{output} alone has no {other}: {word}");
            }
        }
    }
    // Without a sensor no model of one is named.
    let text = texts(&recipe(SENSOR, "sharp"));
    for word in SENSORS.iter().flat_map(|(.., words)| *words) {
        assert!(!text.contains(word), "{word}");
    }
    assert!(text.ends_with("3DGS"), "the device is the renderer");
}

#[test]
fn texts_of_a_procedural_scene_name_no_photos() {
    let text = texts(&recipe(SENSOR, "events, sharp"));
    for word in ["training photos", "of the captures", "COLMAP"] {
        assert!(!text.contains(word), "{word}");
    }
}
