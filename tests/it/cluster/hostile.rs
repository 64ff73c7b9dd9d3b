//! A member of the shared store who alters plans, plants links, or writes plans that cannot be read. Paths
//! with characters that cannot be seen, and with bytes that are not UTF-8.

use super::fake::FakeSlurm;
use super::{SCENES, fake};
use crate::support::steps::recipe;
use crate::support::workspace::Workspace;
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// Exit code of a task whose results have no safe place.
const NO_PLACE: i32 = 73;

/// A job that waits in the queue, and the folder of its plan.
fn queued(options: &str) -> (FakeSlurm, PathBuf) {
    let fake = fake("queue");
    fake.submit(0, &format!("--detach {options}"));
    let plan = fake.plans().remove(0);
    (fake, plan)
}

fn empty_folder(fake: &FakeSlurm) -> PathBuf {
    let folder = fake.place.path("outside");
    fs::create_dir(&folder).unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Puts a link in the place of a file or folder, which is kept under another name.
fn replace_by_link(path: &Path, target: &Path) {
    fs::rename(path, path.with_extension("before")).unwrap();
    symlink(target, path).unwrap();
}

#[test]
fn a_task_refuses_a_shard_that_was_altered_and_runs_no_command_of_it() {
    let (fake, plan) = queued("--allow-commands");
    // A recipe whose training program leaves a trace.
    let mut evil = recipe("evil");
    let trace = fake.place.path("PWNED");
    evil["source"] = json!({ "nerfstudio": { "path": fake.place.path("capture") } });
    evil["reconstruct"] = json!({ "command": {
        "program": "touch", "arguments": [trace], "version": "1", "probe": [trace], "licence": "MIT",
        "min_psnr": 0, "scene": "scene.ply",
    } });
    fake.place.write("evil.yaml", evil.to_string());
    let shard = plan.join("shard-0001.json");
    let mut altered: Value = serde_json::from_slice(&fs::read(&shard).unwrap()).unwrap();
    let evil = json!({ "recipe": fake.place.path("evil.yaml"), "defaults": null });
    altered["recipes"].as_array_mut().unwrap().push(evil);
    fs::write(&shard, altered.to_string()).unwrap();
    assert_eq!(fake.run_task(101, 1), 1);
    let log = fs::read_to_string(plan.join("results/101_1/log")).unwrap();
    assert!(log.contains("shard-0001.json was altered after it was submitted"), "{log}");
    assert!(log.contains("help: nothing was built"), "{log}");
    assert!(!trace.exists());
    // The other tasks have their own files.
    assert_eq!(fake.run_task(101, 2), 0);
    // Nor does an altered plan help, although its digests are those of the altered files.
    let digest = gs2e_store::Digest::of_bytes(&fs::read(&shard).unwrap()).to_string();
    let mut altered: Value = serde_json::from_slice(&fs::read(plan.join("plan.json")).unwrap()).unwrap();
    altered["shards"][0] = json!(digest);
    fs::write(plan.join("plan.json"), altered.to_string()).unwrap();
    assert_eq!(fake.run_task(102, 1), 1);
    let log = fs::read_to_string(plan.join("results/102_1/log")).unwrap();
    assert!(log.contains("plan.json was altered after it was submitted"), "{log}");
    assert!(!trace.exists());
}

#[test]
fn results_go_to_no_folder_behind_a_link() {
    let (fake, plan) = queued("");
    let outside = empty_folder(&fake);
    // The folder of the results, of the plan, and of all plans.
    for folder in [plan.join("results"), plan.clone(), fake.place.path("shared/gs2e-plans")] {
        let inner = outside.join("results");
        let target = if folder.ends_with("results") { &inner } else { &outside };
        fs::create_dir_all(&inner).unwrap();
        replace_by_link(&folder, target);
        assert_eq!(fake.run_task(101, 1), NO_PLACE, "{}", folder.display());
        assert_eq!((names(&outside).len(), names(&inner).len()), (1, 0), "{}", folder.display());
        fs::remove_file(&folder).unwrap();
        fs::rename(folder.with_extension("before"), &folder).unwrap();
    }
    // A name that is taken, by a link to a folder, to a file, or to nothing.
    fs::write(outside.join("profile"), "theirs").unwrap();
    for target in ["", "profile", "nothing"] {
        let name = plan.join("results/101_1");
        symlink(outside.join(target), &name).unwrap();
        assert_eq!(fake.run_task(101, 1), NO_PLACE);
        fs::remove_file(&name).unwrap();
    }
    assert_eq!(fs::read_to_string(outside.join("profile")).unwrap(), "theirs");
    assert_eq!(names(&outside).len(), 2);
    // Without the links, it goes well, and a restart has a folder of its own.
    assert_eq!(fake.run_task(101, 1), 0);
    assert_eq!(fake.run_task(101, 1), NO_PLACE);
    assert_eq!(fs::read_to_string(plan.join("results/101_1/end")).unwrap(), "0\n");
}

#[test]
fn plans_are_written_to_no_folder_behind_a_link() {
    let fake = fake("queue");
    let outside = empty_folder(&fake);
    fake.place.ok("build --store m --shared-store shared recipes/s0.yaml");
    symlink(&outside, fake.place.path("shared/gs2e-plans")).unwrap();
    let ended = fake.submit(2, "--detach");
    assert!(ended.stderr.contains("gs2e-plans is a link"), "{}", ended.stderr);
    assert_eq!(names(&outside), Vec::<String>::new());
    fs::remove_file(fake.place.path("shared/gs2e-plans")).unwrap();
    // Links in the places of the files are replaced, and their targets stay.
    fake.submit(0, "--detach");
    let plan = fake.plans().remove(0);
    fs::write(outside.join("profile"), "theirs").unwrap();
    for name in ["task.sh", "shard-0001.json", "plan.json"] {
        replace_by_link(&plan.join(name), &outside.join("profile"));
    }
    fake.set("queue", "");
    fake.submit(0, "--detach");
    assert_eq!(fs::read_to_string(outside.join("profile")).unwrap(), "theirs");
    assert!(fs::symlink_metadata(plan.join("plan.json")).unwrap().is_file());
    assert_eq!(fake.run_task(102, 1), 0);
}

#[test]
fn a_plan_that_cannot_be_read_stops_nobody() {
    let (fake, plan) = queued("");
    let sound = fs::read(plan.join("plan.json")).unwrap();
    let other = |name: &str| fake.place.path(&format!("shared/gs2e-plans/{name}"));
    for name in ["0123456789ab", "1123456789ab", "2123456789ab", "3123456789ab", "4123456789ab"] {
        fs::create_dir(other(name)).unwrap();
    }
    fs::write(other("0123456789ab/plan.json"), &sound[..sound.len() / 2]).unwrap();
    fs::write(other("1123456789ab/plan.json"), r#"{"format":9}"#).unwrap();
    fs::write(other("2123456789ab/plan.json"), &sound).unwrap();
    mknodat(CWD, other("3123456789ab/plan.json"), FileType::Fifo, Mode::RUSR, 0).unwrap();
    symlink("/dev/zero", other("4123456789ab/plan.json")).unwrap();
    symlink(plan.parent().unwrap(), other("5123456789ab")).unwrap();
    // Not a plan by its name.
    fake.place.write("shared/gs2e-plans/notes.txt", "mine");
    // The results of a task may be anything, too.
    mknodat(CWD, plan.join("results/101_1"), FileType::Fifo, Mode::RUSR, 0).unwrap();
    fs::create_dir(plan.join("results/101_2")).unwrap();
    symlink("/dev/zero", plan.join("results/101_2/steps.jsonl")).unwrap();
    let warned = |said: &str| {
        for wanted in ["EOF", "it has format 9, wanted 2", "was altered", "a FIFO, not", "a link, not"] {
            assert!(said.contains(wanted), "{wanted}\n{said}");
        }
        assert_eq!(said.matches("its tasks are not known").count(), 6, "{said}");
        assert!(!said.contains("notes.txt"), "{said}");
    };
    let ended = fake.ends(0, "status --shared-store shared");
    assert_eq!(ended.stdout.matches("queued").count() as u64, SCENES, "{}", ended.stdout);
    warned(&ended.stderr);
    let ended = fake.submit(0, "--detach");
    assert_eq!(fake.jobs(), 1, "{}", ended.stderr);
    warned(&ended.stderr);
    let ended = fake.ends(0, "cancel --shared-store shared");
    assert!(ended.stderr.contains("cancelled 3 tasks"), "{}", ended.stderr);
    warned(&ended.stderr);
}

/// Recipes in a folder of any bytes, and a shared store with characters that cannot be seen.
#[test]
fn paths_of_any_bytes_are_submitted_and_built() {
    let place = Workspace::new();
    let recipes = place.path("").join(OsStr::from_bytes(b"re\xff 'c"));
    fs::create_dir(&recipes).unwrap();
    fs::write(recipes.join("a.yaml"), recipe("a").to_string()).unwrap();
    let fake = FakeSlurm::new(place, "run");
    let shared = fake.place.path("sha\u{ad}red\n$(touch x)\u{202e}");
    let submit = |options: &str| {
        let mut command =
            fake.command(&format!("submit --to slurm --cpus 1 --mem 1GB {options} --shared-store"));
        let ended = command.arg(&shared).arg(&recipes).output().unwrap();
        let said = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(0), "{said}");
        (String::from_utf8(ended.stdout).unwrap(), said)
    };
    let (script, _) = submit("--dry-run");
    assert!(script.contains("shared=") && !script.contains('\u{ad}'), "{script}");
    assert!(!shared.exists());
    let (_, said) = submit("");
    assert!(said.contains("all scenes are done"), "{said}");
    assert!(!fake.place.path("x").exists());
}
