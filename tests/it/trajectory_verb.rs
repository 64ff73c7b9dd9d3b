//! `gs2e trajectory`: one trajectory on the user's own capture, through the binary.

mod paths;

use crate::support::given::{GIVEN, sound};
use crate::support::shared;
use crate::support::steps::steps;
use crate::support::workspace::{RunOutcome, Workspace, tree};
use glam::{DMat3, DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::units::Hertz;
use gs2e_source::{Capture, colmap, nerfstudio};
use gs2e_trajectory::refine::{RefinePath, refine_views};
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{NamedPose, PoseTiming, Trajectory, TrajectoryBuild, picture};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;

/// A file of trajectories, without scene and source.
const MINE: &str = "\
version: 1
camera: { width: 64, height: 48 }
sampling: { rate: 1000 }
trajectories:
  - { name: base, refine: { window: 1, frames: 25 }, speed: { function: \"1 + t\" } }
  - { name: strict, refine: { gaps: refuse } }
";

/// The trajectory `base` of [`MINE`], made by the library.
fn base(views: &[(String, Se3)]) -> TrajectoryBuild {
    let named: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    let speed = SpeedChoice::Function(SpeedExpression::parse("1 + t").unwrap());
    let timing = PoseTiming { speed: &speed, rate: Hertz("1000".parse().unwrap()), law: SummationRule::Sum };
    refine_views(
        &named,
        &RefinePath { window: 1, count: PoseCount::Frames(25), ..RefinePath::default() },
        timing,
    )
    .unwrap()
}

fn views(capture: &Capture) -> Vec<(String, Se3)> {
    capture.views.iter().map(|view| (view.name.clone(), view.world_from_camera)).collect()
}

/// The poses in a file.
fn poses(bytes: &[u8]) -> Trajectory {
    Trajectory::read_poses(bytes).unwrap()
}

/// Eight views of the origin from an uneven arc, camera to world. If `gap`, there is a gap after
/// the fourth.
fn planted(gap: bool) -> Vec<(String, Se3)> {
    let view = |i: u32| {
        let at = 0.1 * f64::from(i) + 0.03 * f64::from(i % 3) + if gap && i > 3 { 3.0 } else { 0.0 };
        let centre = DVec3::new(4.0 * at.cos(), 4.0 * at.sin(), 0.2 * f64::from(i));
        let forward = -centre.normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let axes = DMat3::from_cols(right, forward.cross(right), forward);
        let rotation = DQuat::from_mat3(&axes).normalize();
        (format!("v{i}.jpg"), Se3 { rotation, translation: centre })
    };
    (0..8).map(view).collect()
}

/// `cameras.txt` and `images.txt` of a COLMAP model (its `doc/format.rst`): world to camera, w
/// first.
fn colmap_text(views: &[(String, Se3)]) -> [String; 2] {
    let mut images = String::new();
    for (i, (name, pose)) in views.iter().enumerate() {
        let rotation = pose.rotation.conjugate();
        let (q, t) = (rotation, -(rotation * pose.translation));
        writeln!(images, "{i} {} {} {} {} {} {} {} 1 {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z).unwrap();
    }
    ["1 PINHOLE 640 480 500 500 320 240\n".to_owned(), images]
}

/// `cameras.json` of a 3DGS model folder (its `utils/camera_utils.py`).
fn cameras_json(views: &[(String, Se3)]) -> Value {
    let camera = |(i, (name, pose)): (usize, &(String, Se3))| {
        let m = DMat3::from_quat(pose.rotation);
        let rows = [0, 1, 2].map(|i| [m.x_axis[i], m.y_axis[i], m.z_axis[i]]);
        json!({ "id": i, "img_name": name, "width": 640, "height": 480, "position": pose.translation.to_array(),
            "rotation": rows, "fy": 500.0, "fx": 500.0 })
    };
    views.iter().enumerate().map(camera).collect()
}

/// `transforms.json`: camera to world, y up and z back.
fn transforms_json(views: &[(String, Se3)]) -> Value {
    let frame = |(name, pose): &(String, Se3)| {
        let (m, c) = (DMat3::from_quat(pose.rotation), pose.translation);
        let row = |i: usize| json!([m.x_axis[i], -m.y_axis[i], -m.z_axis[i], c[i]]);
        json!({ "file_path": name, "transform_matrix": [row(0), row(1), row(2), [0, 0, 0, 1]] })
    };
    json!({ "w": 640, "h": 480, "fl_x": 500.0, "fl_y": 500.0, "cx": 320.0, "cy": 240.0,
        "frames": views.iter().map(frame).collect::<Vec<_>>() })
}

/// The planted capture in every form, and [`MINE`] as `mine.yaml`.
fn workspace() -> Workspace {
    let place = Workspace::new();
    let [cameras, images] = colmap_text(&planted(false));
    place.write("model/sparse/0/cameras.txt", cameras);
    place.write("model/sparse/0/images.txt", images);
    place.write("trained/cameras.json", cameras_json(&planted(false)).to_string());
    place.write("transforms.json", transforms_json(&planted(false)).to_string());
    place.write("gap.json", transforms_json(&planted(true)).to_string());
    place.write("mine.yaml", MINE);
    place
}

const CAPTURES: [(&str, &str); 5] = [
    ("model", "colmap"),
    ("model/sparse/0", "colmap"),
    ("trained", "model"),
    ("trained/cameras.json", "model"),
    ("transforms.json", "nerfstudio"),
];

#[test]
fn every_form_of_a_capture_gives_its_path() {
    let place = workspace();
    let wanted = base(&planted(false)).trajectory;
    for (capture, kind) in CAPTURES {
        let ended = place.ok(&format!(
            "trajectory --capture {capture} --recipe mine.yaml --name base --out out.txt --json"
        ));
        let seen: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!((seen["capture"].as_str(), seen["M"].as_u64()), (Some(kind), Some(25)), "{capture}");
        let found = poses(&fs::read(place.path("out.txt")).unwrap());
        assert_eq!(found.stamps_us, wanted.stamps_us);
        for (a, b) in found.world_from_camera.iter().zip(&wanted.world_from_camera) {
            // rotations pass through a matrix or a conjugate, and centres of up to 5 units through
            // a rotation. The curve amplifies these roundings of 1e-15 by at most a hundred
            let apart = (a.translation - b.translation).length() + (a.rotation - b.rotation).length();
            assert!(apart < 1e-12, "{capture}: {apart:e}");
        }
    }
}

#[test]
fn a_photographed_capture_gives_the_path_of_the_library() {
    for (capture, kind) in [("sparse/0", "colmap"), ("transforms.json", "nerfstudio")] {
        let Some(path) = shared::path(&format!("data/captures/fox/{capture}")) else { return };
        let read =
            if kind == "colmap" { colmap::read_capture(&path) } else { nerfstudio::read_capture(&path) };
        let wanted = base(&views(&read.unwrap().0));
        let place = workspace();
        let path = path.display();
        let files = "--out a.txt --report b.json --svg c.svg --stamps d.txt";
        let ended = place.ok(&format!("trajectory --capture {path} --recipe mine.yaml --name base {files}"));
        let file = |name: &str| fs::read(place.path(name)).unwrap();
        assert_eq!(poses(&file("a.txt")), wanted.trajectory);
        assert_eq!(serde_json::from_slice::<SpeedReport>(&file("b.json")).unwrap(), wanted.report);
        assert_eq!(file("c.svg"), picture::trajectory_svg(&wanted.trajectory, &wanted.report).into_bytes());
        let stamps: Vec<String> = wanted.trajectory.stamps_us.iter().map(|t| format!("{t}\n")).collect();
        assert_eq!(file("d.txt"), stamps.concat().into_bytes());
        // The lens is reported, and so is every warning of the report.
        let own = wanted.report.warnings.iter().map(String::as_str);
        for part in own.chain(["base: 25 poses over 24.0 ms, 1000 per second", "the photos are distorted"]) {
            assert!(ended.stderr.contains(part), "`{part}` is not in\n{}", ended.stderr);
        }
    }
}

/// The recipe's source and its sensor's preset do not exist. The files still equal those of a
/// build.
#[test]
fn the_files_are_those_of_a_release() {
    let place = sound();
    place.ok("build -q recipe.yaml");
    let built = steps(&place, "recipe.yaml").remove("given/base/trajectory").unwrap().outputs;
    let elsewhere =
        GIVEN.replace("path: transforms.json", "path: gone").replace("preset: dvs346", "preset: gone");
    place.write("elsewhere.yaml", elsewhere);
    let files = "--out poses.txt --report speed.json --svg trajectory.svg --stamps timestamps_us.txt";
    place.ok(&format!("trajectory -q --capture transforms.json --recipe elsewhere.yaml --name base {files}"));
    assert_eq!(built.len(), 4);
    for (role, path) in built {
        assert!(fs::read(place.path(&role)).unwrap() == fs::read(path).unwrap(), "other bytes in {role}");
    }
}

const RIGHT: &str = "trajectory --capture transforms.json --recipe mine.yaml --name base --out new.txt";

#[test]
fn the_motion_is_reported_to_users() {
    let place = workspace();
    let message = place.ok(RIGHT).stderr;
    for part in [
        "base: 25 poses over 24.0 ms, 1000 per second, from a nerfstudio capture",
        "mixed, along the curve 1.0000..1.0000, 95 % within 0.00 %",
        "mixed, pose to pose ",
        "linear ",
        "angular ",
        "largest jump at a knot: pose ",
        "px from frame to frame: median ",
        "upper bound for a point in the picture's centre at the scale distance",
        "focal length 50.0 px",
    ] {
        assert!(message.contains(part), "`{part}` is not in\n{message}");
    }
    let quiet = place.ok(&format!("{RIGHT} -q"));
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
}

#[test]
fn programs_get_one_object() {
    let place = workspace();
    let ended = place.ok(&format!("{RIGHT} --json -q --svg picture.svg"));
    assert_eq!((ended.stdout.lines().count(), ended.stderr.as_str()), (1, ""));
    let seen: Value = serde_json::from_str(&ended.stdout).unwrap();
    let made = base(&views(&nerfstudio::read_capture(&place.path("transforms.json")).unwrap().0));
    let report = serde_json::to_value(&made.report).unwrap();
    for (key, value) in report.as_object().unwrap() {
        let long = ["u", "s", "linear_unit_s", "angular_rad_s"].contains(&key.as_str());
        assert_eq!(seen.get(key), (!long).then_some(value), "{key}");
    }
    assert_eq!(seen["trajectory"], "base");
    assert_eq!(seen["duration_s"], 0.024);
    assert_eq!(seen["files"], json!({ "out": "new.txt", "svg": "picture.svg" }));
    // The largest motion of the middle, computed from the poses in another way: angle and distance
    // of neighbours, which here have little motion along or about the optical axis, so that it is
    // neglected.
    let steps: Vec<f64> = made
        .trajectory
        .world_from_camera
        .windows(2)
        .map(|pair| {
            let shift = pair[1].translation - pair[0].translation;
            let ahead = pair[0].rotation * DVec3::Z;
            let sideways = shift.cross(ahead).length();
            let turn = (pair[1].rotation * DVec3::Z).cross(ahead).length();
            50.0 * (sideways / made.report.scale_distance + turn)
        })
        .collect();
    let largest = steps.iter().copied().fold(0.0, f64::max);
    let found = seen["px_per_frame"]["max"].as_f64().unwrap();
    // the sine and the turn about the axis differ from the rotation vector by its cube, 0.06^3 of
    // 100 px
    assert!((found / largest - 1.0).abs() < 2e-3, "{found} {largest}");
    let [median, p95] = ["median", "p95"].map(|q| seen["px_per_frame"][q].as_f64().unwrap());
    assert!(0.0 < median && median <= p95 && p95 <= found);
}

#[test]
fn poses_may_go_to_stdout() {
    let place = workspace();
    place.ok(RIGHT);
    let before = tree(&place.path(""));
    let ended = place.ok(&RIGHT.replace("new.txt", "-"));
    assert_eq!(ended.stdout.as_bytes(), before["new.txt"]);
    assert!(tree(&place.path("")) == before, "nothing else is written");
}

/// Every mistake ends with its exit code and its message, and leaves all files unchanged.
#[test]
fn mistakes_are_reported_and_leave_no_file() {
    let place = workspace();
    place.write("new.txt", "as it was");
    place.write("empty/a.txt", "");
    place.write("both/transforms.json", "{}");
    place.write("both/cameras.json", "[]");
    place.write("broken/transforms.json", "{ \"frames\": [");
    place.write("bent.json", transforms_json(&planted(false)).to_string().replace("v3.jpg", "v2.jpg"));
    place.write("typo.yaml", MINE.replace("window", "windw"));
    let before = tree(&place.path(""));
    let t = |change: [&str; 2], code: i32, parts: &[&str]| {
        let args = RIGHT.replace(change[0], change[1]);
        let ended = place.gs2e(&args);
        assert_eq!((ended.code, ended.stdout.as_str()), (code, ""), "gs2e {args}\n{}", ended.stderr);
        for part in parts {
            assert!(ended.stderr.contains(part), "gs2e {args}: `{part}` is not in\n{}", ended.stderr);
        }
        assert!(tree(&place.path("")) == before, "gs2e {args}: files were changed");
    };
    let capture = "transforms.json";
    t(["--out new.txt", ""], 2, &["--out"]);
    t(["--recipe mine.yaml", ""], 2, &["--recipe"]);
    t(["mine.yaml", "gone.yaml"], 2, &["gone.yaml", "cannot be read"]);
    t(["mine.yaml", "typo.yaml"], 2, &["unknown field \"windw\"", "typo.yaml:5:29", "window"]);
    t(["--name base", "--name bas"], 2, &["no trajectory `bas`", "its trajectories: base, strict"]);
    t(["--capture transforms.json", ""], 2, &["`base` needs a capture", "help: pass --capture"]);
    t([capture, "gone"], 2, &["capture: gone does not exist"]);
    t(
        [capture, "empty"],
        2,
        &["cannot determine the layout of the capture", "empty", "found no capture", "wanted a COLMAP model"],
    );
    t([capture, "empty/a.txt"], 2, &["cannot determine the layout of the capture", "wanted a COLMAP model"]);
    t([capture, "both"], 2, &["contains a transforms.json and a cameras.json: name the one to use"]);
    t([capture, "broken"], 1, &["failed to read the capture", "transforms.json: line 1"]);
    t([capture, "bent.json"], 1, &["failed to read the capture", "`v2.jpg` is already used by"]);
    let refused =
        ["transforms.json --recipe mine.yaml --name base", "gap.json --recipe mine.yaml --name strict"];
    t(
        refused,
        1,
        &["failed to make the trajectory `strict`", "there is a gap between `v3.jpg` and `v4.jpg`"],
    );
    t(["--out new.txt", "--out empty"], 2, &["empty is a folder, wanted a file"]);
    t(["--out new.txt", "--out no/new.txt"], 2, &["no/new.txt is in a folder that does not exist"]);
    t(["--out new.txt", "--out new.txt --svg ./new.txt"], 2, &["two outputs are written to ./new.txt"]);
    t(["--out new.txt", "--out ./mine.yaml"], 2, &["./mine.yaml is an input and would be overwritten"]);
    t(["--out new.txt", "--out - --stamps -"], 2, &["two outputs are written to -"]);
    // One of two files cannot be written: the other is not written either.
    t(
        ["--out new.txt", "--out new.txt --report /dev/full"],
        2,
        &["/dev/full cannot be replaced: a device, not a regular file"],
    );
}

#[test]
fn mistakes_are_objects_for_programs() {
    let place = workspace();
    let t = |change: [&str; 2], code: &str| {
        let ended: RunOutcome = place.gs2e(&format!("{} --json", RIGHT.replace(change[0], change[1])));
        let found: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!(
            (found["level"].as_str(), found["code"].as_str()),
            (Some("error"), Some(code)),
            "{}",
            ended.stderr
        );
    };
    t(["--name base", "--name x"], "no-trajectory");
    t(["transforms.json", "gone"], "input-missing");
    t(["mine.yaml", "gone.yaml"], "recipe-invalid");
    t(["new.txt", "-"], "output-unwritable");
    t(
        ["transforms.json --recipe mine.yaml --name base", "gap.json --recipe mine.yaml --name strict"],
        "step-failed",
    );
}

#[test]
fn a_finished_file_replaces_another() {
    let place = workspace();
    place.write("new.txt", "as it was");
    std::os::unix::fs::symlink("new.txt", place.path("link.txt")).unwrap();
    place.ok(&RIGHT.replace("new.txt", "link.txt"));
    assert!(place.path("link.txt").is_symlink(), "a link is followed");
    assert_eq!(poses(&fs::read(place.path("new.txt")).unwrap()).stamps_us.len(), 25);
    let ended = place.gs2e(&RIGHT.replace("new.txt", "/dev/null"));
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("a device, not a regular file"), "{}", ended.stderr);
    let left: Vec<String> = tree(&place.path("")).into_keys().filter(|name| name.contains(".part")).collect();
    assert_eq!(left, [""; 0]);
}

#[test]
fn trained_exposures_are_reported() {
    let place = workspace();
    place.write("trained/exposure.json", "{ \"v0.jpg\": [[1, 0, 0, 0], [0, 0.9, 0, 0], [0, 0, 1, 0]] }");
    let message = place.ok(&RIGHT.replace("transforms.json", "trained")).stderr;
    assert!(message.contains("warning: exposure was trained for 1 images; it is not applied"), "{message}");
}
