//! Scenes known at a glance to be up to date, and trust, verification, rechecks and estimates.

use crate::support::steps::{recipe, steps};
use crate::support::workspace::{Workspace, alter};
use gs2e_build::plan::Plan;
use gs2e_build::plan::survey::survey_recipes;
use gs2e_build::run::{
    RecheckPolicy, ResourceBudget, RunEvent, RunObserver, RunOptions, run_plan, settle_run,
};
use gs2e_files::programs::ProgramFinder;
use gs2e_recipe::read_all;
use gs2e_render::backend::Backend;
use gs2e_store::{Digest, Store, StoreAccess};
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

struct Silent;

impl RunObserver for Silent {
    fn observe(&self, _: &RunEvent<'_>) {}
}

fn open(place: &Workspace) -> Store {
    Store::open(&place.path(".gs2e"), StoreAccess::Write, &mut |_| {}).unwrap()
}

fn tag() -> Digest {
    Digest::of_bytes(b"this program")
}

/// Builds in this process under [`tag`], and returns the number of steps made.
fn build(place: &Workspace) -> usize {
    let plan = Plan::new(
        read_all(&recipes(place)).unwrap_or_else(|faults| panic!("{}", faults.render_text())),
        &Backend::Cpu,
    );
    let store = open(place);
    let budget = ResourceBudget { cores: 2, memory: u64::MAX, gpus: 0 };
    let options = RunOptions {
        budget,
        keep_going: false,
        recheck: RecheckPolicy::default(),
        allow_commands: false,
        kept_frames: None,
        programs: ProgramFinder::default(),
    };
    let summary = run_plan(&plan, &store, options, &AtomicBool::new(false), &Silent).unwrap();
    assert!(summary.failures.is_empty(), "{:?}", summary.failures);
    settle_run(&plan, &summary, &store, &tag()).unwrap();
    summary.made
}

fn recipes(place: &Workspace) -> Vec<PathBuf> {
    vec![place.path("recipes")]
}

/// The scenes known at a glance, and the number of files that were read to know them.
fn settled(place: &Workspace, tag: &Digest) -> (Vec<String>, usize) {
    let store = open(place);
    let survey = survey_recipes(&recipes(place), &Backend::Cpu, &store, tag).unwrap();
    (survey.settled.into_iter().map(|scene| scene.scene).collect(), store.digests().1)
}

/// Two embedded scenes and one over files, whose photos may lie in `data/photos`.
fn three() -> Workspace {
    let place = Workspace::new();
    for scene in ["a", "b", "c"] {
        let mut value = recipe(scene);
        value["outputs"] = json!([]);
        if scene == "c" {
            value["source"] = json!({ "nerfstudio": { "path": "../data/transforms.json" } });
            value["reconstruct"] = json!({ "given": { "path": "../data/scene.ply" } });
        }
        place.write(&format!("recipes/{scene}.yaml"), value.to_string());
    }
    place.write("data/transforms.json", crate::support::given::transforms(1.0).replace("images/", "photos/"));
    place.write("data/scene.ply", crate::support::given::ply(|_, value| value));
    place.write("data/photos/readme.txt", "none yet");
    // A file younger than two seconds may still change unseen, so it counts as unknown.
    std::thread::sleep(Duration::from_millis(2100));
    place
}

/// The first build after the cold one reads nothing. A changed file makes only its own scene be
/// looked at again.
#[test]
fn unchanged_scenes_are_known_at_a_glance() {
    let place = three();
    assert!(build(&place) > 0);
    let all = ["a", "b", "c"].map(str::to_owned).to_vec();
    assert_eq!(settled(&place, &tag()), (all.clone(), 0));
    assert_eq!(settled(&place, &Digest::of_bytes(b"another program")).0, [""; 0]);

    let first = |scene: &str| {
        let steps = steps(&place, &format!("recipes/{scene}.yaml"));
        steps[&format!("{scene}/base/checks")].outputs["verdicts.json"].clone()
    };
    let (of_a, of_c) = (first("a"), first("c"));
    alter(&of_a, true);
    assert_eq!(settled(&place, &tag()).0, ["c"], "a and b share their verdicts");
    assert_eq!(build(&place), 1);
    fs::remove_file(of_c).unwrap();
    assert!(!settled(&place, &tag()).0.contains(&"c".to_owned()), "a product is gone");
    assert_eq!(build(&place), 1);
    std::thread::sleep(Duration::from_millis(2100));
    assert_eq!(build(&place), 0);
    assert_eq!(settled(&place, &tag()).0, all);

    let t = |path: &str, text: &str, left: &[&str]| {
        place.write(path, text);
        assert_eq!(settled(&place, &tag()).0, left, "{path}");
        fs::remove_file(place.path(path)).unwrap();
    };
    t("data/photos/002.png", "a photo that a view names", &["a", "b"]);
    t("recipes/defaults.yaml", "sampling: { rate: 2400 }", &[]);
    // Two recipes of one scene are reported, although each is known.
    place.write("recipes/d.yaml", fs::read(place.path("recipes/a.yaml")).unwrap());
    let store = open(&place);
    assert!(survey_recipes(&recipes(&place), &Backend::Cpu, &store, &tag()).is_err());
}

#[test]
fn recheck_makes_steps_again_and_compares_bytes() {
    let place = Workspace::new();
    place.write("recipes/a.yaml", recipe("a").to_string());
    place.ok("build");
    let again = place.ok("build --recheck 100%");
    assert!(again.stderr.contains("6 steps rerun, each with the recorded bytes"), "{}", again.stderr);
    assert!(again.stderr.contains("0 steps built, 6 reused, 0 failed"), "{}", again.stderr);
    assert!(!place.ok("build --recheck 0").stderr.contains("steps rerun"));
    assert_eq!(place.gs2e("build --recheck 101%").code, 2);
}

#[test]
fn a_step_above_the_memory_budget_runs_alone_with_a_warning() {
    let place = Workspace::new();
    place.write("recipes/a.yaml", recipe("a").to_string());
    let ended = place.ok("build -j 2 --memory 1MB");
    assert!(ended.stderr.contains("no other step runs with it"), "{}", ended.stderr);
    assert!(ended.stderr.contains("6 steps built,"), "{}", ended.stderr);
    assert_eq!(place.gs2e("build --memory lots").code, 2);
}

/// Before the first run there is no estimate. Afterwards a similar scene is expected to take as
/// long as the first.
#[test]
fn an_estimate_comes_from_earlier_runs() {
    let place = Workspace::new();
    place.write("recipes/a.yaml", recipe("a").to_string());
    let estimate = || -> Value { serde_json::from_str(&place.ok("plan --estimate --json").stdout).unwrap() };
    let before = estimate();
    assert_eq!((&before["steps"], &before["unknown"], &before["bytes"]), (&json!(6), &json!(6), &json!(0.0)));
    let message = place.ok("plan --estimate").stdout;
    let first = message.lines().next().unwrap();
    assert!(first.contains("unknown") && !first.contains("0.0"), "{message}");
    place.ok("build");
    assert_eq!(estimate()["steps"], json!(0));
    let made = steps(&place, "recipes");
    let sizes = made.values().flat_map(|step| step.outputs.values());
    let bytes: u64 = sizes.map(|path| fs::metadata(path).unwrap().len()).sum();
    fs::remove_file(place.path("recipes/a.yaml")).unwrap();
    let mut other = recipe("b");
    other["source"]["procedural"]["seed"] = json!(9);
    place.write("recipes/b.yaml", other.to_string());
    let after = estimate();
    assert_eq!((&after["steps"], &after["unknown"]), (&json!(6), &json!(0)));
    assert_eq!(after["bytes"].as_f64(), Some(bytes as f64));
    assert!(after["core_seconds"].as_f64() > Some(0.0) && after["memory"].as_f64() > Some(0.0), "{after}");
}
