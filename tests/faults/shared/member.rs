//! A member of the shared store who harms it. Nothing outside the store is touched, and nothing wrong is
//! built without a word.

use super::{adopted, build, place};
use crate::place::{Place, Products, tree};
use crate::random::Random;
use crate::tally::Tally;
use gs2e_build::cluster::submission::{PlannedTask, Submission, SubmittedScene, TaskNeed, shard_name};
use gs2e_recipe::RecipeFile;
use gs2e_store::Digest;
use gs2e_store::record::StepRecord;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// A harm to one file.
type Harm = fn(&Path);

/// Harms that cost the others work, and nothing else.
const HARMS: [Harm; 6] = [
    |path| mknodat(CWD, path, FileType::Fifo, Mode::RUSR, 0).unwrap(),
    |path| symlink("/dev/zero", path).unwrap(),
    |path| symlink("../../../outside/thesis.txt", path).unwrap(),
    |path| fs::create_dir_all(path.join("more")).unwrap(),
    |path| fs::File::create(path).unwrap().set_len(1 << 42).unwrap(),
    |path| fs::write(path, "other bytes").unwrap(),
];

/// Folders that may not be links.
const FOLDERS: [&str; 5] = ["cas", "ac", "gs2e-tmp", "gs2e-trash", "gs2e-plans"];

pub(super) fn harmed(truth: &Products, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let place = place();
    place.write("outside/thesis.txt", "mine");
    let before = tree(&place.path("outside"));
    place.ok(&build(0))?;
    match random.below(4) {
        0 => linked_folder(&place, random, tally)?,
        1 => altered_record(&place, random, tally)?,
        2 => altered_plan(&place, random, tally)?,
        _ => {
            for _ in 0..=random.below(5) {
                let path = random.pick(&stored(&place, &["ac", "cas"])).clone();
                fs::remove_file(&path).unwrap();
                (random.pick(&HARMS))(&path);
                tally.count("harms of a member", 1);
            }
        }
    }
    place.ok(&build(1))?;
    place.ok("gc --shared-store shared --older-than 1h")?;
    adopted(&place, truth)?;
    if tree(&place.path("outside")) == before { Ok(()) } else { Err("files outside were touched".to_owned()) }
}

/// The files of these folders of the shared store that are regular.
fn stored(place: &Place, folders: &[&str]) -> Vec<PathBuf> {
    let entries = folders
        .iter()
        .flat_map(|folder| walkdir::WalkDir::new(place.path("shared").join(folder)).sort_by_file_name());
    entries
        .map(Result::unwrap)
        .filter(|entry| entry.file_type().is_file())
        .map(walkdir::DirEntry::into_path)
        .collect()
}

/// Runs a command that must fail with these words.
fn refused(place: &Place, args: &str, wanted: &str, tally: &mut Tally) -> Result<(), String> {
    let ended = place.run(args)?;
    if ended.code == Some(0) || !ended.stderr.contains(wanted) {
        return Err(format!("`gs2e {args}` did not say `{wanted}`: {ended}"));
    }
    tally.count("harms that were refused", 1);
    Ok(())
}

/// A folder of the store is a link, and then a folder again.
fn linked_folder(place: &Place, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let path = place.path("shared").join(random.pick(&FOLDERS));
    fs::create_dir_all(&path).unwrap();
    fs::rename(&path, place.path("aside")).unwrap();
    symlink("../outside", &path).unwrap();
    tally.count("harms of a member", 1);
    refused(place, &build(1), "is a link", tally)?;
    refused(place, "gc --shared-store shared --older-than 1h", "is a link", tally)?;
    fs::remove_file(&path).unwrap();
    fs::rename(place.path("aside"), &path).unwrap();
    Ok(())
}

/// A record has the outputs of another one, and a sound seal. Once it was found, it is deleted.
fn altered_record(place: &Place, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let records = stored(place, &["ac"]);
    let read = |path: &Path| serde_json::from_slice::<Value>(&fs::read(path).unwrap()).unwrap();
    let (path, other) = (random.pick(&records), random.pick(&records));
    let (mut value, other) = (read(path), read(other));
    if value["outputs"] == other["outputs"] {
        return Ok(());
    }
    value["outputs"] = other["outputs"].clone();
    value["seal"] = json!("");
    let unsealed: StepRecord = serde_json::from_value(value.clone()).unwrap();
    value["seal"] = json!(Digest::of_bytes(&serde_json::to_vec(&unsealed).unwrap()).to_string());
    fs::write(path, value.to_string()).unwrap();
    tally.count("harms of a member", 1);
    refused(place, &format!("{} --recheck 1", build(1)), "has other outputs of key", tally)?;
    fs::remove_file(path).unwrap();
    Ok(())
}

/// A task finds its shard, or its plan, with other bytes.
fn altered_plan(place: &Place, random: &mut Random, tally: &mut Tally) -> Result<(), String> {
    let task = |number: u32| -> PlannedTask {
        let scene = format!("s{number}");
        let recipe = Digest::of_bytes(scene.as_bytes());
        let path = place.path(&format!("recipes/{number}.yaml"));
        vec![(SubmittedScene { scene, recipe }, RecipeFile { path, defaults: None })]
    };
    let tasks = [task(0), task(1)];
    let need = TaskNeed { memory_mb: 1000, cores: 1, gpu: false };
    let submission = Submission::plan(&place.path("shared"), need, &tasks);
    submission.write(&tasks, "").map_err(|e| e.to_string())?;
    let folder = place.path("shared").join(submission.below());
    let shard = folder.join(shard_name(1));
    let command = format!(
        "build -q --store task --shared-store shared --shard-file {} --plan-digest {}",
        shard.display(),
        submission.digest
    );
    place.ok(&command)?;
    let path = if random.once_in(2) { folder.join("plan.json") } else { shard };
    let bytes = fs::read(&path).unwrap();
    let mut altered = bytes.clone();
    altered[random.below(bytes.len())] ^= 1 << random.below(7);
    fs::remove_file(&path).unwrap();
    fs::write(&path, altered).unwrap();
    tally.count("harms of a member", 1);
    refused(place, &command, "was altered after it was submitted", tally)?;
    fs::remove_dir_all(place.path("task")).unwrap();
    Ok(())
}
