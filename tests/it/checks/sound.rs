//! Twenty-six sound scenes with varied settings: no check raises an alarm, and each check passes
//! somewhere. Without slow tests, ten of them.

use super::checked;
use crate::support::absent::is_thorough;
use serde_json::Value;
use std::collections::BTreeSet;

/// Settings common to all scenes, as `KEY` and value. A scene may override them.
const COMMON: [(&str, &str); 8] = [
    ("gaussians", "20000"),
    ("views", "16"),
    ("arc", "10"),
    ("camera", "{ width: 240, height: 136 }"),
    ("trajectories", "[{ name: base, refine: { window: 2, factor: 5 } }]"),
    ("sampling", "{ rate: 2400 }"),
    ("render", "{ rules: official }"),
    ("sensor", "sensor: { voltmeter: { preset: dvs346 } }"),
];

/// Name and own settings of each scene.
const SCENES: [(&str, &[(&str, &str)]); 26] = [
    ("plain", &[]),
    ("slow", &[("arc", "3")]),
    ("fast", &[("arc", "25")]),
    ("turning", &[("trajectories", "[{ name: base, refine: { window: 2, factor: 5, curve: slerp-lerp } }]")]),
    (
        "unsteady",
        &[(
            "trajectories",
            "[{ name: base, refine: { window: 2, factor: 5 }, speed: { function: \"0.25*sin(t) + 1.1\" } }, \
             { name: mini, novel: { groups: 1, keyframes: 5, frames: 80 } }]",
        )],
    ),
    (
        "sensitive",
        &[("sensor", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.6, off: 0.9 } } }")],
    ),
    ("dull", &[("sensor", "sensor: { voltmeter: { preset: dvs346, threshold: { on: 1.6, off: 1.4 } } }")]),
    ("stationary", &[("sensor", "sensor: { voltmeter: { preset: dvs346, initial: stationary } }")]),
    ("noisy", &[("sensor", "sensor: { voltmeter: { preset: gs2e-si } }")]),
    ("noisy-stationary", &[("sensor", "sensor: { voltmeter: { preset: gs2e-si, initial: stationary } }")]),
    ("dvs240", &[("sensor", "sensor: { voltmeter: { preset: dvs240 } }")]),
    ("official", &[("sensor", "sensor: { voltmeter: { preset: dvs346, law: official } }")]),
    (
        "hot",
        &[("sensor", "sensor: { voltmeter: { preset: dvs346, hot_pixels: { share: 0.001, rate: 5000 } } }")],
    ),
    ("esim", &[("sensor", "sensor: { esim: {} }")]),
    ("dead-time", &[("sensor", "sensor: { esim: { refractory: { period_us: 300 } } }")]),
    ("v2e", &[("sensor", "sensor: { v2e: { preset: clean } }")]),
    ("several", &[("sensor", "sensors: { a: { voltmeter: { preset: dvs346 } }, b: { esim: {} } }")]),
    ("catmull", &[("sampling", "{ rate: 1200, between: catmull }"), ("arc", "4")]),
    ("hermite", &[("sampling", "{ rate: 1200, between: hermite }"), ("arc", "4")]),
    ("tolerance", &[("sampling", "{ rate: 2400, tolerance: 0.05 }")]),
    ("soft", &[("render", "{ rules: soft }")]),
    ("exact-rules", &[("render", "{ rules: exact, antialiased: true }")]),
    ("background", &[("render", "{ rules: official, background: [0.5, 0.4, 0.9] }")]),
    // Much of the picture is empty: there the noise floor is seen.
    (
        "empty-sky",
        &[
            ("camera", "{ width: 240, height: 136, fx: 40, fy: 40, cx: 120, cy: 68 }"),
            ("sampling", "{ rate: 240 }"),
            ("sensor", "sensor: { voltmeter: { preset: gs2e-si, initial: stationary } }"),
        ],
    ),
    ("usual", &[("sensor", "sensor: { voltmeter: {} }")]),
    ("dim", &[("sensor", "sensor: { voltmeter: { front_end: { lux: 5 } } }")]),
];

fn recipe(index: usize) -> String {
    let (name, own) = SCENES[index];
    let of = |key: &str| {
        let mut all = own.iter().chain(&COMMON);
        all.find(|(other, _)| *other == key).unwrap().1
    };
    format!(
        "version: 1\nscene: sound/{name}\nseed: {index}\nsource: {{ procedural: {{ kind: still-life, gaussians: {}, \
         views: {}, arc: {}, seed: {index} }} }}\ncamera: {}\ntrajectories: {}\nsampling: {}\nrender: {}\n{}\n\
         outputs: [events]\n",
        of("gaussians"),
        of("views"),
        of("arc"),
        of("camera"),
        of("trajectories"),
        of("sampling"),
        of("render"),
        of("sensor")
    )
}

/// The scenes that are built without slow tests: each kind of sensor, interpolation and rule once.
const FEW: [&str; 10] = [
    "plain",
    "noisy-stationary",
    "hot",
    "dead-time",
    "v2e",
    "several",
    "hermite",
    "tolerance",
    "soft",
    "empty-sky",
];

#[test]
fn no_sound_scene_raises_an_alarm() {
    let chosen = |index: &usize| is_thorough() || FEW.contains(&SCENES[*index].0);
    let records = checked((0..SCENES.len()).filter(chosen).map(recipe));
    let text = |record: &Value, key: &str| record[key].as_str().unwrap().to_owned();
    let alarms: Vec<&Value> = records
        .iter()
        .filter(|record| !["pass", "not-run"].contains(&&*text(record, "verdict")))
        // A wide angle sees Gaussians at its edge that are deep for their distance.
        .filter(|record| text(record, "subject") != "sound/empty-sky/base" || record["check"] != "affine")
        // The thresholds of `gs2e-si` are so high that it makes next to no events: a warning is right.
        .filter(|record| !text(record, "because").contains("fewer than one per 1,000 pixels"))
        .collect();
    assert!(alarms.is_empty(), "{alarms:#?}");
    // A check that never ran would raise no alarm either.
    let passed: BTreeSet<String> =
        records.iter().filter(|r| r["verdict"] == "pass").map(|r| text(r, "check")).collect();
    let found: BTreeSet<String> = records.iter().map(|r| text(r, "check")).collect();
    let asked_elsewhere = ["pose_colmap", "pose_opencv", "readback"];
    // They compare the pictures of a release.
    let of_releases = ["photometric", "depth_consistency", "flow_projection"];
    let elsewhere: Vec<&str> = asked_elsewhere.into_iter().chain(of_releases).collect();
    let silent: Vec<&String> =
        found.difference(&passed).filter(|check| !elsewhere.contains(&check.as_str())).collect();
    assert!(silent.is_empty(), "{silent:?}");
    assert!(found.len() >= 18, "{found:?}");
}
