//! The engine's behaviour table: an event, and the steps that the next build makes. There are three
//! scenes of four steps and one test per row. Afterwards the products always equal those of an
//! undisturbed build.

mod moving;
mod rot;

use crate::support::steps::{Step, products, recipe, steps};
use crate::support::workspace::{Workspace, alter};
use rustix::process::{Pid, Signal, kill_process_group};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, SystemTime};

const NONE: [&str; 0] = [];
const STEPS: [&str; 4] = ["capture", "reconstruct", "base/trajectory", "base/checks"];

/// A scene of exactly [`STEPS`]. Scenes of different numbers share no step.
fn scene(name: &str, number: u32) -> Value {
    let mut value = recipe(name);
    value["source"]["procedural"]["seed"] = number.into();
    value["outputs"] = json!([]);
    value
}

fn three() -> Workspace {
    let place = Workspace::new();
    for (number, name) in (1..).zip(["a", "b", "c"]) {
        place.write(&format!("recipes/{name}.yaml"), scene(name, number).to_string());
    }
    place
}

/// The three scenes, built.
fn built() -> Workspace {
    let place = three();
    assert_eq!(made(&place).len(), 3 * STEPS.len());
    place
}

/// Builds, and returns the names of the steps that were made, sorted.
fn made(place: &Workspace) -> Vec<String> {
    let mut made = place.build("recipes");
    made.sort();
    made
}

/// Checks that everything is up to date, with the products of a clean build of the same recipes.
fn stands_as_if_clean(place: &Workspace) {
    let clean = Workspace::new();
    for entry in fs::read_dir(place.path("recipes")).unwrap() {
        let entry = entry.unwrap();
        clean.write(&format!("recipes/{}", entry.file_name().display()), fs::read(entry.path()).unwrap());
    }
    clean.ok("build");
    assert_eq!(products(place, "recipes"), products(&clean, "recipes"));
    assert_eq!(made(place), NONE);
}

#[test]
fn nothing_happened() {
    let place = built();
    assert_eq!(made(&place), NONE);
    stands_as_if_clean(&place);
}

#[test]
fn a_recipe_is_touched() {
    let place = built();
    let recipe = File::options().write(true).open(place.path("recipes/a.yaml")).unwrap();
    recipe.set_modified(SystemTime::now() + Duration::from_secs(60)).unwrap();
    assert_eq!(made(&place), NONE);
    stands_as_if_clean(&place);
}

#[test]
fn comments_order_and_spelling_of_a_recipe_change() {
    let place = Workspace::new();
    let text = "\
version: 1
scene: a
seed: 7
source: { procedural: { gaussians: 300, views: 6, arc: 0.5, seed: 1 } }
camera: { width: 48, height: 32 }
trajectories: [{ name: base, refine: { factor: 2 }, speed: { function: \"0.25*sin(t) + 1.1\" } }]
sampling: { rate: 2400 }
sensor: { voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } } }
";
    place.write("recipes/a.yaml", text);
    assert_eq!(made(&place).len(), 6, "with events and frames, so that every stage reads its part");
    let respelled = text
        .replace("seed: 7\n", "")
        .replace("rate: 2400", "rate: 2.4e3")
        .replace("arc: 0.5", "arc: .50")
        .replace("on: 1.0, off: 1.0", "off: 1, on: 1.00")
        .replace("0.25*sin(t) + 1.1", "0.25 * sin( t )+1.1")
        + "# seeds may stand anywhere\nseed: 7\n";
    place.write("recipes/a.yaml", respelled);
    assert_eq!(made(&place), NONE);
    stands_as_if_clean(&place);
}

#[test]
fn a_limit_of_a_check_changes() {
    let place = built();
    let mut edited = scene("b", 2);
    edited["checks"] = json!({ "event_rate": { "max": 4321 } });
    place.write("recipes/b.yaml", edited.to_string());
    assert_eq!(made(&place), ["b/base/checks"]);
    stands_as_if_clean(&place);
}

/// Damages a product of each step of a scene in turn. Each time the step runs and makes the same
/// bytes, and no later step runs.
fn each_output(code: &str, damage: impl Fn(&Path)) {
    let place = built();
    let whole = steps(&place, "recipes");
    for step in STEPS {
        let name = format!("b/{step}");
        let (role, path) = whole[&name].outputs.first_key_value().unwrap();
        let bytes = fs::read(path).unwrap();
        damage(path);
        let plan = steps(&place, "recipes");
        let runs: Vec<&String> =
            plan.iter().filter(|(_, s)| s.action == "run").map(|(name, _)| name).collect();
        assert_eq!((runs, plan[&name].code.as_str()), (vec![&name], code), "{name}, {role}");
        assert_eq!(made(&place), [name.as_str()], "{role}: {code}");
        assert_eq!(fs::read(path).unwrap(), bytes, "{name}, {role}");
        assert_eq!(steps(&place, "recipes"), whole);
    }
    stands_as_if_clean(&place);
}

#[test]
fn an_output_is_altered_and_its_size_and_mtime_kept() {
    each_output("blob-altered", |path| alter(path, true));
}

#[test]
fn an_output_is_altered() {
    each_output("blob-altered", |path| alter(path, false));
}

#[test]
fn an_output_is_deleted() {
    each_output("blob-missing", |path| fs::remove_file(path).unwrap());
}

/// The whole process group is killed while the events of a large scene are half written. Finished
/// steps stay, and only the rest is made.
#[test]
fn the_process_group_is_killed_while_an_output_is_half_written() {
    let place = three();
    let mut large = scene("c", 3);
    large["camera"] = json!({ "width": 160, "height": 120 });
    large["trajectories"][0]["refine"]["factor"] = json!(12);
    large["outputs"] = json!(["events"]);
    place.write("recipes/c.yaml", large.to_string());
    let mut command = place.command("build -j 1");
    let mut child = command.process_group(0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    while !is_half_written(&place.path(".gs2e/gs2e-tmp")) {
        assert!(child.try_wait().unwrap().is_none(), "it ended before its events were half written");
        std::thread::sleep(Duration::from_millis(1));
    }
    kill_process_group(Pid::from_child(&child), Signal::KILL).unwrap();
    assert_eq!(child.wait().unwrap().code(), None, "a signal ended it");
    let unfinished = {
        let mut stale = place.stale("recipes");
        stale.sort();
        stale
    };
    let behind = ["c/base/checks", "c/base/events"];
    assert!(behind.iter().all(|step| unfinished.iter().any(|other| other == step)), "{unfinished:?}");
    assert!(!unfinished.contains(&"c/base/trajectory".to_owned()), "finished before: {unfinished:?}");
    assert_eq!(made(&place), unfinished);
    assert_eq!(fs::read_dir(place.path(".gs2e/gs2e-tmp")).unwrap().count(), 0, "leftovers are removed");
    stands_as_if_clean(&place);
}

/// Returns true if a step has begun its event file.
fn is_half_written(tmp: &Path) -> bool {
    let folders = fs::read_dir(tmp).into_iter().flatten().filter_map(Result::ok);
    folders.into_iter().any(|f| fs::metadata(f.path().join("events.h5")).is_ok_and(|m| m.len() > 0))
}

#[test]
fn a_recipe_is_removed() {
    let place = built();
    let before = steps(&place, "recipes");
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    assert_eq!(made(&place), NONE);
    let after = steps(&place, "recipes");
    assert!(after.iter().all(|(name, step)| before.get(name) == Some(step)), "other scenes are untouched");
    assert_eq!(after.len(), 2 * STEPS.len());
    stands_as_if_clean(&place);
    place.write("recipes/a.yaml", scene("a", 1).to_string());
    assert_eq!(made(&place), NONE, "nothing was thrown away");

    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    place.ok("gc --min-age 0s");
    let (its, others): (Vec<_>, Vec<_>) = before.iter().partition(|(name, _)| name.starts_with("a/"));
    let blobs = |steps: &[(&String, &Step)]| -> BTreeSet<PathBuf> {
        steps.iter().flat_map(|(_, step)| step.outputs.values().cloned()).collect()
    };
    let (its, others) = (blobs(&its), blobs(&others));
    assert!(its.difference(&others).all(|path| !path.exists()), "its blobs are freed");
    assert!(others.iter().all(|path| path.exists()), "and no other");
    assert_eq!(steps(&place, "recipes"), after);
    stands_as_if_clean(&place);
    place.write("recipes/a.yaml", scene("a", 1).to_string());
    assert_eq!(made(&place).len(), STEPS.len());
    stands_as_if_clean(&place);
}

#[test]
fn an_edit_is_undone() {
    let place = built();
    let mut edited = scene("a", 1);
    edited["trajectories"][0]["speed"] = json!({ "function": "1 + 0.5*t" });
    place.write("recipes/a.yaml", edited.to_string());
    assert_eq!(made(&place), ["a/base/checks", "a/base/trajectory"]);
    place.write("recipes/a.yaml", scene("a", 1).to_string());
    assert_eq!(made(&place), NONE);
    stands_as_if_clean(&place);
}

#[test]
fn two_scenes_have_equal_inputs() {
    let place = three();
    for (name, number) in [("d", 1), ("e", 1)] {
        let mut value = scene(name, number);
        value["outputs"] = json!(["events"]);
        place.write(&format!("recipes/{name}.yaml"), value.to_string());
    }
    let made = made(&place);
    let plan = steps(&place, "recipes");
    let keys: BTreeSet<_> = plan.values().map(|step| step.key.clone().unwrap()).collect();
    // Each scene's noise has its own seed: `d` and `e` add only their event streams and the
    // verdicts on them.
    assert_eq!((plan.len(), made.len(), keys.len()), (3 * 4 + 2 * 5, 3 * 4 + 2 * 2, 3 * 4 + 2 * 2));
    stands_as_if_clean(&place);
}
