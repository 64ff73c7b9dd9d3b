//! Real scenes and real captures at small sizes, if the folder of test data is there.

use crate::support::shared;
use crate::support::steps::{recipe, steps};
use crate::support::workspace::Workspace;
use serde_json::{Value, json};
use std::fs;

/// The finding of one check about one part of the stream.
fn finding<'a>(findings: &'a [Value], check: &str, part: &str) -> &'a Value {
    let found =
        findings.iter().find(|f| f["check"] == check && f["subject"].as_str().unwrap().ends_with(part));
    found.unwrap_or_else(|| panic!("no finding of {check}, {part} in {findings:#?}"))
}

/// A scene of 31,000 Gaussians with 30 views is released and judged, and its thresholds are
/// recovered from the events.
#[test]
fn a_real_scene_at_a_small_size() {
    let (Some(scene), Some(views)) =
        (shared::path("data/scenes/playbot_lod3.ply"), shared::path("data/scenes/playbot.transforms.json"))
    else {
        return;
    };
    let mut value = recipe("playbot");
    value["source"] = json!({ "nerfstudio": { "path": views } });
    value["reconstruct"] = json!({ "given": { "path": scene } });
    value["camera"] = json!({ "width": 160, "height": 90 });
    value["licence"] = json!({ "expression": "CC-BY-4.0", "holder": "Stephane Agullo" });
    // The two thresholds differ, so that they cannot be confused.
    value["sensor"] =
        json!({ "voltmeter": { "preset": "dvs346-paper", "threshold": { "on": 1.0, "off": 1.25 } } });
    let place = Workspace::new();
    place.write("playbot.yaml", value.to_string());
    place.ok("build playbot.yaml");

    let found = place.ok("check --json --recipes playbot.yaml").stdout;
    let findings: Vec<Value> = found.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let failed: Vec<&Value> = findings.iter().filter(|f| f["verdict"] == "fail").collect();
    assert!(failed.is_empty(), "{failed:#?}");
    for (part, stated) in [("threshold-on", 1.0), ("threshold-off", 1.25)] {
        let fitted = finding(&findings, "event_frame", part);
        assert_eq!(fitted["verdict"], "pass", "{fitted}");
        let (measured, limit) = (fitted["measured"].as_f64().unwrap(), fitted["limit"].as_f64().unwrap());
        eprintln!("playbot at 160x90, {part}: fitted {measured:.4}, stated {stated}");
        assert!((measured - stated).abs() <= (limit - stated).abs(), "{fitted}");
    }
    assert_eq!(finding(&findings, "event_frame", "gain")["verdict"], "pass");

    let outputs = &steps(&place, "playbot.yaml")["playbot/base/events"].outputs;
    let simulation: Value = serde_json::from_slice(&fs::read(&outputs["simulation.json"]).unwrap()).unwrap();
    let account = &simulation["streams"][0]["account"];
    let [on, off] = ["on", "off"].map(|side| account[side].as_f64().unwrap());
    eprintln!("playbot at 160x90, 60 poses: {} events, ON share {:.3}", on + off, on / (on + off));
    assert!(on + off > 10_000.0, "{account}");
    assert!((0.3..0.7).contains(&(on / (on + off))), "{account}");
}

/// A hand-held capture's COLMAP model through `capture` and `trajectory`. The scene belongs to
/// another capture: only the wiring is tested, and without the photos, which would be compared at
/// full size.
#[test]
fn a_colmap_model_at_a_small_size() {
    let (Some(scene), Some(model)) =
        (shared::path("data/scenes/playbot_lod3.ply"), shared::path("data/captures/fox/sparse/0"))
    else {
        return;
    };
    let mut value = recipe("fox");
    let place = Workspace::new();
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        place.write(&format!("fox/sparse/0/{file}"), fs::read(model.join(file)).unwrap());
    }
    value["source"] = json!({ "colmap": { "path": "fox" } });
    value["reconstruct"] = json!({ "given": { "path": scene } });
    value["outputs"] = json!(["sharp"]);
    value["sharp"] = json!({ "every": 1000 });
    place.write("fox.yaml", value.to_string());
    place.ok("build fox.yaml");
    let outputs = &steps(&place, "fox.yaml")["fox/base/trajectory"].outputs;
    let poses = fs::read_to_string(&outputs["poses.txt"]).unwrap();
    // 50 views, all registered, at twice the density.
    assert_eq!(poses.lines().filter(|line| !line.starts_with('#')).count(), 100);
    // COLMAP's own figures for its points, to the digits that it prints, and the frames that did
    // not register.
    let found = place.gs2e("check --json --recipes fox.yaml").stdout;
    let findings: Vec<Value> = found.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for (part, wanted) in [("#reprojection", 1.09), ("#reprojection-observations", 1.15)] {
        let measured = finding(&findings, "capture", part)["measured"].as_f64().unwrap();
        assert!((measured - wanted).abs() < 0.005, "{part}: {measured}");
    }
    assert_eq!(finding(&findings, "capture", "#gap")["verdict"], "warn");
    assert_eq!(finding(&findings, "capture", "#outlier")["verdict"], "pass");
    assert_eq!(finding(&findings, "recon_psnr", "#mean")["verdict"], "not-run");
    assert_eq!(place.build("fox.yaml"), [""; 0]);
}

/// A capture with its photos and without a scene: its path and its known properties.
#[test]
fn a_capture_is_released_before_it_has_a_scene() {
    let Some(capture) = shared::path("data/captures/fox") else { return };
    let place = Workspace::new();
    let recipe = json!({
        "version": 1, "scene": "lab/fox", "seed": 7, "source": { "colmap": { "path": capture } }, "outputs": [],
        "trajectories": [
            { "name": "base", "refine": { "window": 2, "factor": 5 }, "speed": { "function": "0.25*sin(t) + 1.1" } },
            { "name": "mini", "novel": { "groups": 2 } },
        ],
        "licence": { "expression": "CC-BY-4.0", "holder": "a test" },
    });
    place.write("fox.yaml", recipe.to_string());
    let steps: Vec<String> = place.plan("fox.yaml").into_iter().map(|(step, _)| step).collect();
    assert!(!steps.iter().any(|s| s.ends_with("/reconstruct") || s.ends_with("/fidelity")), "{steps:?}");
    place.ok("release --to tree fox.yaml");
    place.ok("audit tree");
    let read = |file: &str| fs::read_to_string(place.path(&format!("tree/lab/fox/{file}"))).unwrap();
    let value = |file: &str| serde_json::from_str::<Value>(&read(file)).unwrap();
    for (trajectory, poses) in [("base", 250), ("mini-0", 150), ("mini-1", 150)] {
        let lines = read(&format!("{trajectory}/poses.txt"));
        assert_eq!(lines.lines().filter(|line| !line.starts_with('#')).count(), poses);
        // Every step has its share of the path, within the promise of renormalisation.
        let mixed = &value(&format!("{trajectory}/speed.json"))["mixed_ratio"];
        for end in ["min", "max"] {
            assert!((mixed[end].as_f64().unwrap() - 1.0).abs() < 1e-6, "{trajectory}: {mixed}");
        }
        assert!(read(&format!("{trajectory}/trajectory.svg")).starts_with("<svg"));
    }
    let scene = value("scene.json");
    assert_eq!(scene["reconstruction"], Value::Null);
    assert_eq!(scene["images"].as_array().unwrap().len(), 50);
    // 1080x1920, through the lens that COLMAP solved. No photo is copied.
    assert_eq!(scene["camera"]["undistorted_from"]["OPENCV"]["k"].as_array().unwrap().len(), 4);
    let findings = value("checks.json");
    let finding = finding(findings.as_array().unwrap(), "recon_psnr", "#mean");
    assert_eq!(
        (&finding["verdict"], &finding["because"]),
        (&"not-run".into(), &"there is no scene to render".into())
    );
}
