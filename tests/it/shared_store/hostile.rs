//! A member of the shared store who plants links, special files, sparse files and altered records.

use super::{count, files_below, place, start, states};
use crate::support::workspace::Workspace;
use gs2e_store::Digest;
use gs2e_store::record::StepRecord;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

const SCENE: &str = "recipes/lab/s0.yaml";
/// More than any disk holds.
const HUGE: u64 = 1 << 42;

/// A shared store with one scene, and a folder outside with a file.
fn shared() -> Workspace {
    let place = place();
    place.ok(&format!("build --store m0 --shared-store shared {SCENE}"));
    place.write("outside/thesis.txt", "mine");
    place
}

/// Writes a record with a sound seal, as every member of the store can.
pub(super) fn forge(path: &Path, edit: impl Fn(&mut Value)) {
    let mut value: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    edit(&mut value);
    value["seal"] = json!("");
    let unsealed: StepRecord = serde_json::from_value(value.clone()).unwrap();
    value["seal"] = json!(Digest::of_bytes(&serde_json::to_vec(&unsealed).unwrap()).to_string());
    fs::write(path, value.to_string()).unwrap();
}

/// The record of a stage.
fn record_of(place: &Workspace, stage: &str) -> PathBuf {
    let is_wanted = |path: &PathBuf| {
        let value: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        value["stage"] == stage
    };
    files_below(&place.path("shared/ac")).into_iter().find(is_wanted).unwrap()
}

/// Ways in which a file of the shared store can be replaced.
const HARMS: [fn(&Path); 5] = [
    |path| mknodat(CWD, path, FileType::Fifo, Mode::RUSR, 0).unwrap(),
    |path| symlink("/dev/zero", path).unwrap(),
    |path| symlink("../../../outside/thesis.txt", path).unwrap(),
    |path| fs::create_dir_all(path.join("more")).unwrap(),
    |path| fs::File::create(path).unwrap().set_len(HUGE).unwrap(),
];

#[test]
fn what_is_no_blob_or_no_record_is_made_again_and_replaced() {
    let place = shared();
    for (at, harm) in HARMS.into_iter().enumerate() {
        let files: Vec<PathBuf> =
            ["cas", "ac"].iter().flat_map(|folder| files_below(&place.path("shared").join(folder))).collect();
        // Every other file: another one is met first each time.
        for path in files.iter().skip(at % 2).step_by(2) {
            fs::remove_file(path).unwrap();
            harm(path);
        }
        let next = states(start(&place, &format!("m1-{at}"), SCENE));
        assert!(count(&next, "made") > 0, "harm {at}: {next:?}");
        let sound = states(start(&place, &format!("m2-{at}"), SCENE));
        assert_eq!(count(&sound, "made"), 0, "harm {at}: {sound:?}");
        assert_eq!(fs::read_to_string(place.path("outside/thesis.txt")).unwrap(), "mine");
    }
}

#[test]
fn a_link_to_the_sound_bytes_is_replaced_too() {
    let place = shared();
    // Others could alter what it leads to after it was compared.
    let blob = files_below(&place.path("shared/cas")).remove(0);
    fs::rename(&blob, place.path("outside/copy")).unwrap();
    symlink(place.path("outside/copy"), &blob).unwrap();
    assert!(count(&states(start(&place, "m1", SCENE)), "made") > 0);
    assert!(fs::symlink_metadata(&blob).unwrap().is_file());
}

#[test]
fn folders_that_are_links_are_refused_and_nothing_is_written_behind_them() {
    let place = shared();
    for folder in ["cas", "ac", "gs2e-tmp", "gs2e-trash", "gs2e-plans"] {
        let path = place.path("shared").join(folder);
        fs::create_dir_all(&path).unwrap();
        fs::rename(&path, place.path("aside")).unwrap();
        symlink("../outside", &path).unwrap();
        for verb in ["build --store m1", "gc --older-than 1h"] {
            let recipes = if verb.starts_with("build") { SCENE } else { "" };
            let ended = place.gs2e(&format!("{verb} --shared-store shared {recipes}"));
            assert_eq!(ended.code, 2, "{folder}, {verb}: {}", ended.stderr);
            assert!(ended.stderr.contains(&format!("shared/{folder} is a link")), "{}", ended.stderr);
        }
        assert_eq!(fs::read_dir(place.path("outside")).unwrap().count(), 1, "{folder}");
        fs::remove_file(&path).unwrap();
        fs::rename(place.path("aside"), &path).unwrap();
    }
    // A link in the place of one folder of blobs.
    let blob = files_below(&place.path("shared/cas")).remove(0);
    let folder = blob.parent().unwrap();
    fs::rename(folder, place.path("aside")).unwrap();
    symlink("../../outside", folder).unwrap();
    let ended = place.gs2e(&format!("build --store m1 --shared-store shared {SCENE}"));
    assert!(ended.code != 0 && ended.stderr.contains("is a link"), "{}", ended.stderr);
    assert_eq!(fs::read_dir(place.path("outside")).unwrap().count(), 1);
}

#[test]
fn the_times_of_files_behind_links_stay() {
    let place = shared();
    let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    let thesis = place.path("outside/thesis.txt");
    fs::File::options().write(true).open(&thesis).unwrap().set_modified(long_ago).unwrap();
    for record in files_below(&place.path("shared/ac")) {
        fs::remove_file(&record).unwrap();
        symlink(&thesis, &record).unwrap();
    }
    states(start(&place, "m1", SCENE));
    assert_eq!(fs::metadata(&thesis).unwrap().modified().unwrap(), long_ago);
}

#[test]
fn an_altered_record_is_found_by_making_the_step_again() {
    let place = shared();
    let record = record_of(&place, "events");
    // The files of another step, which have the right hashes.
    let other: Value = serde_json::from_slice(&fs::read(record_of(&place, "trajectory")).unwrap()).unwrap();
    let digest = other["outputs"][0]["digest"].clone();
    let size = other["outputs"][0]["size"].clone();
    let sound = fs::read(&record).unwrap();
    forge(&record, |value| {
        value["outputs"][0]["digest"] = digest.clone();
        value["outputs"][0]["size"] = size.clone();
    });
    let ended = place.gs2e(&format!("release --recheck 1 --store m1 --shared-store shared --to out {SCENE}"));
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let name = record.file_name().unwrap().to_str().unwrap();
    for wanted in ["has other outputs of key", "events", name, "delete that file and run the same command"] {
        assert!(ended.stderr.contains(wanted), "{wanted}\n{}", ended.stderr);
    }
    assert!(!place.path("out").exists());
    // It stays an error, without another draw: the own store knows better now.
    let ended = place.gs2e(&format!("build --recheck 0 --store m1 --shared-store shared {SCENE}"));
    assert!(ended.code == 1 && ended.stderr.contains("has other outputs of key"), "{}", ended.stderr);
    // As the help says.
    fs::remove_file(&record).unwrap();
    place.ok(&format!("release --store m1 --shared-store shared --to out {SCENE}"));
    let outputs = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).unwrap()["outputs"].clone();
    assert_eq!(outputs(&fs::read(&record).unwrap()), outputs(&sound));
}

#[test]
fn steps_of_others_that_are_made_again_count_as_theirs() {
    let place = shared();
    let records = files_below(&place.path("shared/ac")).len();
    let ended = place.ok(&format!("build --json --recheck 1 --store m1 --shared-store shared {SCENE}"));
    let lines: Vec<Value> = ended.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(lines.iter().all(|line| line["state"] != "made"), "{lines:?}");
    let adopted: Vec<&Value> = lines.iter().filter(|line| line["state"] == "adopted").collect();
    assert_eq!(adopted.len(), records, "{lines:?}");
    assert!(adopted.iter().all(|line| line["confirmed"] == true && line["cores"].is_u64()), "{lines:?}");
    let wanted = format!("{records} steps of the shared store rerun, each with its bytes");
    assert!(ended.stderr.contains(&wanted), "{}", ended.stderr);
    assert!(ended.stderr.contains(&format!("{records} from the shared store")), "{}", ended.stderr);
    let ended = place.ok(&format!("build --json --recheck 0 --store m2 --shared-store shared {SCENE}"));
    assert!(!ended.stdout.contains("confirmed"), "{}", ended.stdout);
}

#[test]
fn records_whose_files_cannot_lie_side_by_side_are_made_again() {
    let place = shared();
    for edit in [
        (|value: &mut Value| value["outputs"][0]["name"] = json!("../../outside/x")) as fn(&mut Value),
        |value| {
            let first = value["outputs"][0].clone();
            value["outputs"].as_array_mut().unwrap().push(first);
        },
        |value| {
            let mut below = value["outputs"][0].clone();
            below["name"] = json!(format!("{}/x", below["name"].as_str().unwrap()));
            value["outputs"].as_array_mut().unwrap().push(below);
        },
    ] {
        forge(&record_of(&place, "trajectory"), edit);
        let next = states(start(&place, "m1", SCENE));
        assert_eq!(count(&next, "made"), 1, "{next:?}");
        fs::remove_dir_all(place.path("m1")).unwrap();
    }
    assert_eq!(fs::read_dir(place.path("outside")).unwrap().count(), 1);
}

#[test]
fn a_collection_leaves_files_that_are_not_its_own() {
    let place = shared();
    let foreign = [
        "gs2e-tmp/me/thesis.txt",
        "gs2e-tmp/gs2e-abc/thesis.txt",
        "gs2e-trash/old/thesis.txt",
        "gs2e-trash/gs2e-abc/thesis.txt",
        "gs2e-plans/notes/thesis.txt",
        "gs2e-plans/0123456789ab/thesis.txt",
        "cas/ab/thesis.txt",
        "ac/ab/thesis.txt",
        "tmp/thesis.txt",
        "trash/thesis.txt",
        "plans/thesis/plan.json",
    ];
    foreign.iter().for_each(|name| place.write(&format!("shared/{name}"), "mine"));
    place.write("shared/gs2e-plans/0123456789ac/plan.json", "{}");
    super::faults::set_times_below(&place.path("shared"), SystemTime::now() - Duration::from_secs(172_800));
    let ended = place.ok("gc --shared-store shared --older-than 1d");
    assert!(ended.stderr.contains("deleted 1 files"), "{}", ended.stderr);
    for name in foreign {
        assert_eq!(fs::read_to_string(place.path("shared").join(name)).unwrap(), "mine", "{name}");
    }
    assert!(!place.path("shared/gs2e-plans/0123456789ac").exists());
}

#[test]
fn a_folder_with_other_content_is_no_shared_store() {
    let place = shared();
    for verb in ["build --store m1", "gc --older-than 1h", "status"] {
        let ended = place.gs2e(&format!("{verb} --shared-store outside"));
        assert_eq!(ended.code, 2, "{verb}: {}", ended.stderr);
    }
    assert_eq!(fs::read_dir(place.path("outside")).unwrap().count(), 1);
}
