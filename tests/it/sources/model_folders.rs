//! Recipes over 3DGS model folders: poses from `cameras.json`, and the newest Gaussians.

use crate::support::given;
use crate::support::workspace::Workspace;
use serde_json::{Value, json};
use std::fs;

/// The views of [`given::transforms`] as a trainer writes them: rows of the rotation in OpenCV
/// axes.
fn cameras() -> String {
    let camera = |i: u32| {
        let (sin, cos) = (0.002 * f64::from(i)).sin_cos();
        json!({
            "id": i, "img_name": format!("{i:03}"), "width": 64, "height": 48, "fx": 60.0, "fy": 60.0,
            "position": [4.0 * sin, 0.0, 4.0 * cos],
            "rotation": [[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]],
        })
    };
    (0..6).rev().map(camera).collect::<Value>().to_string()
}

fn place() -> Workspace {
    let place = Workspace::new();
    let recipe = given::GIVEN
        .replace("nerfstudio: { path: transforms.json }", "model: { path: trained }")
        .replace("reconstruct: { given: { path: scene.ply } }\n", "");
    place.write("recipe.yaml", recipe + "licence: { expression: CC0-1.0, holder: a test }\n");
    place.write("trained/cameras.json", cameras());
    place.write(
        "trained/point_cloud/iteration_7000/point_cloud.ply",
        given::ply(|column, v| if column == 0 { v + 9.0 } else { v }),
    );
    place.write("trained/point_cloud/iteration_30000/point_cloud.ply", given::ply(|_, value| value));
    place
}

#[test]
fn a_model_folder_is_its_poses_and_its_newest_gaussians() {
    let place = place();
    place.ok("release --to tree recipe.yaml");
    place.ok("audit tree");
    let scene: Value = place.json("tree/given/scene.json");
    assert_eq!(scene["source"]["kind"], "model");
    assert_eq!(scene["images"].as_array().unwrap().len(), 6);
    assert_eq!(scene["recipe"]["source"], json!({ "model": { "path": "trained" } }));
    assert_eq!(scene["recipe"].get("reconstruct"), None);

    // The same views and Gaussians through nerfstudio and a file give the same events.
    let other = given::sound();
    let recipe = given::GIVEN.to_owned() + "licence: { expression: CC0-1.0, holder: a test }\n";
    other.write("recipe.yaml", recipe);
    other.ok("release --to tree recipe.yaml");
    for file in ["base/poses.txt", "base/events.h5"] {
        let [a, b] =
            [&place, &other].map(|place| fs::read(place.path(&format!("tree/given/{file}"))).unwrap());
        assert_eq!(a, b, "{file}");
    }
}

#[test]
fn gaussians_that_were_trained_further_are_built_again() {
    let place = place();
    place.ok("build recipe.yaml");
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
    // A folder without its file belongs to an unfinished training.
    fs::create_dir(place.path("trained/point_cloud/iteration_60000")).unwrap();
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
    place.write(
        "trained/point_cloud/iteration_60000/point_cloud.ply",
        given::ply(|column, v| if column == 1 { v + 0.1 } else { v }),
    );
    assert_eq!(place.stale("recipe.yaml")[0], "given/reconstruct");
    let made = place.build("recipe.yaml");
    assert!(
        ["given/reconstruct", "given/base/events"].iter().all(|step| made.iter().any(|m| m == step)),
        "{made:?}"
    );
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
}

#[test]
fn a_folder_without_gaussians_is_named() {
    let place = place();
    fs::remove_dir_all(place.path("trained/point_cloud")).unwrap();
    let ended = place.gs2e("build recipe.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("point_cloud"), "{}", ended.stderr);
}
