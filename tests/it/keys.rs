//! The contents of a key: the projection table of the engine, as data.
//!
//! Keys are compared with the inputs from other steps held fixed, so that a change shows in the
//! stages that read the field themselves, and not in later ones.

use crate::support::steps::{keys, recipe};
use crate::support::workspace::Workspace;
use gs2e_build::plan::Plan;
use gs2e_build::plan::assess::read_sources;
use gs2e_recipe::{Recipe, read_all};
use gs2e_render::backend::Backend;
use gs2e_store::{Digest, Key, Store, StoreAccess};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

const CAPTURE: &str = "capture";
const RECONSTRUCT: &str = "reconstruct";
const TRAJECTORY: &str = "trajectory";
const EVENTS: &str = "events";
const SHARP: &str = "sharp";
const CHECKS: &str = "checks";

/// Reads the recipes in a file.
fn read(path: &Path) -> Vec<Recipe> {
    read_all(&[path.to_owned()]).unwrap_or_else(|faults| panic!("{}", faults.render_text()))
}

/// Reads the recipe from a folder of its own.
fn parse(value: &Value) -> Recipe {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recipe.yaml");
    std::fs::write(&path, value.to_string()).unwrap();
    read(&path).remove(0)
}

/// The key of each stage. Every input from another step is the digest of its role.
fn stage_keys(recipe: Recipe) -> BTreeMap<&'static str, Key> {
    let nowhere = tempfile::tempdir().unwrap();
    let store = Store::open(&nowhere.path().join("store"), StoreAccess::Read, &mut |_| {}).unwrap();
    let plan = Plan::new(vec![recipe], &Backend::Cpu);
    let mut keys = BTreeMap::new();
    for planned in plan.steps() {
        let made = planned.step.inputs().into_iter();
        let mut inputs: Vec<_> =
            made.map(|(role, _)| (role.to_owned(), Digest::of_bytes(role.as_bytes()))).collect();
        inputs.extend(read_sources(&plan, &store, planned).unwrap().digests);
        keys.insert(planned.step.stage(), Key::of_description(&planned.step.describe(&inputs)));
    }
    keys
}

/// The stages whose keys differ.
fn rekeyed(a: &BTreeMap<&'static str, Key>, b: &BTreeMap<&'static str, Key>) -> Vec<&'static str> {
    let mut stages: Vec<&str> = a.keys().chain(b.keys()).copied().collect();
    stages.sort_unstable();
    stages.dedup();
    stages.into_iter().filter(|stage| a.get(stage) != b.get(stage)).collect()
}

/// Field (JSON pointer), another value within its range, and the stages that read the field.
fn table() -> Vec<(&'static str, Value, Vec<&'static str>)> {
    let of_rendering = vec![EVENTS, SHARP];
    let k = json!([5.265, 20.0, 1e-4, 1e-7, 5e-9, 2e-5]);
    vec![
        // The scene enters through the seed of the sensor's stream, which derives from (seed,
        // scene, trajectory, purpose).
        ("/scene", json!("other"), vec![EVENTS]),
        ("/seed", json!(8), vec![EVENTS]),
        ("/trajectories/0/name", json!("other"), vec![EVENTS]),
        ("/source/procedural/views", json!(7), vec![CAPTURE]),
        ("/source/procedural/arc", json!(0.75), vec![CAPTURE]),
        ("/source/procedural/gaussians", json!(301), vec![RECONSTRUCT]),
        ("/source/procedural/seed", json!(2), vec![CAPTURE, RECONSTRUCT]),
        ("/camera/width", json!(50), of_rendering.clone()),
        ("/camera/height", json!(34), of_rendering.clone()),
        (
            "/camera",
            json!({ "width": 48, "height": 32, "fx": 50, "fy": 50, "cx": 24, "cy": 16 }),
            of_rendering.clone(),
        ),
        ("/trajectories/0/refine/window", json!(1), vec![TRAJECTORY]),
        ("/trajectories/0/refine/factor", json!(3), vec![TRAJECTORY]),
        ("/trajectories/0/refine", json!({ "frames": 12 }), vec![TRAJECTORY]),
        ("/trajectories/0/refine", json!({ "duration": 0.01 }), vec![TRAJECTORY]),
        ("/trajectories/0/refine/order", json!("nearest"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/rotation", json!("slerp-midpoint"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/ends", json!("pinned"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/metric/scale", json!("none"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/metric/scale", json!(2.5), vec![TRAJECTORY]),
        ("/trajectories/0/refine/gaps", json!("refuse"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/curve", json!("slerp-lerp"), vec![TRAJECTORY]),
        ("/trajectories/0/refine/curve", json!({ "bezier": { "degree": 3 } }), vec![TRAJECTORY]),
        ("/trajectories/0/refine/literal", json!(true), vec![TRAJECTORY]),
        ("/trajectories/0", json!({ "name": "base", "orbit": {} }), vec![TRAJECTORY]),
        ("/trajectories/0/speed/function", json!("0.3*sin(t) + 1.1"), vec![TRAJECTORY]),
        ("/trajectories/0/speed/function", json!("1.1 + 0.25*sin(t)"), vec![TRAJECTORY]),
        ("/trajectories/0/speed", json!({ "list": { "multipliers": [1, 2] } }), vec![TRAJECTORY]),
        ("/sampling/rate", json!(1200), vec![TRAJECTORY]),
        ("/sampling/law", json!("integral"), vec![TRAJECTORY]),
        // The law is given, since a tolerance needs the integral.
        (
            "/sampling",
            json!({ "rate": 2400, "between": "linear", "law": "integral", "tolerance": 0.03 }),
            vec![EVENTS, TRAJECTORY],
        ),
        ("/render/rules", json!("exact"), of_rendering.clone()),
        ("/render/antialiased", json!(true), of_rendering.clone()),
        ("/render/background/1", json!(0.5), of_rendering),
        ("/sharp/every", json!(2), vec![SHARP]),
        ("/sensor/voltmeter/preset", json!("dvs240"), vec![EVENTS]),
        ("/sensor/voltmeter", json!({ "k": k, "units": { "time": "us", "brightness": 255 } }), vec![EVENTS]),
        ("/sensor/voltmeter/threshold/on", json!(1.2), vec![EVENTS]),
        ("/sensor/voltmeter/threshold/off", json!(1.2), vec![EVENTS]),
        ("/sensor/voltmeter/gain", json!("midpoint"), vec![EVENTS]),
        ("/sensor/voltmeter/initial", json!("stationary"), vec![EVENTS]),
        ("/sensor/voltmeter/max_events_per_pixel_frame", json!(999), vec![EVENTS]),
        ("/checks", json!({ "event_rate": { "max": 4000 } }), vec![CHECKS]),
        ("/checks", json!({ "waive": [{ "check": "sampling", "because": "a test" }] }), vec![CHECKS]),
        ("/licence/expression", json!("CC-BY-4.0"), vec![]),
        ("/licence/holder", json!("Somebody"), vec![]),
    ]
}

/// Fields that have a single value in this version.
const FIXED: [&str; 4] =
    ["/version", "/source/procedural/kind", "/sampling/between", "/sensor/voltmeter/law"];

#[test]
fn a_field_rekeys_the_stages_that_read_it_and_no_other() {
    let base = parse(&recipe("tiny"));
    let full = base.meta.merged.clone();
    let before = stage_keys(base);
    assert_eq!(before, stage_keys(parse(&full)), "a recipe with its defaults written out");
    for (field, value, stages) in table() {
        let mut edited = full.clone();
        *edited.pointer_mut(field).unwrap_or_else(|| panic!("{field} is no field")) = value.clone();
        assert_ne!(edited, full, "{field}: {value} is what it was");
        let mut stages = stages;
        stages.sort_unstable();
        assert_eq!(rekeyed(&before, &stage_keys(parse(&edited))), stages, "{field}: {value}");
    }
}

/// A field that is added to recipes needs its row.
#[test]
fn the_table_names_every_field() {
    let full = parse(&recipe("tiny")).meta.merged;
    let rows: Vec<&str> = table().into_iter().map(|(field, ..)| field).chain(FIXED).collect();
    let mut leaves = Vec::new();
    walk("", &full, &mut leaves);
    // `outputs` decides which steps exist.
    leaves.retain(|leaf| !leaf.starts_with("/outputs/") && !leaf.starts_with("/render/background/"));
    let missed: Vec<_> = leaves.iter().filter(|leaf| !rows.contains(&leaf.as_str())).collect();
    assert!(missed.is_empty(), "without a row: {missed:?}");
}

fn walk(pointer: &str, value: &Value, leaves: &mut Vec<String>) {
    match value {
        Value::Object(fields) if !fields.is_empty() => {
            fields.iter().for_each(|(name, value)| walk(&format!("{pointer}/{name}"), value, leaves));
        }
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, value)| walk(&format!("{pointer}/{i}"), value, leaves));
        }
        _ => leaves.push(pointer.to_owned()),
    }
}

/// Outputs enter no key. Of the steps that exist, only `checks` depends on whether there are events
/// and sharp frames.
#[test]
fn outputs_decide_which_steps_exist() {
    let both = stage_keys(parse(&recipe("tiny")));
    let t = |outputs: Value, rekeys: &[&str]| {
        let mut edited = recipe("tiny");
        edited["outputs"] = outputs.clone();
        assert_eq!(rekeyed(&both, &stage_keys(parse(&edited))), rekeys, "{outputs}");
    };
    t(json!(["sharp", "events"]), &[]);
    t(json!(["events"]), &[CHECKS, SHARP]);
    t(json!(["sharp"]), &[CHECKS, EVENTS]);
}

#[test]
fn a_preset_is_keyed_by_its_numbers() {
    let by_name = stage_keys(parse(&recipe("tiny")));
    let mut edited = recipe("tiny");
    // The set published with DVS-Voltmeter for the DAVIS346.
    let k = json!([5.265, 20, 1e-4, 1e-7, 5e-9, 1e-5]);
    edited["sensor"] = json!({ "voltmeter": { "k": k, "units": { "time": "us", "brightness": 255 } } });
    assert_eq!(stage_keys(parse(&edited)), by_name);
}

#[test]
fn numbers_are_keyed_by_value_and_not_by_spelling() {
    let text = |arc: &str, rate: &str, seed: &str| {
        format!(
            "version: 1\nscene: tiny\nseed: {seed}\nsource: {{ procedural: {{ gaussians: 300, views: 6, arc: {arc} }} }}\n\
             trajectories: [{{ name: base, refine: {{}} }}]\nsampling: {{ rate: {rate} }}\n"
        )
    };
    let of = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recipe.yaml");
        std::fs::write(&path, text).unwrap();
        stage_keys(read(&path).remove(0))
    };
    let plain = of(&text("0.5", "2400", "7"));
    for (arc, rate) in
        [("0.50", "2400.0"), ("5e-1", "2.4e3"), (".5", "2400"), ("+0.5", "24e2"), ("50.0e-2", "2400.")]
    {
        assert_eq!(of(&text(arc, rate, "7")), plain, "{arc} {rate}");
    }
    let zero = |z: &str| of(&format!("{}render: {{ background: [{z}, 0, 0] }}\n", text("0.5", "2400", "7")));
    assert_eq!(zero("-0.0"), zero("0"));
    assert_eq!(rekeyed(&plain, &of(&text("0.5", "2400.5", "7"))), [TRAJECTORY]);
}

/// The files of a captured source enter by content; their paths do not.
#[test]
fn sources_are_keyed_by_bytes_and_not_by_paths() {
    let place = Workspace::new();
    place.write("in/transforms.json", "{ \"frames\": [] }");
    place.write("in/scene.ply", "no scene, and nobody looks into it");
    let captured = |poses: &str, scene: &str| {
        let mut value = recipe("tiny");
        value["source"] = json!({ "nerfstudio": { "path": poses } });
        value["reconstruct"] = json!({ "given": { "path": scene } });
        place.write("recipe.yaml", value.to_string());
        stage_keys(read(&place.path("recipe.yaml")).remove(0))
    };
    let before = captured("in/transforms.json", "in/scene.ply");
    place.write("elsewhere/t.json", "{ \"frames\": [] }");
    place.write("elsewhere/other.ply", "no scene, and nobody looks into it");
    assert_eq!(captured("elsewhere/t.json", "elsewhere/other.ply"), before);
    assert_eq!(captured("in", "in/scene.ply"), before, "a folder stands for its transforms.json");
    place.write("elsewhere/t.json", "{ \"frames\":  [] }");
    assert_eq!(rekeyed(&before, &captured("elsewhere/t.json", "in/scene.ply")), [CAPTURE]);
    place.write("elsewhere/other.ply", "other bytes");
    assert_eq!(rekeyed(&before, &captured("in", "elsewhere/other.ply")), [RECONSTRUCT]);
}

/// Keys that the program reports after builds in two folders, with the recipe written in two ways.
#[test]
fn keys_do_not_depend_on_folder_file_or_cores() {
    let here = Workspace::new();
    here.write("tiny.yaml", recipe("tiny").to_string());
    here.ok("build -j 1 tiny.yaml");
    let there = Workspace::new();
    let shuffled = "\
# the same scene
trajectories:
  - { refine: { factor: 2.0 }, name: base }
licence: { holder: Nobody, expression: CC0-1.0 }   # no step reads it
camera: { height: 32, width: 48 }
source:
  procedural: { seed: 1, arc: .5, views: 6, gaussians: 300 }
seed: 7
scene: \"tiny\"
sensor: { voltmeter: { preset: dvs346 } }
version: 1
";
    there.write("deep/down/renamed.yaml", shuffled);
    there.ok("build -j 2 --store kept deep");
    let keys_there = keys(&there, "--store kept deep");
    assert_eq!(keys(&here, "tiny.yaml"), keys_there);
    assert_eq!(keys_there.len(), 6);
}
