//! Several machines with one shared folder: each is a process here, with a store of its own.

mod bounded;
mod faults;
mod hostile;

use crate::support::steps::recipe;
use crate::support::workspace::{Workspace, same_tree};
use gs2e_store::description::describe_value;
use gs2e_store::record::{StepProvenance, StepRecord, StoredOutput};
use gs2e_store::{Digest, Key, Store, StoreAccess, StoreError, StoreOptions};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

/// Scenes whose steps all differ, below a folder with defaults.
const SCENES: u64 = 6;

fn place() -> Workspace {
    let place = Workspace::new();
    for i in 0..SCENES {
        let mut recipe: Value = recipe(&format!("s{i}"));
        recipe["source"]["procedural"]["seed"] = json!(i);
        let licence = recipe.as_object_mut().unwrap().remove("licence");
        place.write("recipes/defaults.yaml", json!({ "licence": licence }).to_string());
        place.write(&format!("recipes/lab/s{i}.yaml"), recipe.to_string());
    }
    place
}

/// Starts the machine `name` on its own store and the shared folder.
fn start(place: &Workspace, name: &str, options: &str) -> Child {
    let mut command =
        place.command(&format!("build --json -j 1 --store {name} --shared-store shared {options}"));
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Number of steps by their state, after the end of a build.
fn states(child: Child) -> BTreeMap<String, usize> {
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut states = BTreeMap::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        if let Some(state) = line["state"].as_str() {
            *states.entry(state.to_owned()).or_default() += 1;
        }
    }
    states
}

fn count(states: &BTreeMap<String, usize>, state: &str) -> usize {
    states.get(state).copied().unwrap_or(0)
}

/// Releases from a new store and the shared folder, and compares with a release of one machine.
fn releases_equal(place: &Workspace) {
    place.ok("release --store alone --to one");
    let ended = place.ok("release --store new --shared-store shared --to other");
    assert!(ended.stderr.lines().any(|line| line.starts_with("0 steps built,")), "{}", ended.stderr);
    same_tree(&place.path("one"), &place.path("other"));
}

#[test]
fn shards_make_each_step_once_and_the_release_is_that_of_one_machine() {
    let place = place();
    let shards: Vec<Child> =
        (1..=4).map(|i| start(&place, &format!("m{i}"), &format!("--shard {i}/4"))).collect();
    let made: usize = shards.into_iter().map(|shard| count(&states(shard), "made")).sum();
    place.ok("build --store alone");
    let alone = Store::open(&place.path("alone"), StoreAccess::Read, &mut |_| {}).unwrap();
    assert_eq!(made, alone.records().len());
    releases_equal(&place);
}

#[test]
fn machines_that_build_the_same_scenes_do_no_harm() {
    let place = place();
    let machines: Vec<Child> = (0..3).map(|i| start(&place, &format!("m{i}"), "")).collect();
    for machine in machines {
        let states = states(machine);
        assert_eq!(count(&states, "failed"), 0, "{states:?}");
    }
    releases_equal(&place);
}

#[test]
fn work_of_a_killed_shard_is_taken_up_by_the_next() {
    let place = place();
    let mut killed = start(&place, "m1", "");
    // Some steps are finished by then, and one is at work.
    let folder = place.path("shared/ac");
    while !folder.exists() || files_below(&folder).len() < 5 {
        assert!(killed.try_wait().unwrap().is_none(), "it ended before it was killed");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    let next = states(start(&place, "m2", ""));
    assert!(count(&next, "adopted") >= 5, "{next:?}");
    releases_equal(&place);
}

#[test]
fn steps_made_before_there_was_a_shared_store_are_offered() {
    let place = place();
    place.ok("build --store m1");
    let kept = states(start(&place, "m1", ""));
    assert_eq!((count(&kept, "made"), count(&kept, "adopted")), (0, 0), "{kept:?}");
    releases_equal(&place);
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let found = walkdir::WalkDir::new(folder).into_iter().map(|entry| entry.unwrap());
    found.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect()
}

#[test]
fn damaged_files_are_made_again_and_replaced() {
    check_damaged_files("--recheck 0");
}

/// These steps are not adopted, so the machine does not see their files by copying them.
#[test]
fn damaged_files_of_steps_made_again_for_comparison_are_replaced() {
    check_damaged_files("--recheck 1");
}

/// Damages files of the shared store, and builds on a machine with these options. The next machine makes
/// nothing.
fn check_damaged_files(options: &str) {
    let place = place();
    states(start(&place, "m0", ""));
    let damages: [fn(&Path, Vec<u8>); 3] = [
        |path, _| std::fs::remove_file(path).unwrap(),
        |path, bytes| std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap(),
        |path, mut bytes| {
            bytes[0] ^= 1;
            std::fs::write(path, bytes).unwrap();
        },
    ];
    for (i, damage) in damages.into_iter().enumerate() {
        for (at, path) in files_below(&place.path("shared")).into_iter().enumerate() {
            let bytes = std::fs::read(&path).unwrap();
            // A third of the files, others each time. `VERSION` says who may read the rest.
            if at % 3 == i && !bytes.is_empty() && !path.ends_with("VERSION") {
                std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).unwrap();
                damage(&path, bytes);
            }
        }
        let mended = states(start(&place, &format!("m{}", 2 * i + 1), options));
        assert!(count(&mended, "made") > 0 && count(&mended, "adopted") > 0, "{mended:?}");
        let next = states(start(&place, &format!("m{}", 2 * i + 2), "--recheck 0"));
        assert_eq!(count(&next, "made"), 0, "damage {i}: {next:?}");
    }
    releases_equal(&place);
}

fn store(folder: &Path, shared: &Path) -> Result<Store, StoreError> {
    let options = StoreOptions { shared: Some(shared.to_owned()), ..StoreAccess::Write.into() };
    Store::open(folder, options, &mut |_| {})
}

fn sample_record(outputs: Vec<StoredOutput>) -> StepRecord {
    let description = describe_value("sample");
    let key = Key::of_description(&description);
    let mut record = StepRecord::new(key, "test", description.lines(), StepProvenance::default());
    record.outputs = outputs;
    record
}

fn publish(store: &Store, text: &str) -> Key {
    let workspace = store.workspace().unwrap();
    std::fs::write(workspace.path().join("a.txt"), text).unwrap();
    let record = sample_record(Vec::new());
    let key = record.key;
    store.publish(&workspace, record).unwrap();
    key
}

#[test]
fn other_bytes_for_a_key_are_an_error_and_the_first_stay() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other, third, shared] =
        ["one", "other", "third", "shared"].map(|name| folder.path().join(name));
    let one = store(&one, &shared).unwrap();
    let key = publish(&one, "one");
    one.share(&key).unwrap();
    let other = store(&other, &shared).unwrap();
    publish(&other, "two");
    let error = other.share(&key).unwrap_err();
    assert!(matches!(error, StoreError::SharedMismatch(_)), "{error}");
    assert!(error.to_string().contains("a.txt differs"), "{error}");
    let adopted = store(&third, &shared).unwrap().adopt(&key).unwrap().unwrap();
    assert_eq!(adopted.outputs[0].digest, Digest::of_bytes(b"one"));
}

#[test]
fn a_record_whose_files_lie_elsewhere_is_not_adopted() {
    let folder = tempfile::tempdir().unwrap();
    let [own, shared] = ["own", "shared"].map(|name| folder.path().join(name));
    let store = store(&own, &shared).unwrap();
    let key = publish(&store, "one");
    store.share(&key).unwrap();
    let path = files_below(&shared.join("ac")).remove(0);
    hostile::forge(&path, |record| record["outputs"][0]["name"] = json!("../../../outside.txt"));
    assert!(store.adopt(&key).unwrap().is_none());
    assert!(!folder.path().join("outside.txt").exists());
}

#[test]
fn folders_that_cannot_be_shared_are_refused() {
    let place = place();
    place.ok("build --store alone recipes/lab/s0.yaml");
    let refused = |shared: &str, wanted: &str| {
        let ended = place.gs2e(&format!("build --store m --shared-store {shared} recipes/lab/s0.yaml"));
        assert_ne!(ended.code, 0, "{shared}");
        assert!(ended.stderr.contains(wanted), "{shared}: {}", ended.stderr);
    };
    refused("alone", "is the store of one machine");
    place.write("newer/VERSION", "gs2e shared store, format 99\n");
    refused("newer", "has format 99");
    refused("newer", "use a newer gs2e");
    place.write("file", "text");
    refused("file", "file");
    for shard in ["0/2", "3/2", "x"] {
        let ended = place.gs2e(&format!("build --shard {shard}"));
        assert_eq!(ended.code, 2, "{shard}");
        assert!(ended.stderr.contains("I/N"), "{}", ended.stderr);
    }
    let ended = place.ok("build --shard 9/9");
    assert!(ended.stderr.contains("shard 9 of 9: 0 of 6 scenes"), "{}", ended.stderr);
    // No number of shares needs more memory than the scenes.
    let ended = place.ok("build --shard 4294967295/4294967295");
    assert!(ended.stderr.contains(": 0 of 6 scenes"), "{}", ended.stderr);
}
