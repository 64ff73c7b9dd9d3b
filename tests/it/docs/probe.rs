//! A recipe with one key under test, and the loader's answer to it.

use crate::support::workspace::Workspace;
use gs2e_recipe as recipe;
use gs2e_recipe::{Recipe, RecipeMeta};
use gs2e_scene::objects::ObjectSource;
use serde_json::{Map, Value};

/// Smallest recipes that can hold a key, by the beginning of the key's path. Their keys replace
/// those of [`BASE`].
const CONTEXTS: [(&str, &str); 45] = [
    ("", ""),
    ("source.colmap", CAPTURE),
    ("source.nerfstudio", "{ source: { nerfstudio: { path: c } }, outputs: [] }"),
    ("source.mvimgnet", "{ source: { mvimgnet: { path: c } }, outputs: [] }"),
    ("source.dl3dv", "{ source: { dl3dv: { path: c } }, outputs: [] }"),
    ("source.model", "{ source: { model: { path: c } }, outputs: [] }"),
    ("source.photos", "{ source: { photos: { path: c } }, outputs: [] }"),
    ("source.video", "{ source: { video: { path: c } }, outputs: [] }"),
    ("source.colmap.poses", "{ source: { dl3dv: { path: c } }, outputs: [] }"),
    ("reconstruct.given", "{ source: { colmap: { path: c } }, reconstruct: { given: { path: s.ply } } }"),
    ("source.procedural.fountain.", "{ source: { procedural: { fountain: {} } } }"),
    (
        "reconstruct.given.time.",
        "{ source: { colmap: { path: c } }, reconstruct: { given: { path: s.ply, time: {} } } }",
    ),
    ("reconstruct.builtin", "{ source: { colmap: { path: c } }, reconstruct: { builtin: {} } }"),
    (
        "reconstruct.command",
        "{ source: { colmap: { path: c } }, reconstruct: { command: { program: p, version: '1', licence: MIT } } }",
    ),
    ("camera", "{ camera: { width: 64, height: 48 } }"),
    ("camera.f", "{ camera: { width: 64, height: 48, fx: 50 } }"),
    ("camera.fov", "{ camera: { width: 64, height: 48 } }"),
    ("camera.c", "{ camera: { width: 64, height: 48, fx: 50 } }"),
    (
        "trajectories[].refine.curve.bezier",
        "{ trajectories: [{ name: a, refine: { curve: { bezier: { degree: 3 } } } }] }",
    ),
    ("trajectories[].novel", "{ trajectories: [{ name: a, refine: {} }, { name: b, novel: {} }] }"),
    ("trajectories[].orbit", "{ trajectories: [{ name: a, orbit: {} }] }"),
    (
        "trajectories[].keyframes",
        "{ trajectories: [{ name: a, keyframes: { poses: [{ position: [0, 0, 0], rotation: [0, 0, 0, 1] }] } }] }",
    ),
    ("trajectories[].keyframes.poses[].look_at", LOOKING),
    ("trajectories[].keyframes.poses[].up", LOOKING),
    (
        "trajectories[].speed.list",
        "{ trajectories: [{ name: a, refine: {}, speed: { list: { multipliers: [1] } } }] }",
    ),
    (
        "trajectories[].speed.flow",
        "{ trajectories: [{ name: a, refine: {}, speed: { flow: { px_s: 400 } } }] }",
    ),
    ("sensor.esim", "{ sensor: { esim: {} } }"),
    ("sensor.v2e", "{ sensor: { v2e: {} } }"),
    ("sensor.voltmeter.units", UNITS),
    ("sensor.voltmeter.readout", "{ sensor: { voltmeter: { readout: { rate_mev_s: 12 } } } }"),
    ("sensor.voltmeter.latency", "{ sensor: { voltmeter: { latency: { us: 100 } } } }"),
    ("sensor.voltmeter.hot_pixels", "{ sensor: { voltmeter: { hot_pixels: { share: 0.1, rate: 1 } } } }"),
    ("sensor.voltmeter.floor", "{ sensor: { voltmeter: { floor: [{ lux: 1 }] } } }"),
    (
        "sensor.voltmeter.photoreceptor_noise",
        "{ sensor: { voltmeter: { photoreceptor_noise: { points: [{ lux: 1, deviation: 0, cutoff_hz: 1 }] } } } }",
    ),
    (
        "sensor.voltmeter.bandwidth",
        "{ sensor: { voltmeter: { bandwidth: { points: [{ lux: 1, cutoff_hz: 1 }] } } } }",
    ),
    ("lights.flicker", "{ lights: { flicker: { hz: 100, depth: 0.5 } } }"),
    ("lights.level", "{ lights: { level: [{ t: 0, stops: 0 }] } }"),
    ("rig", "{ rig: { cameras: [{ name: a }, { name: b }] } }"),
    (
        "objects[]",
        "{ objects: [{ name: a, select: { sphere: { centre: [0, 0, 0], radius: 1 } }, path: { straight: {} } }] }",
    ),
    (
        "objects[].select.box",
        "{ objects: [{ name: a, select: { box: { low: [0, 0, 0], high: [1, 1, 1] } }, path: { straight: {} } }] }",
    ),
    ("objects[].scene", "{ objects: [{ name: a, scene: { path: s.ply }, path: { straight: {} } }] }"),
    (
        "objects[].path.orbit",
        "{ objects: [{ name: a, scene: { path: s.ply }, path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], \
         degrees_per_second: 9 } } }] }",
    ),
    (
        "objects[].path.keyframes",
        "{ objects: [{ name: a, scene: { path: s.ply }, path: { keyframes: [{ at: 0 }, { at: 1 }] } }] }",
    ),
    ("licence", "{ licence: { expression: MIT, holder: H } }"),
    (
        "licence.evidence",
        "{ source: { mvimgnet: { path: c } }, outputs: [], licence: { expression: MIT, holder: H, upstream: CC-BY-4.0, \
         evidence: { granted_by: g, url: 'https://example.org', date: 2025-06-01 } } }",
    ),
];

const BASE: &str =
    "{ version: 1, scene: a, source: { procedural: {} }, trajectories: [{ name: a, refine: {} }] }";
const CAPTURE: &str = "{ source: { colmap: { path: c } }, outputs: [] }";
const LOOKING: &str = "{ trajectories: [{ name: a, keyframes: { poses: [{ position: [0, 0, -4], look_at: [0, 0, 0], \
                       up: [0, 1, 0] }] } }] }";
const UNITS: &str =
    "{ sensor: { voltmeter: { k: [10, 20, 0, 0, 0, 0], units: { time: us, brightness: 255 } } } }";

/// A YAML text as a value.
pub(super) fn yaml(text: &str) -> Result<Value, String> {
    serde_saphyr::from_str(text).map_err(|e| e.to_string())
}

/// The smallest recipe that can hold the key at `path`.
pub(super) fn context(path: &str) -> Value {
    let fits = |(beginning, _): &&(&str, &str)| path.starts_with(beginning);
    let (_, text) =
        CONTEXTS.iter().filter(fits).max_by_key(|(beginning, _)| beginning.len()).expect("one is empty");
    let mut recipe = yaml(BASE).expect("it is YAML");
    if !text.is_empty() {
        merge(&mut recipe, yaml(text).unwrap_or_else(|e| panic!("{text}: {e}")));
    }
    recipe
}

/// Replaces the keys of `recipe` by those of `over`.
pub(super) fn merge(recipe: &mut Value, over: Value) {
    let (Value::Object(recipe), Value::Object(over)) = (recipe, over) else { panic!("both are mappings") };
    recipe.extend(over);
}

/// The place at `path`, created if it is missing; `[]` is the last item of a list.
fn place<'v>(mut value: &'v mut Value, path: &str) -> &'v mut Value {
    for part in path.split('.') {
        if !value.is_object() {
            *value = Value::Object(Map::new());
        }
        value = &mut value[part.trim_end_matches("[]")];
        if part.ends_with("[]") {
            value = value.as_array_mut().and_then(|list| list.last_mut()).expect("the context has a list");
        }
    }
    value
}

/// Sets the key at `path`.
pub(super) fn with(mut recipe: Value, path: &str, value: Value) -> Value {
    *place(&mut recipe, path) = value;
    recipe
}

/// Removes the key at `path`; `None` if it is not there.
pub(super) fn without(mut recipe: Value, path: &str) -> Option<Value> {
    let (parent, key) = path.rsplit_once('.').map_or(("", path), |(parent, key)| (parent, key));
    let parent = if parent.is_empty() { &mut recipe } else { place(&mut recipe, parent) };
    parent.as_object_mut()?.remove(key)?;
    Some(recipe)
}

/// The recipe without the parts that depend on its file, or the loader's faults, one per line.
pub(super) fn load(recipe: &Value) -> Result<Recipe, String> {
    let place = Workspace::new();
    place.write("probe.yaml", recipe.to_string());
    match recipe::read_all(&[place.path("probe.yaml")]) {
        Ok(mut recipes) => {
            let found: Recipe = recipes.remove(0);
            let base = place.path("").to_string_lossy().into_owned();
            let mut found = Recipe { meta: nowhere(found.meta), ..found };
            relative(&mut found, &base);
            Ok(found)
        }
        Err(faults) => Err(faults.to_string().replace("; ", ";\n")),
    }
}

/// The meta data without files and places.
fn nowhere(meta: RecipeMeta) -> RecipeMeta {
    RecipeMeta { merged: meta.merged, ..RecipeMeta::default() }
}

/// Makes paths below the temporary folder relative to it.
fn relative(found: &mut Recipe, base: &str) {
    let short = |path: &mut std::path::PathBuf| {
        if let Ok(rest) = path.strip_prefix(base) {
            *path = rest.to_owned();
        }
    };
    if let recipe::SceneSource::Captured(captured, _) = &mut found.source {
        short(&mut captured.path);
    }
    match &mut found.reconstruct {
        Some(
            recipe::ReconstructMethod::Given(path)
            | recipe::ReconstructMethod::Changing(path, _)
            | recipe::ReconstructMethod::Newest(path),
        ) => short(path),
        Some(recipe::ReconstructMethod::Command(_) | recipe::ReconstructMethod::Builtin(_)) | None => {}
    }
    for object in &mut found.objects {
        if let ObjectSource::Ids { file } | ObjectSource::Scene { file, .. } = &mut object.from {
            short(file);
        }
    }
}

/// The range that the loader wants for the number at `path`, in the words of its message.
pub(super) fn range(path: &str, absurd: Value) -> Option<String> {
    let message = load(&with(context(path), path, absurd)).err()?;
    message.lines().find_map(wanted)
}

/// `0 to 1000` from `… is 1001, wanted a whole number from 0 to 1000`.
fn wanted(message: &str) -> Option<String> {
    let message = message.trim_end_matches(';');
    let words = match message.split_once("wanted ") {
        Some((_, wanted)) => wanted.split(", such as").next()?,
        None if message.contains("a limit is a finite number above 0") => "above 0",
        None if message.contains("a share is a number from 0 to 1") => "0 to 1",
        None => {
            let (before, _) = message.split_once(" frames are the fewest")?;
            return Some(format!("at least {}", before.rsplit(' ').next()?));
        }
    };
    let words =
        words.replace("a whole number ", "").replace("a number ", "").replace(" and at most ", ", at most ");
    let words = words.strip_prefix("from ").unwrap_or(&words);
    let short: Vec<String> = words.split(' ').map(shortened).collect();
    Some(short.join(" "))
}

/// A long number in exponent form.
fn shortened(word: &str) -> String {
    let (number, comma) = word.strip_suffix(',').map_or((word, ""), |number| (number, ","));
    match number.parse::<f64>() {
        Ok(value) if value != 0.0 && (value.abs() >= 1e6 || value.abs() < 1e-4) => {
            format!("{value:e}{comma}")
        }
        _ => word.to_owned(),
    }
}

#[test]
fn ranges_are_read_off_messages() {
    let t = |message: &str, range: &str| assert_eq!(wanted(message).as_deref(), Some(range), "{message}");
    t("\"a\" is 5, wanted a whole number from 0 to 1000;", "0 to 1000");
    t(
        "\"a\" is -1, wanted a number above 0 and at most 1000000000, such as 5, 1.1 or 11/10",
        "above 0, at most 1e9",
    );
    t("\"a\" is 0, wanted a number from 0.000001 to 1000000", "1e-6 to 1e6");
    t("\"checks.speed.arc\": a limit is a finite number above 0, not -1", "above 0");
    t("\"a\": found 0 frames, wanted at least 3", "at least 3");
}
