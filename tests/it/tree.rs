//! The contents of a release's files, checked by arithmetic written out here and by independent
//! readers.

use crate::release::small::{read, release};
use crate::support::absent::absent;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::process::Command;

const BASE: &str = "small/one/base";

fn text(name: &str) -> String {
    fs::read_to_string(release().join(BASE).join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn json(name: &str) -> Value {
    serde_json::from_str(&text(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The poses by stamp: tx ty tz qx qy qz qw.
fn poses() -> BTreeMap<i64, [f64; 7]> {
    let pose = |line: &str| {
        let (stamp, rest) = line.split_once(' ').expect("eight fields");
        let numbers: Vec<f64> = rest.split(' ').map(|field| field.parse().expect("numbers")).collect();
        (stamp.parse().expect("an integer"), numbers.try_into().expect("eight fields"))
    };
    text("poses.txt").lines().map(pose).collect()
}

/// Every file except the list itself is listed, in the form that coreutils read, sorted by path.
#[test]
fn sums_are_those_of_every_file() {
    let mut files = read(release());
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
    let stamps: Vec<i64> =
        text("timestamps_us.txt").lines().map(|line| line.parse().expect("integers")).collect();
    // round(j * 1e6 / 2400), half up: three poses every 1,250 us, the second and third at 416.67
    // and 833.33.
    let wanted: Vec<i64> = (0..8).flat_map(|k| [0, 417, 833].map(|us| 1250 * k + us)).collect();
    assert_eq!(stamps, wanted);
    let poses = poses();
    assert_eq!(poses.keys().copied().collect::<Vec<_>>(), wanted);
    for [.., x, y, z, w] in poses.into_values() {
        // 17 digits are exact; the norm's own arithmetic leaves a few units in the last place.
        assert!((x * x + y * y + z * z + w * w - 1.0).abs() < 1e-14 && w >= 0.0, "{x} {y} {z} {w}");
    }
}

/// `transforms.json` and `poses.txt` are one path in two conventions: camera axes y and z are
/// reversed.
#[test]
fn transforms_agree_with_poses() {
    let (transforms, poses) = (json("transforms.json"), poses());
    let frames = transforms["frames"].as_array().expect("a list");
    assert_eq!(frames.len(), poses.len().div_ceil(4), "every fourth pose has a picture");
    for frame in frames {
        let [tx, ty, tz, x, y, z, w] = poses[&frame["t_us"].as_i64().expect("a stamp")];
        // The third column of a rotation, computed from its quaternion, is the optical axis.
        // OpenGL's points backwards.
        let axis = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
        for (row, (centre, axis)) in [tx, ty, tz].into_iter().zip(axis).enumerate() {
            let entry = |column: usize| frame["transform_matrix"][row][column].as_f64().expect("a number");
            // Both are written with 17 digits and differ by one conversion.
            assert!((entry(3) - centre).abs() < 1e-14 && (entry(2) + axis).abs() < 1e-14, "{frame}");
        }
        let picture = frame["file_path"].as_str();
        assert!(picture.is_some_and(|name| release().join(BASE).join(name).is_file()), "{frame}");
    }
}

/// Readers of `transforms.json` open a picture for each frame, so a thinned trajectory lists only
/// frames with a picture.
#[test]
fn thinned_pictures_thin_the_transforms_alone() {
    let place = Workspace::new();
    place.write("thin.yaml", format!("{TINY}sharp: {{ every: 5 }}\n"));
    place.ok("release --to out thin.yaml");
    let base = place.path("out/tiny/base");
    let text = fs::read_to_string(base.join("transforms.json")).expect("it is there");
    let transforms: Value = serde_json::from_str(&text).expect("it is JSON");
    let frames = transforms["frames"].as_array().expect("a list");
    let names: Vec<&str> = frames.iter().filter_map(|frame| frame["file_path"].as_str()).collect();
    assert_eq!(names, ["sharp/000000.png", "sharp/000005.png", "sharp/000010.png"]);
    assert!(names.iter().all(|name| base.join(name).is_file()));
    let poses = fs::read_to_string(base.join("poses.txt")).expect("it is there");
    assert_eq!(poses.lines().count(), 12);
}

#[test]
fn findings_have_the_records_form() {
    let findings = json("checks.json");
    let findings = findings.as_array().expect("a list");
    let names: BTreeSet<&str> = findings.iter().filter_map(|finding| finding["check"].as_str()).collect();
    for check in ["stamps", "event_rate", "polarity", "pose_continuity", "event_frame"] {
        assert!(names.contains(check), "{check} is not among {names:?}");
    }
    for finding in findings {
        let mut fields: BTreeSet<&str> =
            finding.as_object().expect("an object").keys().map(String::as_str).collect();
        // A pass may state its power.
        fields.remove("detects");
        let record = ["because", "check", "limit", "measured", "subject", "unit", "verdict"];
        assert_eq!(fields, record.into(), "{finding}");
        assert_ne!(finding["verdict"], "fail", "{finding}");
    }
}

/// Reads the events with h5py and NumPy. If they are absent, a message goes to stderr.
#[test]
fn h5py_reads_the_written_events() {
    let python =
        |program: &str| Command::new("python3").args(["-c", program]).current_dir(release()).output();
    if !python("import h5py, numpy").is_ok_and(|output| output.status.success()) {
        return absent("REQUIRE_READERS", "python3 with h5py and numpy is absent");
    }
    let output = python(READ_BACK).expect("it ran before");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Reads a stream as users do: the layout of DSEC, its millisecond index, its order.
const READ_BACK: &str = r#"
import h5py, numpy as np
f = h5py.File("small/one/base/events.h5")
t, x, y, p = (f["events"][k][:] for k in "txyp")
assert (t.dtype, x.dtype, y.dtype, p.dtype) == (np.uint32, np.uint16, np.uint16, np.uint8)
assert len(t) == len(x) == len(y) == len(p) > 0, len(t)
assert x.max() < 64 and y.max() < 48 and p.max() <= 1
order = np.lexsort((p, x, y, t))
assert (order == np.arange(len(t))).all(), "sorted by t, y, x, p"
index = f["ms_to_idx"][:]
stamps = np.loadtxt("small/one/base/timestamps_us.txt", dtype=np.int64)
end = max(int(t[-1]), int(stamps[-1]))
assert index.dtype == np.uint64 and len(index) == end // 1000 + 2, (len(index), end)
assert (index == np.searchsorted(t, 1000 * np.arange(len(index)))).all()
assert f["t_offset"][()] == 0
assert (f.attrs["width"], f.attrs["height"]) == (64, 48)
"#;
