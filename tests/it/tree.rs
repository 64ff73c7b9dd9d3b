//! The release tree, file by file, judged by readers that are not ours where there are any.

use crate::support::workspace::{Workspace, tree};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

const POSES: usize = 12;

fn released() -> Workspace {
    let place = Workspace::with_tiny();
    place.ok("release --to out tiny.yaml");
    place
}

fn text(place: &Workspace, name: &str) -> String {
    fs::read_to_string(place.path("out").join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

#[test]
fn the_tree_holds_what_was_asked_for_and_nothing_else() {
    let place = released();
    let names: BTreeSet<String> = tree(&place.path("out")).into_keys().collect();
    let mut wanted: BTreeSet<String> =
        ["README.md", "SHA256SUMS", "manifest.json", "LICENSES/CC0-1.0.txt", "tiny/scene.json"]
            .map(str::to_owned)
            .into();
    let base = [
        "events.h5",
        "poses.txt",
        "transforms.json",
        "speed.json",
        "timestamps_us.txt",
        "checks.json",
        "trajectory.svg",
    ];
    wanted.extend(base.map(|name| format!("tiny/base/{name}")));
    wanted.extend((0..POSES).map(|i| format!("tiny/base/sharp/{i:06}.png")));
    let missing: Vec<_> = wanted.difference(&names).collect();
    assert!(missing.is_empty(), "missing {missing:?}");
    let images = names.iter().filter(|name| name.ends_with(".png")).count();
    assert_eq!(images, POSES);
    assert!(!names.iter().any(|name| name.contains("blur/") || name.contains("depth/")), "not asked for");
    assert!(!place.path("out.partial").exists());
}

/// Every file but the list itself, in the form that coreutils read, sorted by path.
#[test]
fn sums_are_those_of_every_file() {
    let place = released();
    let mut files = tree(&place.path("out"));
    let listed = String::from_utf8(files.remove("SHA256SUMS").expect("it is there")).expect("it is text");
    let mut wanted = String::new();
    for (name, bytes) in &files {
        for byte in Sha256::digest(bytes) {
            write!(wanted, "{byte:02x}").expect("memory can be written");
        }
        writeln!(wanted, "  {name}").expect("memory can be written");
    }
    assert_eq!(listed, wanted);
}

#[test]
fn poses_are_unit_quaternions_at_the_recipes_stamps() {
    let place = released();
    let stamps: Vec<i64> =
        text(&place, "tiny/base/timestamps_us.txt").lines().map(|l| l.parse().expect("integers")).collect();
    // round(j * 1e6 / 2400), half up, written out by hand.
    assert_eq!(stamps, [0, 417, 833, 1250, 1667, 2083, 2500, 2917, 3333, 3750, 4167, 4583]);
    let poses = text(&place, "tiny/base/poses.txt");
    assert_eq!(poses.lines().count(), POSES);
    for (line, stamp) in poses.lines().zip(&stamps) {
        let fields: Vec<f64> = line.split(' ').map(|field| field.parse().expect("numbers")).collect();
        let [t, _, _, _, x, y, z, w] = fields[..] else { panic!("eight fields: {line}") };
        assert_eq!(t.to_string(), stamp.to_string());
        // 17 digits are exact; the norm's own arithmetic leaves a few units in the last place.
        assert!((x * x + y * y + z * z + w * w - 1.0).abs() < 1e-14 && w >= 0.0, "{line}");
    }
}

/// `transforms.json` and `poses.txt` are one path in two conventions: camera axes y and z turned.
#[test]
fn transforms_agree_with_poses() {
    let place = released();
    let transforms: Value = serde_json::from_str(&text(&place, "tiny/base/transforms.json")).expect("JSON");
    let frames = transforms["frames"].as_array().expect("a list");
    assert_eq!(frames.len(), POSES);
    let poses = text(&place, "tiny/base/poses.txt");
    for (frame, line) in frames.iter().zip(poses.lines()) {
        let p: Vec<f64> = line.split(' ').map(|field| field.parse().expect("numbers")).collect();
        let entry =
            |row: usize, column: usize| frame["transform_matrix"][row][column].as_f64().expect("a number");
        let [x, y, z, w] = [p[4], p[5], p[6], p[7]];
        // The third column of a rotation, written from its quaternion, is the optical axis; OpenGL's looks back.
        let axis = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
        for row in 0..3 {
            assert!((entry(row, 3) - p[1 + row]).abs() < 1e-12, "{line}");
            assert!((entry(row, 2) + axis[row]).abs() < 1e-12, "{line}");
        }
        assert!(place.path("out/tiny/base").join(frame["file_path"].as_str().expect("a path")).is_file());
    }
}

#[test]
fn findings_have_the_records_form() {
    let place = released();
    let findings: Vec<Value> = serde_json::from_str(&text(&place, "tiny/base/checks.json")).expect("a list");
    let names: BTreeSet<&str> = findings.iter().filter_map(|finding| finding["check"].as_str()).collect();
    for check in ["stamps", "event_rate", "polarity", "pose_continuity", "event_frame"] {
        assert!(names.contains(check), "{check} is not among {names:?}");
    }
    for finding in &findings {
        let fields: BTreeSet<&str> =
            finding.as_object().expect("an object").keys().map(String::as_str).collect();
        let record = ["because", "check", "limit", "measured", "subject", "unit", "verdict"];
        assert_eq!(fields, record.into(), "{finding}");
        assert_ne!(finding["verdict"], "fail", "{finding}");
    }
}

/// h5py, numpy and coreutils on our files; said on stderr where they are absent.
#[test]
fn other_programs_read_what_we_wrote() {
    let place = released();
    let out = place.path("out");
    if let Some(python) = available("python3", &["-c", "import h5py, numpy"]) {
        run(Command::new(python).args(["-c", READ_BACK]).current_dir(&out));
    }
    if let Some(sums) = available("sha256sum", &["--version"]) {
        run(Command::new(sums).args(["--strict", "--quiet", "-c", "SHA256SUMS"]).current_dir(&out));
    }
}

/// Reads a stream as its users do: the layout of DSEC, its millisecond index, its order.
const READ_BACK: &str = r#"
import h5py, numpy as np
f = h5py.File("tiny/base/events.h5")
t, x, y, p = (f["events"][k][:] for k in "txyp")
assert (t.dtype, x.dtype, y.dtype, p.dtype) == (np.uint32, np.uint16, np.uint16, np.uint8)
assert len(t) == len(x) == len(y) == len(p) > 0, len(t)
assert x.max() < 64 and y.max() < 48 and p.max() <= 1
order = np.lexsort((p, x, y, t))
assert (order == np.arange(len(t))).all(), "sorted by t, y, x, p"
index = f["ms_to_idx"][:]
stamps = np.loadtxt("tiny/base/timestamps_us.txt", dtype=np.int64)
end = max(int(t[-1]), int(stamps[-1]))
assert index.dtype == np.uint64 and len(index) == end // 1000 + 2, (len(index), end)
assert (index == np.searchsorted(t, 1000 * np.arange(len(index)))).all()
assert f["t_offset"][()] == 0
assert (f.attrs["width"], f.attrs["height"]) == (64, 48)
"#;

fn available<'a>(program: &'a str, probe: &[&str]) -> Option<&'a str> {
    let found = Command::new(program).args(probe).output().is_ok_and(|output| output.status.success());
    if !found {
        let note = format!("not run: {program} {} is absent\n", probe.last().unwrap_or(&""));
        drop(std::io::stderr().write_all(note.as_bytes()));
    }
    found.then_some(program)
}

fn run(command: &mut Command) {
    let output = command.output().expect("it starts");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {told}", Path::new(command.get_program()).display());
}
