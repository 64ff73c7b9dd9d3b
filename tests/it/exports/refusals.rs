//! Exports that cannot be written leave nothing.

use super::{export, plane};
use crate::release::small;
use rustix::process::{Pid, Signal, kill_process};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Runs an export that must fail with this code, say these words, and leave an empty folder.
pub(super) fn refused(release: &Path, format: &str, more: &[&str], code: i32, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let output = export(release, &folder.path().join("out"), format, more);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "wanted `{word}`: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{said}");
}

#[test]
fn wrong_names_are_refused_with_those_that_exist() {
    let release = small::release();
    refused(release, "nerf", &[], 2, &["nerf is no format", "eventnerf"]);
    refused(release, "colmap", &["--scene", "small/two"], 2, &["no scene `small/two`", "small/one"]);
    refused(release, "colmap", &[], 2, &["--trajectory", "base, slow"]);
    refused(release, "colmap", &["--trajectory", "fast"], 2, &["no trajectory `fast`"]);
    let base = ["--trajectory", "base", "--sensor", "left"];
    refused(release, "colmap", &base, 2, &["sensor `left`"]);
    refused(
        release,
        "colmap",
        &["--trajectory", "base", "--window", "5..6"],
        2,
        &["fewer than 2 of the poses"],
    );
    refused(
        release,
        "colmap",
        &["--trajectory", "base", "--window", "6..5"],
        2,
        &["wanted two whole numbers"],
    );
    refused(Path::new("/dev/null"), "colmap", &[], 1, &["found a file, wanted a release folder"]);
}

#[test]
fn unmet_needs_name_the_key_that_meets_them() {
    let release = small::release();
    let base = ["--trajectory", "base", "--lossy"];
    refused(release, "e-nerf", &base, 2, &["24 poses, wanted at least 101", "camera: {", "sampling.rate"]);
    refused(release, "event-3dgs", &base, 2, &["6 sharp frames, wanted at least 86", "sharp.every"]);
    refused(release, "eventnerf", &base, 2, &["24 poses"]);
}

#[test]
fn approximations_are_refused_with_their_figures() {
    refused(plane::centred().release(), "e-nerf", &["--trajectory", "base"], 2, &["0.5 px", "--lossy"]);
    let deblur = ["--trajectory", "base"];
    refused(plane::centred().release(), "deblur-e-nerf", &deblur, 2, &["sensor.circuit", "--lossy"]);
}

#[test]
fn an_existing_place_is_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("kept"), "mine").unwrap();
    let output = export(small::release(), &out, "colmap", &["--trajectory", "base"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("exists already"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(std::fs::read_to_string(out.join("kept")).unwrap(), "mine");
}

/// A killed export leaves its hidden folder at most, and the next one of the same place removes it.
#[test]
fn a_killed_export_is_cleared_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    signalled(&out, Signal::KILL);
    let hidden = hidden_folder(&out).expect("it was killed while it wrote");
    assert!(!out.exists());
    let output = export(plane::centred().release(), &out, "event-3dgs", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!hidden.exists() && out.join("export.json").exists());
}

/// Folders with the name of a hidden folder that no export made, or to which a person added something, stay.
#[test]
fn folders_of_others_with_hidden_names_stay() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    signalled(&out, Signal::KILL);
    let killed = hidden_folder(&out).expect("it was killed while it wrote");
    std::fs::write(killed.join("notes"), "mine").unwrap();
    let names = [".out.gs2e-export", ".out.gs2e-export-abcdefgh01234567", ".out.gs2e-export-notes"];
    for name in names {
        std::fs::create_dir_all(folder.path().join(name).join("tree")).unwrap();
        std::fs::write(folder.path().join(name).join("about"), "mine").unwrap();
        std::fs::write(folder.path().join(name).join("tree/thesis"), "mine").unwrap();
    }
    let output = export(plane::centred().release(), &out, "colmap", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for name in names {
        assert_eq!(std::fs::read_to_string(folder.path().join(name).join("tree/thesis")).unwrap(), "mine");
    }
    assert!(killed.join("notes").exists() && killed.join("tree/images").exists());
}

/// The hidden folder of an export to `out` that has begun.
fn hidden_folder(out: &Path) -> Option<PathBuf> {
    let prefix = format!(".{}.gs2e-export-", out.file_name()?.to_str()?);
    let entries = std::fs::read_dir(out.parent()?).ok()?.flatten();
    let mut begun = entries.filter(|e| e.file_name().to_string_lossy().starts_with(&prefix));
    begun.next().map(|entry| entry.path())
}

/// Waits until an export of the plane to `out` writes pictures, then sends it a signal.
fn signalled(out: &Path, signal: Signal) -> std::process::ExitStatus {
    let mut child = Command::new(env!("CARGO_BIN_EXE_gs2e"))
        .arg("export")
        .arg(plane::centred().release())
        .args(["--trajectory", "base", "--to", "event-3dgs", "--out"])
        .arg(out)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let writes = || hidden_folder(out).is_some_and(|hidden| hidden.join("tree/images").exists());
    while !writes() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it wrote pictures");
        std::thread::sleep(Duration::from_millis(1));
    }
    kill_process(Pid::from_child(&child), signal).unwrap();
    child.wait().unwrap()
}

#[test]
fn an_interrupted_export_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let status = signalled(&folder.path().join("out"), Signal::INT);
    assert_eq!(status.code(), Some(130));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// The hidden folder is cleared, so it must not be a way to a folder of others.
#[test]
fn a_link_in_the_hidden_place_is_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let others = folder.path().join("others");
    std::fs::create_dir_all(others.join("tree")).unwrap();
    std::fs::write(others.join("about"), "export of gs2e, not complete\n").unwrap();
    std::fs::write(others.join("tree/kept"), "mine").unwrap();
    let link = folder.path().join(".out.gs2e-export-abcdefgh01234567");
    std::os::unix::fs::symlink(&others, &link).unwrap();
    let output = export(small::release(), &folder.path().join("out"), "colmap", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(link.is_symlink());
    assert_eq!(std::fs::read_to_string(others.join("tree/kept")).unwrap(), "mine");
}

#[test]
fn absent_folders_are_made_for_an_export_and_not_for_a_refusal() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("absent/deep/out");
    let refused = export(small::release(), &out, "colmap", &["--trajectory", "none"]);
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let output = export(small::release(), &out, "colmap", &["--trajectory", "base"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(out.join("export.json").is_file());
}

/// Two exports of a release are equal, byte by byte.
#[test]
fn equal_exports_are_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let trees = ["a", "b"].map(|name| {
        let out = folder.path().join(name);
        let output = export(plane::half_pixel().release(), &out, "robust-e-nerf", &["--trajectory", "base"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        crate::release::forger::read(&out)
    });
    assert!(trees[0].len() > 10 && trees[0] == trees[1]);
}

/// A disk that is full in the middle: nothing is left.
#[test]
fn a_limit_on_the_length_of_files_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // 64 KiB: pictures fit, and the events do not.
    let script = format!(
        "ulimit -f 64; trap '' XFSZ; exec {} export {} --trajectory base --to robust-e-nerf --out out",
        env!("CARGO_BIN_EXE_gs2e"),
        plane::half_pixel().release().display()
    );
    let output = Command::new("bash").args(["-c", &script]).current_dir(folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("failed to write"), "{said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{said}");
}
