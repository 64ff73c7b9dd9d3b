//! `gs2e audit --rebuild` makes scenes again from their recipes; `gs2e check --tree` judges the
//! released files.

use super::{BASE, resum};
use crate::release::small::{RECIPE, copy, gs2e, reseal, said};
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Two scenes, the second with another seed.
fn recipes() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let recipes = folder.path().join("recipes");
    fs::create_dir(&recipes).unwrap();
    fs::write(recipes.join("one.yaml"), RECIPE).unwrap();
    fs::write(
        recipes.join("two.yaml"),
        RECIPE.replace("small/one", "small/two").replace("seed: 7", "seed: 8"),
    )
    .unwrap();
    let output = gs2e(folder.path(), &["release", "--copy", "--to", "out"]);
    assert!(output.status.success(), "{}", said(&output));
    folder
}

/// Exit code, and code and file of each fault.
fn rebuilt(folder: &Path, arguments: &[&str]) -> (Option<i32>, Vec<String>) {
    let output = gs2e(folder, &[&["audit", "out", "--json"], arguments].concat());
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    let records = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let faults = records.filter(|record| record["code"].is_string());
    let name = |fault: Value| {
        format!("{} {}", fault["code"].as_str().unwrap(), fault["file"].as_str().unwrap_or("-"))
    };
    (output.status.code(), faults.map(name).collect())
}

#[test]
fn rebuilt_scenes_have_the_same_bytes_and_changes_are_found() {
    let folder = recipes();
    // The scenes must not be rebuilt from the release's own store.
    fs::remove_dir_all(folder.path().join(".gs2e")).unwrap();
    assert_eq!(rebuilt(folder.path(), &["--rebuild", "2"]), (Some(0), vec![]));
    assert!(!folder.path().join(".gs2e").exists(), "what is made again leaves nothing behind");

    // A change with rewritten sums is found only by making the scene again.
    let sharp = folder.path().join("out/small/two/base/sharp/000004.png");
    let other = fs::read(folder.path().join("out/small/two/base/sharp/000008.png")).unwrap();
    fs::write(&sharp, other).unwrap();
    reseal(&folder.path().join("out"));
    assert_eq!(rebuilt(folder.path(), &[]), (Some(0), vec![]));
    // The step of the frame, and the checks that read it.
    let wanted = ["manifest.json", "manifest.json", "small/two/base/sharp/000004.png"];
    let wanted = wanted.map(|path| format!("rebuilt-differs {path}")).to_vec();
    assert_eq!(rebuilt(folder.path(), &["--rebuild", "9"]), (Some(3), wanted));

    // A changed recipe is found.
    let recipe = folder.path().join("recipes/one.yaml");
    fs::write(&recipe, RECIPE.replace("seed: 7", "seed: 9")).unwrap();
    let output = gs2e(folder.path(), &["audit", "out", "--rebuild", "2"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(said(&output).contains("its step base/events differs in its parameters"), "{}", said(&output));

    fs::remove_file(recipe).unwrap();
    let output = gs2e(folder.path(), &["audit", "out", "--rebuild", "2"]);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("no recipe makes the scene `small/one`"), "{}", said(&output));
}

/// Exit code and records of `check --tree`.
fn checked(folder: &Path, arguments: &[&str]) -> (Option<i32>, Vec<Value>) {
    let output = gs2e(folder, &[&["check", "--json", "--tree", "."], arguments].concat());
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    (output.status.code(), text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

#[test]
fn a_tree_is_checked_by_its_files() {
    let folder = copy();
    let (code, records) = checked(folder.path(), &[]);
    assert_eq!(code, Some(0));
    let verdict = |check: &str, part: &str| {
        let subject = format!("{BASE}{part}");
        let found = records.iter().find(|r| r["check"] == check && r["subject"] == *subject);
        found.unwrap_or_else(|| panic!("{check} {subject}"))["verdict"].as_str().unwrap().to_owned()
    };
    for (check, part) in
        [("schema", "#order"), ("stamps", "#events"), ("pose_continuity", "#rotation"), ("speed", "#length")]
    {
        assert_eq!(verdict(check, part), "pass", "{check}");
    }
    // The sharp frames of the release stand for what the sensor saw.
    assert_eq!(verdict("event_frame", "#residual"), "pass");
    // A check whose data are not in the release has the verdict of the build, and may be required.
    assert_eq!(verdict("drift_identity", "#pixels"), "pass");
    assert_eq!(checked(folder.path(), &["--require", "drift_identity"]).0, Some(3));
    assert_eq!(checked(folder.path(), &["small/two"]).0, Some(2));
}

#[test]
fn a_tree_of_altered_poses_fails() {
    let folder = copy();
    let poses = folder.path().join(BASE).join("poses.txt");
    let text = fs::read_to_string(&poses).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut words: Vec<String> = lines[9].split(' ').map(str::to_owned).collect();
    words[1] = (words[1].parse::<f64>().unwrap() + 0.5).to_string();
    lines[9] = words.join(" ");
    fs::write(&poses, lines.join("\n") + "\n").unwrap();
    resum(folder.path());
    let (code, records) = checked(folder.path(), &[]);
    assert_eq!(code, Some(3));
    let failed: Vec<&str> =
        records.iter().filter(|r| r["verdict"] == "fail").map(|r| r["check"].as_str().unwrap()).collect();
    for check in ["pose_continuity", "speed", "records"] {
        assert!(failed.contains(&check), "{check}: {records:#?}");
    }
}
