//! The release tree: its contents, its foreign readers, its reproducibility, and the conditions of
//! a refusal.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

pub(crate) mod forger;
pub(crate) mod small;
pub(crate) mod unfindable;

use crate::support::absent::not_run;
use small::{RECIPE, copy, gs2e, read, release, said};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn the_tree_is_that_of_the_contract() {
    let files = read(release());
    let mut wanted: Vec<String> = [
        "B3SUMS",
        "DATASHEET.md",
        "LICENSES/Apache-2.0.txt",
        "LICENSES/CC0-1.0.txt",
        "LICENSES/MIT.txt",
        "README.md",
        "REUSE.toml",
        "SHA256SUMS",
        "croissant.json",
        "gs2e.py",
        "index.parquet",
        "manifest.json",
        "report.html",
        "small/one/scene.json",
    ]
    .map(str::to_owned)
    .to_vec();
    for (trajectory, poses) in [("base", 24), ("slow", 36)] {
        let names = [
            "checks.json",
            "checks/event_frame.png",
            "checks/motion.png",
            "events.h5",
            "poses.txt",
            "speed.json",
            "timestamps_us.txt",
            "trajectory.png",
            "trajectory.svg",
            "transforms.json",
        ];
        wanted.extend(names.iter().map(|name| format!("small/one/{trajectory}/{name}")));
        // Exposures of 15 frames are around pose 8 and every 15th from there; the frames in their
        // middle are kept.
        let exposed: Vec<usize> = (8..poses - 8).step_by(15).collect();
        let sharp: BTreeSet<usize> = (0..poses).step_by(4).chain(exposed.clone()).collect();
        let at = |kind: &str, j: usize, end: &str| format!("small/one/{trajectory}/{kind}/{j:06}{end}");
        wanted.extend(sharp.into_iter().map(|j| at("sharp", j, ".png")));
        wanted.extend(exposed.into_iter().map(|j| at("blur", j, ".png")));
        let measured = (0..poses).step_by(12);
        wanted.extend(measured.flat_map(|j| ["depth", "flow"].map(|kind| at(kind, j, ".npy"))));
    }
    wanted.sort();
    assert_eq!(files.keys().cloned().collect::<Vec<_>>(), wanted);
}

#[test]
fn coreutils_accept_the_sums() {
    let mut check = Command::new("sha256sum");
    check.args(["--strict", "--quiet", "-c", "SHA256SUMS"]).current_dir(release());
    let Ok(output) = check.output() else {
        return not_run("sha256sum is absent");
    };
    assert!(output.status.success(), "{}", said(&output));
}

#[test]
fn b3sum_accepts_the_sums() {
    let mut check = Command::new("b3sum");
    check.args(["--quiet", "--check", "B3SUMS"]).current_dir(release());
    let Ok(output) = check.output() else {
        return not_run("b3sum is absent");
    };
    assert!(output.status.success(), "{}", said(&output));
    // Every file is listed except the two lists of sums.
    let lines = fs::read_to_string(release().join("B3SUMS")).unwrap().lines().count();
    assert_eq!(lines + 2, read(release()).len());
}

#[test]
fn nothing_in_the_tree_says_where_or_when_it_was_made() {
    let here = release().parent().unwrap().to_str().unwrap().to_owned();
    for (path, bytes) in read(release()) {
        let holds = |text: &str| bytes.windows(text.len()).any(|w| w == text.as_bytes());
        assert!(!holds(&here), "{path} holds {here}");
    }
}

#[test]
fn two_folders_and_numbers_of_threads_give_one_tree() {
    let folder = tempfile::tempdir().unwrap();
    // A recipe of the same meaning: another order, another spelling, another file name.
    let (head, sensor) = RECIPE.split_once("sensor:").unwrap();
    let (version, head) = head.split_once('\n').unwrap();
    let (sensor, outputs) = sensor.split_once("outputs:").unwrap();
    let recipe = format!("sensor:{sensor}{head}outputs:{outputs}{version}\n");
    fs::create_dir(folder.path().join("elsewhere")).unwrap();
    fs::write(folder.path().join("elsewhere/other.yaml"), recipe).unwrap();
    let output = gs2e(folder.path(), &["release", "-j", "1", "--to", "a/b/tree", "elsewhere/other.yaml"]);
    assert!(output.status.success(), "{}", said(&output));
    let (found, wanted) = (read(&folder.path().join("a/b/tree")), read(release()));
    assert_eq!(found.keys().collect::<Vec<_>>(), wanted.keys().collect::<Vec<_>>());
    for (path, bytes) in found {
        assert!(bytes == wanted[&path], "{path} differs");
    }
}

fn released(folder: &Path, more: &[&str]) -> (Option<i32>, String) {
    let output = gs2e(folder, &[&["release", "--to", "out", "small.yaml"], more].concat());
    (output.status.code(), said(&output))
}

#[test]
fn a_foreign_folder_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = |path: &str| folder.path().join(path);
    fs::write(at("small.yaml"), RECIPE).unwrap();
    fs::create_dir(at("out")).unwrap();
    fs::write(at("out/thesis.tex"), "the only copy").unwrap();
    let (code, text) = released(folder.path(), &[]);
    assert_eq!(code, Some(2), "{text}");
    assert_eq!(fs::read_to_string(at("out/thesis.tex")).unwrap(), "the only copy");
    // An empty folder may be filled. A release is updated, but not if a foreign file is in it.
    fs::remove_file(at("out/thesis.tex")).unwrap();
    assert_eq!(released(folder.path(), &[]).0, Some(0));
    assert_eq!(released(folder.path(), &[]).0, Some(0));
    fs::write(at("out/small/notes.txt"), "mine").unwrap();
    let (code, text) = released(folder.path(), &[]);
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("small/notes.txt"), "{text}");
    assert_eq!(released(folder.path(), &["--replace"]).0, Some(0));
    assert!(!at("out/small/notes.txt").exists());
    assert_eq!(read(&at("out")), read(release()));
    let names =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let kept: Vec<String> = names.filter(|name| name.starts_with("out.replaced-")).collect();
    assert_eq!(kept.len(), 1, "{kept:?}");
    assert_eq!(fs::read_to_string(at(&kept[0]).join("small/notes.txt")).unwrap(), "mine");
}

#[test]
fn a_failed_check_stops_a_release_until_it_is_waived() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = |checks: &str| format!("{RECIPE}checks: {checks}\n");
    fs::write(folder.path().join("small.yaml"), recipe("{ event_rate: { max: 0.001 } }")).unwrap();
    let (code, text) = released(folder.path(), &[]);
    assert_eq!(code, Some(3), "{text}");
    assert!(!folder.path().join("out").exists());
    let waived = "{ event_rate: { max: 0.001 }, waive: [{ check: event_rate, because: a test }] }";
    fs::write(folder.path().join("small.yaml"), recipe(waived)).unwrap();
    let (code, text) = released(folder.path(), &[]);
    assert_eq!(code, Some(0), "{text}");
    let card = fs::read_to_string(folder.path().join("out/README.md")).unwrap();
    assert!(card.contains("accepted: a test"), "{card}");
}

#[test]
fn a_copy_of_a_release_is_a_release() {
    let output = gs2e(copy().path(), &["audit", "."]);
    assert!(output.status.success(), "{}", said(&output));
}
