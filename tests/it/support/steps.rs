//! A plan as the program prints it, and the smallest complete recipe.

use super::workspace::Workspace;
use gs2e_store::Digest;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// 300 Gaussians, 6 views, 12 poses, 48x32 pixels. It is a JSON value, so that tests can edit it.
pub(crate) fn recipe(scene: &str) -> Value {
    serde_json::json!({
        "version": 1,
        "scene": scene,
        "seed": 7,
        "source": { "procedural": { "gaussians": 300, "views": 6, "arc": 0.5, "seed": 1 } },
        "camera": { "width": 48, "height": 32 },
        "trajectories": [{ "name": "base", "refine": { "factor": 2 } }],
        "sensor": { "voltmeter": { "preset": "dvs346-paper" } },
        "licence": { "expression": "CC0-1.0", "holder": "Nobody" }
    })
}

/// One step of `plan --json`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Step {
    pub(crate) action: String,
    pub(crate) code: String,
    pub(crate) key: Option<String>,
    /// Path in the store by role.
    pub(crate) outputs: BTreeMap<String, PathBuf>,
}

/// The steps of a plan by `scene/step`.
pub(crate) fn steps(place: &Workspace, recipes: &str) -> BTreeMap<String, Step> {
    let ended = place.ok(&format!("plan --json {recipes}"));
    let list: Vec<Value> = serde_json::from_str(&ended.stdout).expect("the plan is one JSON array");
    list.iter()
        .map(|step| (format!("{}/{}", text(&step["scene"]), text(&step["step"])), read(place, step)))
        .collect()
}

fn read(place: &Workspace, step: &Value) -> Step {
    let outputs = step["outputs"].as_array().expect("a step has a list of outputs");
    Step {
        action: text(&step["action"]),
        code: text(&step["reason"]["code"]),
        key: step["key"].as_str().map(str::to_owned),
        outputs: outputs.iter().map(|o| (text(&o["role"]), place.path(&text(&o["path"])))).collect(),
    }
}

/// The keys of a plan after a build.
pub(crate) fn keys(place: &Workspace, recipes: &str) -> BTreeMap<String, String> {
    let steps = steps(place, recipes).into_iter();
    steps.map(|(name, step)| (name, step.key.expect("what is built has a key"))).collect()
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

/// Digests of all products, read from the store. Every step must be up to date, and every file must
/// match its name.
pub(crate) fn products(place: &Workspace, recipes: &str) -> BTreeMap<(String, String), Digest> {
    let mut products = BTreeMap::new();
    for (name, step) in steps(place, recipes) {
        assert_eq!(step.action, "keep", "{name}");
        for (role, path) in step.outputs {
            let digest = Digest::of_bytes(&std::fs::read(&path).expect("a product can be read"));
            let is_named = path.ends_with(digest.to_string());
            assert!(is_named, "{name}, {role}: the bytes are not those of the name");
            products.insert((name.clone(), role), digest);
        }
    }
    products
}
