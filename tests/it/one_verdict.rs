//! A release and `check --tree` judge the same files alike, and a release that its check would fail is not
//! written.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

use crate::support::workspace::{RunOutcome, Workspace};
use gs2e_release::ReleaseManifest;
use gs2e_store::record::{StepProvenance, StepRecord};
use gs2e_store::{Key, Store, StoreAccess, StoreError, StoreOptions};
use serde_json::Value;
use std::fs;
use std::time::Duration;

/// A path that passes an object, with every product of one camera.
const RICH: &str = "\
version: 1
scene: rich
seed: 3
source: { procedural: { kind: still-life, gaussians: 2000, views: 8, arc: 6, seed: 1 } }
camera: { width: 120, height: 90 }
trajectories: [{ name: base, refine: { window: 1, factor: 5 } }]
sampling: { rate: 1200 }
sensors:
  a: { voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } } }
  b: { v2e: { preset: clean } }
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    path: { straight: { velocity: [2, -1, 0] } }
outputs: [events, sharp, blur, depth, flow, segmentation]
blur: { frames: 5, subframes: literal }
";

fn released(recipe: &str) -> (Workspace, RunOutcome) {
    let place = Workspace::new();
    place.write("scene.yaml", recipe);
    let ended = place.gs2e("release --copy --to out scene.yaml");
    (place, ended)
}

/// The counts of the verdicts in a text, but for `not run`.
fn counts(text: &str) -> String {
    let line = text.lines().find(|line| line.contains(" pass, ")).unwrap_or_default();
    let line = line.strip_prefix("checks: ").unwrap_or(line);
    line.split(", ").take(4).collect::<Vec<_>>().join(", ")
}

#[test]
fn a_release_and_its_check_count_the_same() {
    for (recipe, sparse) in [(RICH, false), (RICH, true)] {
        let recipe = if sparse { format!("{recipe}sharp: {{ every: 4 }}\n") } else { recipe.to_owned() };
        let (place, ended) = released(&recipe);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        let checked = place.gs2e("check --tree out");
        let said = counts(&ended.stderr);
        assert!(said.contains(" pass, "), "{}", ended.stderr);
        assert_eq!(said, counts(&checked.stderr), "{}\n{}", ended.stderr, checked.stdout);
    }
}

/// The findings on the scene count too, and those of scenes that are up to date at a glance.
#[test]
fn a_build_and_its_check_count_the_same() {
    let place = Workspace::new();
    place.write("scene.yaml", RICH);
    let line = |command: &str| {
        let ended = place.ok(command);
        let line = ended.stderr.lines().find(|line| line.contains(" pass, ")).unwrap_or_default().to_owned();
        let line = line.strip_prefix("checks: ").unwrap_or(&line);
        line.split(';').next().unwrap_or_default().to_owned()
    };
    let built = line("build scene.yaml");
    let checked = line("check scene.yaml");
    assert!(checked.contains(" pass, ") && !checked.starts_with("0 pass"), "{checked}");
    assert_eq!(built, checked);
    // Until the files are old enough to be known by their stat fields.
    std::thread::sleep(Duration::from_millis(2100));
    for _ in 0..2 {
        assert_eq!(line("build scene.yaml"), checked);
    }
}

#[test]
fn what_the_pictures_show_is_in_the_findings_of_a_release() {
    let (place, ended) = released(RICH);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let text = fs::read_to_string(place.path("out/rich/base/checks.json")).unwrap();
    let findings: Vec<Value> = serde_json::from_str(&text).unwrap();
    let verdict = |check: &str, subject: &str| {
        let is_it = |f: &&Value| f["check"] == check && f["subject"] == subject;
        findings.iter().find(is_it).map_or("absent", |f| f["verdict"].as_str().unwrap())
    };
    assert_eq!(verdict("flow_projection", "rich/base#objects"), "pass", "{text}");
    assert_eq!(verdict("records", "rich/base#blur"), "pass", "{text}");
    assert_eq!(verdict("drift_identity", "rich/base/a#pixels"), "pass", "{text}");
    // A release has what `check --tree` reads.
    assert!(!text.contains("check --tree"), "{text}");
}

/// Puts a picture of one pose in the place of another into the store.
fn exchange(place: &Workspace, from: &str, to: &str) {
    let manifest = fs::read(place.path("out/manifest.json")).unwrap();
    let manifest: ReleaseManifest = serde_json::from_slice(&manifest).unwrap();
    let step = manifest.scenes[0].steps.iter().find(|step| step.step == "base/sharp").unwrap();
    let options = StoreOptions::from(StoreAccess::Write);
    let store = Store::open(&place.path(".gs2e"), options, &mut |_| {}).unwrap();
    let workspace = store.workspace().unwrap();
    let digest = |name: &str| step.outputs.iter().find(|output| output.name == name).unwrap().digest;
    for output in &step.outputs {
        let of = if output.name == to { digest(from) } else { output.digest };
        fs::copy(store.path_of(&of), workspace.path().join(&output.name)).unwrap();
    }
    // A key whose outputs are intact keeps them.
    fs::remove_file(store.path_of(&digest(to))).unwrap();
    let record = StepRecord::new(Key(step.key), &step.stage, Vec::new(), StepProvenance::default());
    // The outputs of the key were lost, and are replaced by others.
    let published = store.publish(&workspace, record);
    assert!(matches!(&published, Err(StoreError::Nondeterministic(mismatch)) if mismatch.replaced));
    store.flush().unwrap();
}

#[test]
fn a_release_that_its_check_would_fail_is_not_written() {
    let (place, ended) = released(RICH);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    exchange(&place, "000030.png", "000010.png");
    let ended = place.gs2e("release --copy --to new scene.yaml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(!place.path("new").exists());
    assert!(ended.stderr.contains("rich/base#frames: photometric: "), "{}", ended.stderr);
    assert!(ended.stderr.contains("poses 10 and 11"), "{}", ended.stderr);
}

#[test]
fn files_are_judged_once() {
    let (place, _) = released(RICH);
    let records = || {
        let is_verdicts = |path: &walkdir::DirEntry| {
            fs::read_to_string(path.path()).is_ok_and(|text| text.contains("\"stage\":\"file-checks\""))
        };
        let files = walkdir::WalkDir::new(place.path(".gs2e/ac")).into_iter().map(Result::unwrap);
        files.filter(|entry| entry.file_type().is_file()).filter(is_verdicts).count()
    };
    assert_eq!(records(), 1);
    place.ok("release --copy --to second scene.yaml");
    place.ok("gc scene.yaml");
    assert_eq!(records(), 1, "the release keeps the verdicts on its files");
    place.write("scene.yaml", RICH.replace("seed: 3", "seed: 4"));
    place.ok("release --copy --to second scene.yaml");
    assert_eq!(records(), 2);
}
