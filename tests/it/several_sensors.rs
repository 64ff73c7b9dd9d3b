//! Several sensors that see one rendering.

use crate::support::workspace::{RunOutcome, Workspace, tiny_with};
use gs2e_event::h5;
use serde_json::Value;
use std::fs;

const THREE: &str = "sensors:
  fine: { voltmeter: { preset: dvs346-paper, threshold: { on: 0.5, off: 0.5 } } }
  usual: { voltmeter: { preset: dvs346, labels: true } }
  coarse: { voltmeter: { preset: dvs346-paper, threshold: { on: 2.0, off: 2.0 } } }
";

#[test]
fn each_has_its_stream_its_checks_and_its_place_in_the_release() {
    let place = Workspace::new();
    place.write("tiny.yaml", tiny_with(THREE));
    let message = place.ok("release --to tree tiny.yaml").stderr;
    for name in ["coarse", "fine", "usual"] {
        assert!(message.contains(&format!("sensor of tiny/{name}: ")), "{message}");
    }
    place.ok("audit tree");
    let scene = place.json("tree/tiny/scene.json");
    let part = &scene["trajectories"][0];
    assert_eq!((&part["sensor"], &part["statistics"]["events"]), (&Value::Null, &Value::Null));
    let events = |name: &str| part["sensors"][name]["statistics"]["events"].as_u64().unwrap();
    assert!(events("fine") > events("usual") && events("usual") > events("coarse"));
    for name in ["coarse", "fine", "usual"] {
        let labelled = name == "usual";
        assert_eq!(part["sensors"][name]["sensor"]["labels"] == true, labelled);
        let stream = h5::Reader::open(&place.path(&format!("tree/tiny/base/events/{name}.h5"))).unwrap();
        assert_eq!(stream.labelled(), labelled, "{name}");
    }
    let card = fs::read_to_string(place.path("tree/README.md")).unwrap();
    assert!(card.contains("`events/label`, where a stream has it"), "{card}");
    assert!(
        ["coarse", "fine", "usual"].iter().all(|name| card.contains(&format!("| tiny/base/{name} |"))),
        "{card}"
    );
    let checks = place.json("tree/tiny/base/checks.json");
    let subjects = |check: &str| -> Vec<String> {
        let of = checks.as_array().unwrap().iter().filter(|f| f["check"] == check);
        of.map(|f| f["subject"].as_str().unwrap().to_owned()).collect()
    };
    let judged = |name: &str| {
        let subject = format!("tiny/base/{name}");
        subjects("event_rate")
            .iter()
            .filter(|s| **s == subject || s.starts_with(&format!("{subject}#")))
            .count()
    };
    assert!(judged("fine") > 0 && judged("fine") == judged("usual") && judged("fine") == judged("coarse"));
    assert_eq!(subjects("event_rate").len(), 3 * judged("fine"));
    assert!(subjects("speed").iter().all(|s| s == "tiny/base" || s.starts_with("tiny/base#")));
    // The canonical recipe describes the same sensors.
    place.write("again.yaml", scene["recipe"].to_string());
    assert!(place.stale("again.yaml").is_empty());
    // One of the streams is missing, as in a damaged mirror.
    fs::remove_file(place.path("tree/tiny/base/events/fine.h5")).unwrap();
    assert_eq!(place.gs2e("audit tree").code, 3);
}

#[test]
fn a_sensor_makes_the_same_events_alone() {
    let place = Workspace::new();
    place.write("tiny.yaml", tiny_with(THREE));
    place.ok("release --to several tiny.yaml");
    place.write(
        "tiny.yaml",
        tiny_with("sensor: { voltmeter: { preset: dvs346-paper, threshold: { on: 0.5, off: 0.5 } } }\n"),
    );
    place.ok("release --to one tiny.yaml");
    let [several, one] = ["several/tiny/base/events/fine.h5", "one/tiny/base/events.h5"]
        .map(|path| fs::read(place.path(path)).unwrap());
    assert!(several == one);
}

/// A sensor and the same sensor without noise are recorded as twins. Another threshold, or a sensor
/// without a noisy partner, makes no pair.
#[test]
fn a_sensor_without_noise_is_the_twin_of_the_one_with_it() {
    let place = Workspace::new();
    let [k1, k2, ..] = gs2e_sensor::voltmeter::VoltmeterPreset::Dvs346.k();
    let k = format!("k: [{k1}, {k2}, 0, 0, 0, 0], units: {{ time: us, brightness: 255 }}");
    let sensors = format!(
        "sensors:\n  clean: {{ voltmeter: {{ {k} }} }}\n  \
         finer: {{ voltmeter: {{ {k}, threshold: {{ on: 0.5, off: 0.5 }} }} }}\n  \
         noisy: {{ voltmeter: {{ preset: dvs346, labels: true }} }}\n  \
         v2e-clean: {{ v2e: {{ preset: clean }} }}\n"
    );
    place.write("tiny.yaml", tiny_with(&sensors));
    place.ok("release --to tree tiny.yaml");
    place.ok("audit tree");
    let scene = place.json("tree/tiny/scene.json");
    let twin_of = |name: &str| scene["trajectories"][0]["sensors"][name]["twin_of"].clone();
    assert_eq!(
        ["clean", "finer", "noisy", "v2e-clean"].map(twin_of),
        ["noisy".into(), Value::Null, Value::Null, Value::Null]
    );
}

/// `twin_of` is the sensor with its noise parameters at 0, written out by hand.
#[test]
fn a_twin_is_the_same_sensor_without_its_noise() {
    let place = Workspace::new();
    let noisy = "noisy: { v2e: { preset: noisy, labels: true, hot_pixels: { share: 0.1, rate: 5 } } }";
    let by_hand = "by-hand: { v2e: { preset: noisy, leak: { rate: 0 }, shot: 0 } }";
    place.write(
        "tiny.yaml",
        tiny_with(&format!("sensors:\n  clean: {{ twin_of: noisy }}\n  {by_hand}\n  {noisy}\n")),
    );
    let message = place.ok("release --to tree tiny.yaml").stderr;
    let line = "twins of tiny: by-hand is noisy without its noise, clean is noisy without its noise";
    assert_eq!(message.lines().filter(|found| *found == line).count(), 1, "{message}");
    assert!(!message.contains("no twin"), "{message}");
    place.ok("audit tree");
    let scene = place.json("tree/tiny/scene.json");
    let part = &scene["trajectories"][0]["sensors"];
    let twin_of = |name: &str| part[name]["twin_of"].clone();
    assert_eq!(["by-hand", "clean", "noisy"].map(twin_of), ["noisy".into(), "noisy".into(), Value::Null]);
    let events = |name: &str| fs::read(place.path(&format!("tree/tiny/base/events/{name}.h5"))).unwrap();
    assert!(events("clean") == events("by-hand") && events("clean") != events("noisy"));
    // The canonical recipe keeps the key, and is the same recipe.
    assert_eq!(scene["recipe"]["sensors"]["clean"], serde_json::json!({ "twin_of": "noisy" }));
    place.write("again.yaml", scene["recipe"].to_string());
    assert!(place.stale("again.yaml").is_empty());
}

#[test]
fn parameters_that_keep_a_sensor_from_being_a_twin_are_named() {
    let place = Workspace::new();
    let message = |sensors: &str| {
        place.write("tiny.yaml", tiny_with(sensors).replace("outputs: [events, sharp]", "outputs: []"));
        place.ok("build tiny.yaml").stderr
    };
    let near = message("sensors:\n  a: { v2e: { preset: clean } }\n  b: { v2e: { preset: noisy } }\n");
    let wanted = "sensor of tiny/a: no twin of b, because of cutoff, threshold.spread; twin_of: b makes one";
    assert!(near.contains(wanted) && !near.contains("twins of"), "{near}");
    let far = message("sensors:\n  a: { esim: {} }\n  b: { v2e: { preset: noisy } }\n");
    assert!(!far.contains("twin"), "{far}");
}

#[test]
fn ambiguous_and_invalid_sensors_are_refused() {
    let place = Workspace::new();
    let refused = |sensors: &str, wanted: &str| {
        place.write("tiny.yaml", tiny_with(sensors));
        let RunOutcome { code, stderr, .. } = place.gs2e("build tiny.yaml");
        assert_eq!(code, 2, "{stderr}");
        assert!(stderr.contains(wanted), "{sensors}: {stderr}");
    };
    refused("sensors: {}\n", "names no sensor");
    refused("sensors: { a/b: { voltmeter: {} } }\n", "which has more than one part");
    refused("sensors: { a: { voltmeter: {} }, A: { voltmeter: {} } }\n", "differs from \"A\" only in case");
    refused("sensors: { a: { voltmeter: { k: 1 } } }\n", "tiny.yaml");
    refused("sensor: { voltmeter: {} }\nsensors: { a: { voltmeter: {} } }\n", "sensors exclude each other");
    refused("sensors: { a: { voltmeter: {} }, a: { voltmeter: {} } }\n", "a");
    let twins = |of: &str| {
        format!("sensors:\n  a: {{ voltmeter: {{}} }}\n  bare: {{ esim: {{}} }}\n  t: {{ {of} }}\n")
    };
    refused(&twins("twin_of: b"), "unknown sensor \"b\"");
    refused(&twins("twin_of: t"), "\"sensors.t.twin_of\" is \"t\", which is the sensor itself");
    refused(
        &twins("twin_of: a }\n  u: { twin_of: t"),
        "\"sensors.u.twin_of\" is \"t\", which is a twin itself",
    );
    refused(&twins("twin_of: bare"), "\"sensors.t.twin_of\" is \"bare\", which has no noise to leave out");
    refused(&twins("twin_of: a, voltmeter: {}"), "\"sensors.t\" has 2 keys, wanted one of");
    refused(&twins("twin_of: [a]"), "sensors.t.twin_of");
    refused("sensor: { twin_of: a }\n", "is a twin of another sensor, and there is no other");
}
