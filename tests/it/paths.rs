//! Scenes with every kind of path: their steps, their inputs, and their results.

use crate::support::given::ply;
use crate::support::steps::{keys, recipe};
use crate::support::workspace::Workspace;
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_trajectory::Trajectory;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;

/// The embedded scene, with an arc that is wide enough for its optical axes to meet.
fn wide(trajectories: Value) -> Value {
    let mut value = recipe("paths");
    value["source"]["procedural"]["arc"] = json!(20);
    value["trajectories"] = trajectories;
    value
}

/// Refine, orbit, keyframes, and refine at a flow.
fn all_kinds() -> Value {
    let poses = json!([
        { "position": [0, 0.2, 4], "look_at": [0, 0, 0], "up": [0, 1, 0] },
        { "position": [0.3, 0.2, 4], "look_at": [0, 0, 0], "up": [0, 1, 0] },
        { "position": [0.3, 0.2, 4.2], "rotation": [0, 1, 0, 0] }
    ]);
    wide(json!([
        { "name": "base", "refine": { "frames": 12 } },
        { "name": "round", "orbit": { "arc": 10, "frames": 9 } },
        { "name": "hand", "keyframes": { "poses": poses, "frames": 7 } },
        { "name": "swift", "refine": {}, "speed": { "flow": { "px_s": 600, "function": "1 + t" } } }
    ]))
}

/// A scene file without a capture: a full turn about it, and a flow along keyframes.
fn without_capture() -> Value {
    let place = |x: f64| json!({ "position": [x, 0, 4], "look_at": [0, 0, 0], "up": [0, 1, 0] });
    json!({
        "version": 1,
        "scene": "bare",
        "seed": 7,
        "source": "none",
        "reconstruct": { "given": { "path": "scene.ply" } },
        "camera": { "width": 64, "height": 48, "fx": 60 },
        "trajectories": [
            {
                "name": "round",
                "orbit": { "centre": [0.5, 0, 0], "from": [0.5, 3, 4], "up": [0, 2, 0], "arc": 360, "frames": 9 }
            },
            {
                "name": "past",
                "keyframes": { "poses": [place(-0.5), place(0.0), place(0.5)] },
                "speed": { "flow": { "px_s": 200 } }
            }
        ],
        "licence": { "expression": "CC0-1.0", "holder": "Nobody" }
    })
}

/// A folder with the recipe and a scene file.
fn place(recipe: &Value) -> Workspace {
    let place = Workspace::new();
    place.write("scene.ply", ply(|_, value| value));
    place.write("recipe.yaml", recipe.to_string());
    place
}

fn poses(place: &Workspace, trajectory: &str) -> Trajectory {
    let file = File::open(place.path(&format!("out/{trajectory}/poses.txt"))).unwrap();
    Trajectory::read_poses(BufReader::new(file)).unwrap()
}

/// The steps of a plan, by their names within the scene.
fn steps(place: &Workspace) -> Vec<String> {
    let plan = place.plan("recipe.yaml");
    plan.into_iter().map(|(step, _)| step.split_once('/').unwrap().1.to_owned()).collect()
}

/// The inputs that a step takes from others, by role.
fn inputs(place: &Workspace, step: &str) -> Vec<String> {
    let ended = place.ok(&format!("why --json {step} --recipes recipe.yaml"));
    let why: Value = serde_json::from_str(&ended.stdout).unwrap();
    let lines = why["description"].as_array().unwrap();
    let paths = lines.iter().map(|line| line["path"].as_str().unwrap());
    paths.filter_map(|path| path.strip_prefix("inputs.").map(str::to_owned)).collect()
}

/// The direction of view and the direction of the image's top, in the world.
fn axes(pose: &Se3) -> [DVec3; 2] {
    [pose.rotation * DVec3::Z, pose.rotation * DVec3::NEG_Y]
}

/// Compares within the rounding of text and arithmetic for numbers of this size.
fn near(found: DVec3, wanted: DVec3) {
    assert!((found - wanted).length() < 1e-9, "{found}, wanted {wanted}");
}

#[test]
fn each_path_takes_only_its_inputs() {
    let place = place(&all_kinds());
    let trajectories = ["base", "round", "hand", "swift"];
    let below = |name: &str| ["trajectory", "events", "sharp", "checks"].map(|step| format!("{name}/{step}"));
    let mut wanted = vec!["capture".to_owned(), "reconstruct".to_owned()];
    wanted.extend(trajectories.into_iter().flat_map(below));
    assert_eq!(steps(&place), wanted);
    place.ok("build -q recipe.yaml");
    let t = |name: &str, wanted: &[&str]| {
        assert_eq!(inputs(&place, &format!("paths/{name}/trajectory")), wanted, "{name}");
    };
    t("base", &["capture"]);
    t("round", &["capture"]);
    t("hand", &[]);
    t("swift", &["capture", "gaussians"]);
}

#[test]
fn all_kinds_of_paths_are_released() {
    let place = place(&all_kinds());
    place.ok("release -q --to out recipe.yaml");
    let scene = place.json("out/paths/scene.json");
    let part = |i: usize| &scene["trajectories"][i];
    let kinds: Vec<_> = (0..4).map(|i| part(i)["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["refine", "orbit", "keyframes", "refine"]);
    for (i, kind) in kinds.iter().enumerate() {
        let parameters = part(i)["parameters"].as_object().unwrap();
        assert_eq!(parameters.keys().map(String::as_str).collect::<Vec<_>>(), [*kind, "speed"]);
    }
    assert_eq!(scene["attributes"]["multi_trajectory"], true);
    let card = std::fs::read_to_string(place.path("out/README.md")).unwrap();
    assert!(card.contains("| paths/round | procedural | orbit |"), "{card}");

    // An orbit keeps its distance r from the target: p + r d is the same at all poses.
    let round = poses(&place, "paths/round").world_from_camera;
    let ([first, _], [last, _], travelled) =
        (axes(&round[0]), axes(&round[8]), round[8].translation - round[0].translation);
    let distance = travelled.length() / (last - first).length();
    assert_eq!(round.len(), 9);
    for pose in &round {
        near(pose.translation + axes(pose)[0] * distance, round[0].translation + first * distance);
    }
    // At a constant speed.
    let steps = round.windows(2).map(|pair| (pair[1].translation - pair[0].translation).length());
    let steps: Vec<f64> = steps.collect();
    assert!(steps.iter().all(|step| (step / steps[0] - 1.0).abs() < 1e-6), "{steps:?}");

    // A curve through the given poses begins and ends in them.
    let hand = poses(&place, "paths/hand").world_from_camera;
    near(hand[0].translation, DVec3::new(0.0, 0.2, 4.0));
    near(axes(&hand[0])[0], DVec3::new(0.0, -0.2, -4.0).normalize());
    near(hand[6].translation, DVec3::new(0.3, 0.2, 4.2));
    assert!(hand[6].rotation.dot(DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0)).abs() > 1.0 - 1e-12);

    flows(&place, "paths/swift", 600.0);
}

/// A flow determines the duration of the path.
fn flows(place: &Workspace, trajectory: &str, px_s: f64) {
    let speed = place.json(&format!("out/{trajectory}/speed.json"));
    let px = speed["flow"]["px"].as_f64().unwrap();
    let frames = 1.0 + (px / px_s * 2400.0).ceil();
    assert_eq!(speed["M"].as_f64(), Some(frames), "{px} px");
    assert!((3.0..100.0).contains(&frames), "{px} px");
}

#[test]
fn a_scene_file_needs_no_capture() {
    let place = place(&without_capture());
    place.ok("release -q --to out recipe.yaml");
    place.ok("audit out");
    assert_eq!(inputs(&place, "bare/round/trajectory"), [""; 0]);
    assert_eq!(inputs(&place, "bare/past/trajectory"), ["capture", "gaussians"]);
    let scene = place.json("out/bare/scene.json");
    let source = (&scene["source"]["kind"], &scene["reconstruction"]["kind"]);
    assert_eq!(source, (&json!("none"), &json!("given")));
    assert_eq!(scene["attributes"]["data_source"], "none");
    assert_eq!(scene["images"], json!([]));
    let camera = &scene["camera"];
    let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(|key| camera[key].as_f64().unwrap());
    assert_eq!((fx, fy, cx, cy), (60.0, 60.0, 32.0, 24.0));
    flows(&place, "bare/past", 200.0);

    let centre = DVec3::new(0.5, 0.0, 0.0);
    let round = poses(&place, "bare/round").world_from_camera;
    for (j, pose) in round.iter().enumerate() {
        // A ninth pose closes the turn of 360 degrees, right-handed about y.
        let (sin, cos) = (std::f64::consts::TAU * j as f64 / 8.0).sin_cos();
        let arm = DVec3::new(4.0 * sin, 3.0, 4.0 * cos);
        near(pose.translation, centre + arm);
        near(axes(pose)[0], -arm / 5.0);
        // The image's top points along the part of up that is perpendicular to the view.
        near(axes(pose)[1], DVec3::new(-0.6 * sin, 0.8, -0.6 * cos));
    }
}

#[test]
fn an_additional_trajectory_changes_no_other() {
    let mut value = without_capture();
    let place = place(&value);
    place.ok("build -q recipe.yaml");
    let before = keys(&place, "recipe.yaml");
    let more = json!({
        "name": "back",
        "orbit": { "centre": [0, 0, 0], "from": [0, 0, 4], "up": [0, 1, 0], "arc": -30, "frames": 3 }
    });
    value["trajectories"].as_array_mut().unwrap().insert(0, more);
    place.write("recipe.yaml", value.to_string());
    let mut made = place.build("recipe.yaml");
    made.sort();
    assert_eq!(made, ["checks", "events", "sharp", "trajectory"].map(|step| format!("bare/back/{step}")));
    let mut after = keys(&place, "recipe.yaml");
    after.retain(|step, _| !step.starts_with("bare/back/"));
    assert_eq!(after, before);
}

/// The views of a flow enter its key: the camera, the rendering, the scene. No other path renders.
#[test]
fn only_a_flow_depends_on_the_rendering() {
    let mut value = without_capture();
    let place = place(&value);
    place.ok("build -q recipe.yaml");
    value["render"] = json!({ "background": [0.5, 0.5, 0.5] });
    place.write("recipe.yaml", value.to_string());
    let stale = place.stale("recipe.yaml");
    let trajectories: Vec<&String> = stale.iter().filter(|step| step.ends_with("/trajectory")).collect();
    assert_eq!(trajectories, ["bare/past/trajectory"]);
}

/// Stamps of a varied frame rate pass the checks and the audit.
#[test]
fn a_varied_frame_rate_is_released() {
    let list = json!({ "multipliers": [1, 2], "blend": 0, "meaning": "frame-rate" });
    let mut value = without_capture();
    value["trajectories"][0]["speed"] = json!({ "list": list });
    value["trajectories"].as_array_mut().unwrap().truncate(1);
    let place = place(&value);
    place.ok("release -q --to out recipe.yaml");
    place.ok("audit out");
    // Four steps of 1/2400 s, then four of half that: a step belongs to the level at its start.
    let wanted = [0, 417, 833, 1250, 1667, 1875, 2083, 2292, 2500];
    assert_eq!(poses(&place, "bare/round").stamps_us, wanted);
    assert_eq!(place.json("out/bare/scene.json")["attributes"]["speed_profile"], "uniform");
}

/// A base of 30 poses and two groups of three key poses that are drawn from it.
fn with_novel() -> Value {
    wide(json!([
        { "name": "mini", "novel": { "groups": 2, "keyframes": 3, "frames": 7, "curve": "cubic" } },
        { "name": "base", "refine": { "frames": 30 } }
    ]))
}

#[test]
fn groups_have_steps_of_their_own_after_their_base() {
    let place = place(&with_novel());
    let steps = steps(&place);
    let at = |step: &str| steps.iter().position(|s| s == step).unwrap_or_else(|| panic!("{step}: {steps:?}"));
    for group in ["mini-0", "mini-1"] {
        assert!(at("base/trajectory") < at(&format!("{group}/trajectory")));
        for step in ["events", "sharp", "checks"] {
            assert!(at(&format!("{group}/{step}")) > at(&format!("{group}/trajectory")));
        }
    }
    assert_eq!(steps.len(), 2 + 3 * 4);
}

#[test]
fn key_poses_are_drawn_from_the_base() {
    let place = place(&with_novel());
    place.ok("release -q --to out recipe.yaml");
    assert_eq!(inputs(&place, "paths/mini-0/trajectory"), ["trajectory"]);
    let scene = place.json("out/paths/scene.json");
    let seeds: Vec<&String> = scene["seeds"].as_object().unwrap().keys().collect();
    let wanted = ["base/sensor", "mini-0/sensor", "mini-1/sensor", "mini/curve", "mini/keyframes"];
    assert_eq!(seeds, wanted);
    let parts: BTreeMap<&str, &Value> =
        scene["trajectories"].as_array().unwrap().iter().map(|t| (t["name"].as_str().unwrap(), t)).collect();
    let base = poses(&place, "paths/base").world_from_camera;
    let mut drawn = Vec::new();
    for group in ["mini-0", "mini-1"] {
        let part = parts[group];
        assert_eq!((&part["kind"], &part["poses"]), (&json!("novel"), &json!(7)));
        assert_eq!(part["parameters"]["novel"]["base"], "base");
        let keyframes: Vec<u64> = serde_json::from_value(part["keyframes"].clone()).unwrap();
        assert!(keyframes.len() == 3 && keyframes.is_sorted(), "{keyframes:?}");
        let mini = poses(&place, &format!("paths/{group}"));
        assert_eq!((mini.stamps_us[0], mini.world_from_camera.len()), (0, 7));
        let ends = [(0, keyframes[0]), (6, keyframes[2])];
        for (pose, key) in ends {
            near(mini.world_from_camera[pose].translation, base[usize::try_from(key).unwrap()].translation);
        }
        drawn.extend(keyframes);
    }
    drawn.sort_unstable();
    drawn.dedup();
    assert_eq!(drawn.len(), 6, "no pose is drawn twice");
}
