//! Images of an independent renderer, through the verb. The limits are those of
//! `crates/render/tests/rendering/cases.rs`, the cameras those of the manifest.

use super::npy;
use crate::support::workspace::Workspace;
use crate::support::{golden, shared};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Mean and largest difference.
const LIMITS: [f64; 2] = [2e-5, 5e-3];

fn difference(found: &[f32], wanted: &[f32]) -> [f64; 2] {
    assert_eq!(found.len(), wanted.len());
    let each = || found.iter().zip(wanted).map(|(a, b)| f64::from((a - b).abs()));
    [each().sum::<f64>() / wanted.len() as f64, each().fold(0.0, f64::max)]
}

#[test]
fn the_verb_meets_goldens_of_every_kind() {
    meets(
        &golden::folder("render"),
        &[
            ("needle.official", &["cpu", "reference"]),
            ("nearplane.exact", &["cpu", "reference"]),
            ("opaque_stack.official", &["auto"]),
            ("offset1e6.exact", &["cpu"]),
            ("nan.exact", &["cpu"]),
        ],
    );
}

#[test]
fn the_verb_meets_goldens_of_a_captured_scene() {
    let Some(root) = shared::path("data/golden/render") else { return };
    meets(&root, &[("playbot_lod3_v4.gsplat.aa", &["cpu"]), ("playbot_lod3_v21.official", &["cpu"])]);
}

/// Renders named cases with the given back ends, and compares the images.
fn meets(root: &Path, cases: &[(&str, &[&str])]) {
    let manifest: Vec<Value> =
        serde_json::from_slice(&fs::read(root.join("manifest.json")).unwrap()).unwrap();
    let place = Workspace::new();
    for &(name, backends) in cases {
        let case = manifest.iter().find(|case| case["name"] == name).unwrap();
        let text = |key: &str| case[key].as_str().unwrap();
        let golden = case["same_as"].as_str().unwrap_or(name);
        place.write("camera.json", case["camera"].to_string());
        let scene = root.join(text("ply"));
        let background: Vec<String> =
            case["background"].as_array().unwrap().iter().map(ToString::to_string).collect();
        let antialiased = if case["antialiased"] == true { "--antialiased" } else { "" };
        let args = format!(
            "render --scene {} --view camera.json --rules {} {antialiased} --background {} --out found.npy",
            scene.display(),
            text("mode"),
            background.join(",")
        );
        for backend in backends {
            for channel in ["rgb", "alpha"] {
                place.ok(&format!("{args} --backend {backend} --channel {channel} -q"));
                let (shape, found) = npy(&fs::read(place.path("found.npy")).unwrap());
                let (expected, wanted) =
                    npy(&fs::read(root.join(format!("{golden}.{channel}.npy"))).unwrap());
                assert_eq!(shape, expected, "{name}");
                let apart = difference(&found, &wanted);
                let within = apart.iter().zip(LIMITS).all(|(apart, limit)| *apart <= limit);
                assert!(within, "{name}, {channel} by {backend}: {apart:?}");
            }
        }
    }
}
