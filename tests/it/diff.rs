//! `gs2e diff`: the reported differences of two release trees with their reasons, and folders that
//! are no releases.

use crate::support::given::{sound, transforms};
use crate::support::steps::recipe;
use crate::support::workspace::{TINY, Workspace, tree};
use gs2e_build::stage::Stage as _;
use gs2e_build::stage::events::EventsStage;
use serde_json::{Value, json};
use std::fs;

/// The object that `diff --json` prints for two folders.
fn diff(place: &Workspace, old: &str, new: &str) -> Value {
    let ended = place.ok(&format!("diff --json {old} {new}"));
    assert_eq!(ended.stdout.lines().count(), 1, "one object: {}", ended.stdout);
    serde_json::from_str(&ended.stdout).unwrap()
}

/// Applies `change` to a JSON file of a release.
fn edit(place: &Workspace, path: &str, change: impl FnOnce(&mut Value)) {
    let mut value: Value = place.json(path);
    change(&mut value);
    // A linked file is read-only, and is the store's own.
    fs::remove_file(place.path(path)).unwrap();
    place.write(path, value.to_string());
}

/// Two copies of a release of [`TINY`], in `old` and `new`. The manifest of `new` is changed.
fn with_manifest(change: impl FnOnce(&mut Value)) -> Workspace {
    let place = Workspace::with_tiny();
    for to in ["old", "new"] {
        place.ok(&format!("release -q --to {to} tiny.yaml"));
    }
    edit(&place, "new/manifest.json", change);
    place
}

fn step<'m>(manifest: &'m mut Value, name: &str) -> &'m mut Value {
    let steps = manifest["scenes"][0]["steps"].as_array_mut().unwrap();
    steps.iter_mut().find(|step| step["step"] == name).unwrap()
}

/// The steps of the only changed scene as (step, same bytes, reasons).
fn steps(found: &Value) -> Vec<(String, bool, Value)> {
    let steps = found["changed"][0]["steps"].as_array().unwrap().iter();
    steps
        .map(|s| {
            (s["step"].as_str().unwrap().into(), s["same_bytes"].as_bool().unwrap(), s["reasons"].clone())
        })
        .collect()
}

#[test]
fn equal_releases_differ_in_nothing() {
    let place = with_manifest(|_| {});
    let found = diff(&place, "old", "new");
    for list in ["release", "files", "added", "removed", "changed"] {
        assert_eq!(found[list], json!([]), "{list}");
    }
    assert_eq!(found["unchanged"], 1);
    let ended = place.ok("diff old new");
    assert_eq!(ended.stdout, "");
    assert!(ended.stderr.contains("0 added, 0 removed, 0 changed, 1 unchanged"), "{}", ended.stderr);
}

/// The parts of a key are taken from the plan. A lost record is no reason to refuse a release.
#[test]
fn a_release_states_the_parts_of_its_keys_without_records() {
    let place = sound();
    place.ok("release -q --to old recipe.yaml");
    for path in tree(&place.path(".gs2e/ac")).keys() {
        fs::remove_file(place.path(".gs2e/ac").join(path)).unwrap();
    }
    let ended = place.ok("release --to new recipe.yaml");
    assert!(ended.stderr.lines().any(|line| line.starts_with("0 steps built,")), "{}", ended.stderr);
    assert_eq!(diff(&place, "old", "new")["unchanged"], 1);
}

#[test]
fn scenes_come_go_and_change_by_a_recipe_value() {
    let place = Workspace::new();
    for scene in ["gone", "kept", "moved"] {
        place.write(&format!("recipes/{scene}.yaml"), recipe(scene).to_string());
    }
    place.ok("release -q --to old");
    fs::remove_file(place.path("recipes/gone.yaml")).unwrap();
    place.write("recipes/come.yaml", recipe("come").to_string());
    let mut moved = recipe("moved");
    moved["sensor"] = json!({ "voltmeter": { "preset": "dvs346-paper", "threshold": { "on": 1.5 } } });
    place.write("recipes/moved.yaml", moved.to_string());
    place.write("recipes/release.yaml", "name: Another\nversion: 1.2.3\n");
    place.ok("release -q --to new");

    let seen = diff(&place, "old", "new");
    let ids = |list: &str| seen[list].as_array().unwrap().iter().map(|s| s["id"].clone()).collect::<Value>();
    assert_eq!(
        [ids("added"), ids("removed"), ids("changed")],
        [json!(["come"]), json!(["gone"]), json!(["moved"])]
    );
    assert_eq!(seen["unchanged"], 1);
    let version = json!({ "path": "version", "old": "0.0.0", "new": "1.2.3" });
    assert!(seen["release"].as_array().unwrap().contains(&version), "{}", seen["release"]);

    let scene = &seen["changed"][0];
    let value = json!([{ "path": "sensor.voltmeter.threshold.on", "old": 1.0, "new": 1.5 }]);
    assert_eq!(scene["recipe"], value);
    let found = steps(&seen);
    assert_eq!(found[0], ("base/events".into(), false, json!([{ "code": "params-changed" }])));
    let (name, _, reasons) = &found[1];
    assert_eq!((name.as_str(), &reasons[0]["code"]), ("base/checks", &json!("input-changed")));
    assert_eq!((found.len(), &reasons[0]["name"]), (2, &json!("events")));

    let size = |release: &str| fs::metadata(place.path(release).join("moved/base/events.h5")).unwrap().len();
    let events = json!({ "path": "moved/base/events.h5", "old": size("old"), "new": size("new") });
    assert!(scene["files"].as_array().unwrap().contains(&events), "{}", scene["files"]);

    let text = place.ok("diff old new").stdout;
    for line in [
        "release  version: \"0.0.0\" -> \"1.2.3\"",
        "changed  moved",
        "  recipe   sensor.voltmeter.threshold.on: 1.0 -> 1.5",
        "  step     base/events: parameters",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
}

#[test]
fn a_file_of_the_source_is_named() {
    let place = sound();
    place.ok("release -q --to old recipe.yaml");
    place.write("transforms.json", transforms(1.0).replace("\"cx\":32.0", "\"cx\":32.5"));
    place.ok("release -q --to new recipe.yaml");
    let found = diff(&place, "old", "new");
    assert_eq!(found["changed"][0]["recipe"], json!([]));
    let (name, _, reasons) = &steps(&found)[0];
    assert_eq!((name.as_str(), &reasons[0]["code"]), ("capture", &json!("input-changed")));
    assert_eq!(reasons[0]["name"], "file transforms.json");
    let (old, new) = (transforms(1.0), fs::read(place.path("transforms.json")).unwrap());
    let digests = [blake3::hash(old.as_bytes()), blake3::hash(&new)].map(|hash| hash.to_hex().to_string());
    assert_eq!([&reasons[0]["old"], &reasons[0]["new"]], [&json!(digests[0]), &json!(digests[1])]);
}

/// Differences that no recipe shows: revisions, classes and steps behind equal recipes.
#[test]
fn different_revisions_classes_and_steps_are_reported() {
    let zeros = "0".repeat(64);
    let t = |change: &dyn Fn(&mut Value), wanted: (&str, bool, Value)| {
        let place = with_manifest(|manifest| change(manifest));
        let (name, same_bytes, reasons) = wanted;
        assert_eq!(steps(&diff(&place, "old", "new")), [(name.to_owned(), same_bytes, reasons)]);
        assert!(place.ok("diff old new").stdout.contains(name));
    };
    let rekeyed = |manifest: &mut Value, field: &str, value: Value| {
        step(manifest, "base/events")["key"] = json!(zeros);
        step(manifest, "base/events")["made_of"][field] = value;
    };
    let revision = json!([{ "code": "revision", "old": EventsStage::REVISION, "new": 99 }]);
    t(&|m| rekeyed(m, "revision", json!(99)), ("base/events", true, revision));
    let class = json!([{ "code": "class", "old": gs2e_render::cpu::FINGERPRINT, "new": "other/1" }]);
    t(&|m| rekeyed(m, "class", json!("other/1")), ("base/events", true, class));
    let untold = json!([{ "code": "untold" }]);
    t(&|m| rekeyed(m, "revision", json!(EventsStage::REVISION)), ("base/events", true, untold.clone()));
    t(
        &|m| {
            step(m, "base/sharp")["key"] = json!(zeros);
            step(m, "base/sharp").as_object_mut().unwrap().remove("made_of");
        },
        ("base/sharp", true, untold),
    );
    let other_bytes = json!([{ "code": "nondeterministic" }]);
    t(&|m| step(m, "capture")["outputs"][0]["digest"] = json!(zeros), ("capture", false, other_bytes));
    let gone = json!([{ "code": "step-removed" }]);
    t(
        &|m| m["scenes"][0]["steps"].as_array_mut().unwrap().retain(|s| s["step"] != "base/sharp"),
        ("base/sharp", false, gone),
    );
}

/// The claims of a release are enough: without its other files, without a store, and without
/// writing.
#[test]
fn diff_reads_only_claims() {
    let place = Workspace::with_tiny();
    place.ok("release -q --to old tiny.yaml");
    place.write("tiny.yaml", TINY.replace("width: 64", "width: 66"));
    place.ok("release -q --to new tiny.yaml");
    let before = diff(&place, "old", "new");
    assert_eq!(before["changed"][0]["recipe"], json!([{ "path": "camera.width", "old": 64, "new": 66 }]));
    fs::remove_dir_all(place.path(".gs2e")).unwrap();
    for release in ["old", "new"] {
        for path in tree(&place.path(release)).keys() {
            if !path.ends_with("manifest.json") && !path.ends_with("scene.json") {
                fs::remove_file(place.path(release).join(path)).unwrap();
            }
        }
    }
    let left = [tree(&place.path("old")), tree(&place.path("new"))];
    assert_eq!(diff(&place, "old", "new"), before);
    assert!(left == [tree(&place.path("old")), tree(&place.path("new"))]);
    assert!(!place.path(".gs2e").exists());
}

#[test]
fn a_folder_that_is_no_release_is_refused() {
    let place = with_manifest(|manifest| manifest["scenes"][0]["source"] = json!("other"));
    let t = |prepare: &dyn Fn(), wanted: [&str; 3]| {
        prepare();
        for args in ["old new", "new old"] {
            let ended = place.gs2e(&format!("diff --json {args}"));
            assert_eq!(ended.code, 2, "{}", ended.stderr);
            for text in wanted {
                assert!(ended.stderr.contains(text), "`{text}` is not in {}", ended.stderr);
            }
            let problem: Value = serde_json::from_str(&ended.stdout).unwrap();
            assert_eq!(problem["code"], "not-a-release");
        }
    };
    let remove = |path: &str| fs::remove_file(place.path(path)).unwrap();
    t(
        &|| remove("new/tiny/scene.json"),
        ["scene.json", "found an unreadable file", "wanted the description of a scene"],
    );
    t(&|| place.write("new/tiny/scene.json", "{}"), ["scene.json", "found other JSON", "wanted"]);
    let raise = || edit(&place, "new/manifest.json", |manifest| manifest["format"] = json!(2));
    t(&raise, ["new/manifest.json", "found format 2", "wanted format 1"]);
    t(
        &|| place.write("new/manifest.json", "{"),
        ["new/manifest.json", "found other JSON", "wanted the manifest"],
    );
    t(
        &|| remove("new/manifest.json"),
        ["new:", "found a folder without manifest.json", "wanted a release folder"],
    );
    t(
        &|| fs::remove_dir_all(place.path("new")).unwrap(),
        ["new:", "found nothing", "wanted a release folder"],
    );
    t(&|| place.write("new", "x"), ["new:", "found a file", "wanted a release folder"]);
}
