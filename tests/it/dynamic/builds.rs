//! Recipes with a scene that changes with time: keys, products, checks, tolerance and faults.

use crate::support::steps::{keys, recipe, steps};
use crate::support::workspace::Workspace;
use serde_json::{Value, json};

/// A still camera in front of the still life with a fountain, over 50 ms.
fn with_fountain(outputs: &[&str]) -> Value {
    let mut value = recipe("tiny");
    value["source"]["procedural"]["gaussians"] = json!(6000);
    value["source"]["procedural"]["fountain"] =
        json!({ "drops": 400, "time": { "start": 0.5, "speed": 8, "duration": 2 } });
    value["camera"] = json!({ "width": 160, "height": 90 });
    value["outputs"] = json!(outputs);
    value["trajectories"] = json!([{
        "name": "base",
        "keyframes": {
            "poses": [{ "position": [0.1, -0.7, -4.0], "look_at": [0.1, -0.5, 0.0], "up": [0, -1, 0] }],
            "frames": 61,
        },
    }]);
    value["sampling"] = json!({ "rate": 1200 });
    value
}

/// The value of a key, wherever it is.
fn find<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    match value {
        Value::Object(map) => map.get(key).or_else(|| map.values().find_map(|inner| find(inner, key))),
        Value::Array(items) => items.iter().find_map(|inner| find(inner, key)),
        _ => None,
    }
}

#[test]
fn a_release_shows_the_fountain_and_its_checks_pass() {
    let place = Workspace::new();
    let mut value = with_fountain(&["events", "sharp", "blur", "depth", "flow"]);
    value["blur"] = json!({ "frames": 7, "subframes": "auto" });
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("release --to out");
    place.ok("audit out");
    let said = place.ok("check --tree out").stdout;
    let order = said.lines().find(|line| line.contains("base#order")).unwrap_or_default();
    assert!(order.starts_with("not run") && order.contains("the scene changes with time"), "{said}");
    let scene: Value = place.json("out/tiny/scene.json");
    let events = scene["trajectories"][0]["statistics"]["events"].as_u64().unwrap();
    // Nothing but the drops moves.
    println!("{events} events of drops in front of a still camera");
    assert!(events > 1000, "{events}");
    let fountain = find(&scene, "fountain").expect("the recipe of the release has it");
    assert_eq!(fountain["time"], json!({ "start": 0.5, "speed": 8.0, "duration": 2.0 }));
}

#[test]
fn time_changes_renderings_alone_and_an_absent_one_nothing() {
    let place = Workspace::new();
    let mut value = with_fountain(&["events"]);
    let fountain = value["source"]["procedural"].as_object_mut().unwrap().remove("fountain").unwrap();
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("build");
    let plain = keys(&place, "recipes");
    value["source"]["procedural"]["fountain"] = fountain;
    place.write("recipes/tiny.yaml", value.to_string());
    let stale: Vec<String> = steps(&place, "recipes")
        .into_iter()
        .filter(|(_, step)| step.action != "keep")
        .map(|(name, _)| name)
        .collect();
    assert_eq!(stale, ["tiny/base/checks", "tiny/base/events", "tiny/reconstruct"]);
    place.ok("build");
    value["source"]["procedural"]["fountain"]["time"]["speed"] = json!(7);
    place.write("recipes/tiny.yaml", value.to_string());
    let why = place.ok("why tiny/reconstruct").stdout;
    assert!(why.contains("speed"), "{why}");
    value["source"]["procedural"].as_object_mut().unwrap().remove("fountain");
    place.write("recipes/tiny.yaml", value.to_string());
    assert_eq!(keys(&place, "recipes"), plain);
}

#[test]
fn a_tolerance_is_met_on_windows_that_its_choice_did_not_see() {
    let place = Workspace::new();
    let measured = |value: &Value, out: &str| {
        place.write("recipes/tiny.yaml", value.to_string());
        place.ok(&format!("release --to {out}"));
        let scene = std::fs::read(place.path(&format!("{out}/tiny/scene.json"))).unwrap();
        let scene: Value = serde_json::from_slice(&scene).unwrap();
        let listed = scene["trajectories"][0]["sampling"]["tolerance"].clone();
        println!("{out}: {listed}");
        listed
    };
    let mut value = with_fountain(&["events"]);
    value["source"]["procedural"]["fountain"]["time"]["speed"] = json!(2);
    value["sampling"] = json!({ "rate": 200, "tolerance": 0.05 });
    value["trajectories"][0]["keyframes"]["frames"] = json!(11);
    let moving = measured(&value, "moving");
    let number = |listed: &Value, name: &str| listed[name].as_f64().unwrap();
    assert!(number(&moving, "achieved") <= 0.05 && number(&moving, "bound_95") <= 0.05, "{moving}");
    assert!(number(&moving, "achieved") > 0.0005, "the drops are seen: {moving}");
    value["source"]["procedural"].as_object_mut().unwrap().remove("fountain");
    let still = measured(&value, "still");
    assert!(number(&moving, "frames") >= number(&still, "frames"), "{moving} {still}");
    assert!(number(&moving, "achieved") > number(&still, "achieved"), "{moving} {still}");
}

#[test]
fn recipes_read_files_with_tracks_and_sequences() {
    let place = Workspace::new();
    let mut value = with_fountain(&["sharp"]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("build");
    // The stored scene is itself a file with tracks; its harmonics are read as such only from the store.
    let stored = &steps(&place, "recipes")["tiny/reconstruct"].outputs["scene.ply"];
    let (scene, tracks) = gs2e_scene::ply::read_tracks(
        &std::fs::read(stored).unwrap(),
        gs2e_scene::ply::TrackColours::Harmonics,
    )
    .unwrap();
    assert_eq!((scene.len(), tracks.len()), (6400, 6400));
    // A sequence of the table, in which everything sinks.
    for k in 0_u8..4 {
        let mut frame = scene.clone();
        frame.positions.iter_mut().for_each(|p| p[1] += 0.02 * f32::from(k));
        let mut bytes = Vec::new();
        gs2e_scene::ply::write_ply(&frame, &mut bytes).unwrap();
        place.write(&format!("recipes/frames/{k}.ply"), bytes);
    }
    value["source"] = json!("none");
    value["reconstruct"] = json!({ "given": { "path": "frames", "time": { "rate": 60 } } });
    value["camera"]["fx"] = json!(150);
    value["outputs"] = json!(["events", "flow"]);
    place.write("recipes/tiny.yaml", value.to_string());
    place.ok("build");
    assert_eq!(steps(&place, "recipes")["tiny/reconstruct"].action, "keep");
    // A frame that changes makes the scene again.
    std::fs::copy(place.path("recipes/frames/3.ply"), place.path("recipes/frames/2.ply")).unwrap();
    let action = steps(&place, "recipes")["tiny/reconstruct"].action.clone();
    assert_ne!(action, "keep");
    // One frame less, and the trajectory of 50 ms is longer than the sequence of 33 ms.
    std::fs::remove_file(place.path("recipes/frames/3.ply")).unwrap();
    let ended = place.gs2e("build");
    assert!(
        ended.code == 1 && ended.stderr.contains("the scene lasts from 0 to 0.03"),
        "{}: {}",
        ended.code,
        ended.stderr
    );
}

#[test]
fn faulty_times_are_named() {
    let place = Workspace::new();
    let refused = |change: &dyn Fn(&mut Value), verb: &str, code: i32, because: &str| {
        let mut value = with_fountain(&["sharp"]);
        change(&mut value);
        place.write("recipes/tiny.yaml", value.to_string());
        let ended = place.gs2e(verb);
        assert_eq!(ended.code, code, "{because}: {}", ended.stderr);
        assert!(ended.stderr.contains(because), "{because}: {}", ended.stderr);
    };
    let fountain = |field: &'static str, value: Value| {
        move |v: &mut Value| v["source"]["procedural"]["fountain"]["time"][field] = value.clone()
    };
    refused(&fountain("speed", json!(0)), "plan", 2, "wanted a number above 0");
    refused(&fountain("start", json!(-1)), "plan", 2, "is -1, wanted a number from 0");
    refused(&fountain("rate", json!(30)), "plan", 2, "is the rate of a sequence of files");
    refused(&fountain("speeed", json!(1)), "plan", 2, "did you mean \"speed\"?");
    let given = |time: Value| {
        move |v: &mut Value| {
            v["source"] = json!("none");
            v["camera"]["fx"] = json!(150);
            v["reconstruct"] = json!({ "given": { "path": "no.ply", "time": time.clone() } });
        }
    };
    refused(&given(json!({ "duration": 1, "rate": 2 })), "plan", 2, "and rate exclude each other");
    refused(&given(json!({ "duration": 1 })), "build", 2, "no.ply");
    refused(&given(json!({ "rate": 1 })), "build", 2, "no.ply");
    let objects = |v: &mut Value| {
        v["objects"] = json!([{
            "name": "orange",
            "select": { "sphere": { "centre": [0.32, -0.66, -0.04], "radius": 0.24 } },
            "path": { "straight": { "velocity": [6, -4, 0] } },
        }]);
    };
    refused(&objects, "plan", 2, "has 1 objects in a scene that changes with time, wanted 0");
    // The trajectory of 50 ms takes 0.5 s + 8 * 50 ms of the scene.
    refused(
        &fountain("duration", json!(0.7)),
        "build",
        1,
        "the scene lasts from 0 to 0.7 s, found a view at 0.7",
    );
}
