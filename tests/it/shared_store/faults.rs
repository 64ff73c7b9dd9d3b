//! A shared folder that cannot be used, a full disk on one machine, and clocks that differ.

use super::{count, place, releases_equal, start, states};
use crate::support::absent::not_run;
use crate::support::workspace::Workspace;
use std::fs::{self, File, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, SystemTime};

/// User and group without rights.
const NOBODY: [&str; 4] = ["--reuid=65534", "--regid=65534", "--clear-groups", "--inh-caps=-all"];

#[test]
fn a_folder_without_permission_is_named() {
    let place = place();
    place.ok("build --store m --shared-store shared recipes/lab/s0.yaml");
    let program = env!("CARGO_BIN_EXE_gs2e");
    let as_nobody =
        |args: &[&str]| Command::new("setpriv").args(NOBODY).args(args).current_dir(place.path("")).output();
    fs::set_permissions(place.path(""), Permissions::from_mode(0o777)).unwrap();
    if !as_nobody(&[program, "--version"]).is_ok_and(|output| output.status.success()) {
        return not_run("no other user can run the program");
    }
    let build = [program, "build", "--store", "n", "--shared-store", "shared", "recipes/lab/s0.yaml"];
    let ended = as_nobody(&build).unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("shared/gs2e-tmp") && said.contains("Permission denied"), "{said}");
    assert!(said.contains("help: the users of a shared store need one group"), "{said}");
    // A reader needs no permission to write.
    let ended = as_nobody(&[program, "status", "--shared-store", "shared", "recipes/lab/s0.yaml"]).unwrap();
    let said = String::from_utf8_lossy(&ended.stdout).into_owned();
    assert!(ended.status.success() && said.starts_with("done  s0  "), "{said}");
}

/// Builds with a store on a file system of its own, which is too small.
const SMALL: &str = "mkdir full && mount -t tmpfs -o size=400k none full && exec \"$0\" build -j 1 --json \
                     --store full/store --shared-store shared";

#[test]
fn a_full_disk_on_one_machine_costs_the_others_nothing() {
    let can = Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).output();
    if !can.is_ok_and(|output| output.status.success()) {
        return not_run("no file system can be mounted");
    }
    let place = place();
    let script = ["-rm", "sh", "-c", SMALL, env!("CARGO_BIN_EXE_gs2e")];
    let ended = Command::new("unshare").args(script).current_dir(place.path("")).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(1), "{said}");
    // The step or the index of the store meets it first.
    assert!(said.contains("no space"), "{said}");
    let text = String::from_utf8(ended.stdout).unwrap();
    let made = text.lines().filter(|line| line.contains(r#""state":"made""#)).count();
    assert!(made > 0, "{said}");
    let next = states(start(&place, "m2", ""));
    assert!(count(&next, "adopted") >= made, "{made} of {next:?}");
    releases_equal(&place);
}

/// Sets the time of everything in a folder, and of the folder.
pub(super) fn set_times_below(folder: &Path, to: SystemTime) {
    for entry in walkdir::WalkDir::new(folder).contents_first(true) {
        let path = entry.unwrap().into_path();
        if path.is_file() {
            fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        }
        File::open(&path).unwrap().set_modified(to).unwrap();
    }
}

/// Sets the time of every file of the shared folder.
fn set_times(place: &Workspace, to: SystemTime) {
    for folder in ["ac", "cas"] {
        set_times_below(&place.path("shared").join(folder), to);
    }
}

#[test]
fn a_shared_folder_is_cleaned_by_age() {
    const GC: &str = "gc --shared-store shared --older-than 1d";
    const DAY: Duration = Duration::from_secs(86_400);
    let place = place();
    let made = count(&states(start(&place, "m1", "")), "made");
    let kept = place.ok(GC).stderr;
    assert!(
        kept.contains("moved 0 records and 0 blobs") && kept.contains(&format!("kept {made} records")),
        "{kept}"
    );
    set_times(&place, SystemTime::now() - 2 * DAY);
    // One scene is used today, by a machine that has it already and by another one.
    place.ok("build --store m1 --shared-store shared --recheck 0 recipes/lab/s0.yaml");
    place.ok("build --store m2 --shared-store shared recipes/lab/s1.yaml");
    let planned = place.ok(&format!("{GC} --dry-run")).stderr;
    let swept = place.ok(&format!("{GC} --json"));
    assert_eq!(planned.replace("would move", "moved").replace("would delete", "deleted"), swept.stderr);
    let swept: serde_json::Value = serde_json::from_str(&swept.stdout).unwrap();
    assert!(swept["records"].as_u64().unwrap() > 0 && swept["dry_run"] == false, "{swept}");
    // What was used is adopted, and the rest is made.
    for (scene, is_there) in [("s0", true), ("s1", true), ("s2", false)] {
        let next = states(start(&place, &format!("n-{scene}"), &format!("recipes/lab/{scene}.yaml")));
        assert_eq!(count(&next, "made") == 0, is_there, "{scene}: {next:?}");
    }
    // The other scenes were collected too.
    states(start(&place, "n-all", ""));
    releases_equal(&place);
}

#[test]
fn plans_go_when_no_task_has_written_for_long() {
    const DAY: Duration = Duration::from_secs(86_400);
    let place = place();
    states(start(&place, "m1", ""));
    for plan in ["aaaaaaaaaaaa", "bbbbbbbbbbbb"] {
        place.write(&format!("shared/gs2e-plans/{plan}/plan.json"), "{}");
        place.write(&format!("shared/gs2e-plans/{plan}/results/7_1/steps.jsonl"), "{}");
        set_times_below(&place.path(&format!("shared/gs2e-plans/{plan}")), SystemTime::now() - 2 * DAY);
    }
    // A task of an old plan wrote a line today.
    File::open(place.path("shared/gs2e-plans/bbbbbbbbbbbb/results/7_1/steps.jsonl"))
        .unwrap()
        .set_modified(SystemTime::now())
        .unwrap();
    let swept = place.ok("gc --shared-store shared --older-than 1d").stderr;
    assert!(swept.contains("deleted 2 files of the trash, of old plans"), "{swept}");
    assert!(
        !place.path("shared/gs2e-plans/aaaaaaaaaaaa").exists()
            && place.path("shared/gs2e-plans/bbbbbbbbbbbb").exists()
    );
}

#[test]
fn clocks_that_differ_are_told_and_delete_nothing() {
    let place = place();
    let made = count(&states(start(&place, "m1", "")), "made");
    let hour = Duration::from_secs(3600);
    // As if the machine that wrote them were an hour ahead.
    set_times(&place, SystemTime::now() + hour);
    let ended = place.ok("gc --shared-store shared --older-than 1h");
    assert!(ended.stderr.contains("warning: the clocks of machines differ by 3"), "{}", ended.stderr);
    assert!(ended.stderr.contains("moved 0 records"), "{}", ended.stderr);
    // An hour behind, and another hour of age: still within the margin.
    set_times(&place, SystemTime::now() - 2 * hour);
    assert!(place.ok("gc --shared-store shared --older-than 1h").stderr.contains("moved 0 records"));
    set_times(&place, SystemTime::now() + 3 * hour);
    let ended = place.gs2e("gc --shared-store shared --older-than 1h");
    assert!(ended.code == 1 && ended.stderr.contains("set the clocks of the machines"), "{}", ended.stderr);
    // Builds do not care.
    let next = states(start(&place, "m2", ""));
    assert_eq!(count(&next, "adopted"), made);
}

#[test]
fn ages_and_folders_that_make_no_sense_are_refused() {
    let place = place();
    let refused = |args: &str, wanted: &str| {
        let ended = place.gs2e(&format!("gc {args}"));
        assert!(ended.code == 2 && ended.stderr.contains(wanted), "{args}: {} {}", ended.code, ended.stderr);
    };
    refused("--shared-store shared", "--older-than");
    refused("--older-than 1d", "--shared-store");
    refused("--shared-store shared --older-than 1d", "there is no shared store in shared");
    place.write("shared/VERSION", "gs2e shared store, format 1\n");
    refused("--shared-store shared --older-than 5m", "wanted 1h or more");
    refused("--shared-store shared --older-than 1d recipes", "cannot be used with");
    place.write("shared/VERSION", "gs2e shared store, format 99\n");
    refused("--shared-store shared --older-than 1d", "has format 99");
}
