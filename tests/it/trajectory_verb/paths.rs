//! Every kind of path through the verb, with a capture and without.

use super::{planted, transforms_json};
use crate::support::given::ply;
use crate::support::steps::steps;
use crate::support::workspace::{Workspace, tree};
use serde_json::{Value, json};
use std::fs;

/// Every kind of path, on the planted capture and the scene of `scene.ply`.
fn all_kinds() -> Value {
    let place = |x: f64| json!({ "position": [x, 0, 4], "look_at": [0, 0, 0], "up": [0, 1, 0] });
    json!({
        "version": 1,
        "scene": "all/kinds",
        "seed": 7,
        "source": { "nerfstudio": { "path": "transforms.json" } },
        "reconstruct": { "given": { "path": "scene.ply" } },
        "camera": { "width": 64, "height": 48 },
        "trajectories": [
            { "name": "mini", "novel": { "base": "base", "groups": 2, "keyframes": 3, "frames": 9 } },
            { "name": "base", "refine": { "frames": 20 } },
            { "name": "round", "orbit": { "arc": 30, "frames": 9 } },
            { "name": "given", "orbit": { "centre": [0, 0, 0], "from": [0, 0, 4], "up": [0, 1, 0], "arc": 30 } },
            { "name": "hand", "keyframes": { "poses": [place(-0.5), place(0.0), place(0.5)], "frames": 7 } },
            { "name": "swift", "refine": {}, "speed": { "flow": { "px_s": 24000, "function": "1 + t" } } },
            {
                "name": "past",
                "keyframes": { "poses": [place(-0.5), place(0.0), place(0.5)] },
                "speed": { "flow": { "px_s": 12000 } }
            }
        ],
        "outputs": [],
        "licence": { "expression": "CC0-1.0", "holder": "Nobody" }
    })
}

fn place() -> Workspace {
    let place = Workspace::new();
    place.write("scene.ply", ply(|_, value| value));
    place.write("transforms.json", transforms_json(&planted(false)).to_string());
    place.write("recipe.yaml", all_kinds().to_string());
    place
}

const FILES: &str = "--out poses.txt --report speed.json --svg trajectory.svg --stamps timestamps_us.txt";

#[test]
fn every_path_is_that_of_a_release() {
    let place = place();
    place.ok("build -q recipe.yaml");
    let built = steps(&place, "recipe.yaml");
    for name in ["mini-0", "mini-1", "base", "round", "given", "hand", "swift", "past"] {
        let sources = "--capture transforms.json --scene scene.ply --recipe recipe.yaml";
        place.ok(&format!("trajectory -q {sources} --name {name} {FILES}"));
        for (role, path) in &built[&format!("all/kinds/{name}/trajectory")].outputs {
            assert!(
                fs::read(place.path(role)).unwrap() == fs::read(path).unwrap(),
                "{name}: other bytes in {role}"
            );
        }
    }
}

#[test]
fn paths_that_are_written_need_no_capture() {
    let place = place();
    for name in ["given", "hand"] {
        let ended = place.ok(&format!("trajectory --recipe recipe.yaml --name {name} --out out.txt --json"));
        let message: Value = serde_json::from_str(&ended.stdout).unwrap();
        // The recipe's camera takes its field of view from a capture.
        assert_eq!((&message["capture"], &message["px_per_frame"]), (&Value::Null, &Value::Null));
        assert!(!ended.stderr.contains("px from frame to frame"), "{}", ended.stderr);
    }
    let mut whole = all_kinds();
    whole["camera"]["fx"] = json!(60);
    place.write("whole.yaml", whole.to_string());
    let message = place.ok("trajectory --recipe whole.yaml --name given --out out.txt").stderr;
    assert!(message.contains("focal length 60.0 px"), "{message}");
    place.ok("trajectory --recipe whole.yaml --name past --scene scene.ply --out out.txt");
}

#[test]
fn missing_inputs_of_a_path_are_requested() {
    let place = place();
    place.write("broken.ply", "ply\nformat ascii 1.0\n");
    let before = tree(&place.path(""));
    let t = |args: &str, code: i32, parts: &[&str]| {
        let ended = place.gs2e(&format!("trajectory --recipe recipe.yaml --out out.txt {args}"));
        assert_eq!(ended.code, code, "{args}\n{}", ended.stderr);
        for part in parts {
            assert!(ended.stderr.contains(part), "{args}: `{part}` is not in\n{}", ended.stderr);
        }
        assert!(tree(&place.path("")) == before, "{args}: files were changed");
    };
    let capture = "--capture transforms.json";
    t("--name mini-1", 2, &["`base` needs a capture"]);
    t("--name round", 2, &["`round` needs a capture"]);
    t("--name mini", 2, &["no trajectory `mini`", "mini-0, mini-1"]);
    t(
        &format!("--name swift {capture}"),
        2,
        &["`swift` is in pixels per second, and no scene is given", "--scene"],
    );
    t("--name past --scene scene.ply", 2, &["there is no camera", "camera: { width, height, fx"]);
    t(&format!("--name swift {capture} --scene gone.ply"), 2, &["scene: gone.ply does not exist"]);
    t(&format!("--name swift {capture} --scene broken.ply"), 1, &["failed to read the scene"]);
}
