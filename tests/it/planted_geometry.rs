//! Faults of poses, pictures and clocks, planted in the files of a release: `gs2e check --tree`
//! finds each by the pass that is named after it.

use crate::release::forger::{read, reseal_sums};
use crate::release::small::{gs2e, said};
use glam::{DMat3, DQuat, DVec3};
use gs2e_event::h5::H5Options;
use gs2e_event::{Event, EventSink as _, EventSource as _, h5};
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3};
use gs2e_num::units::Timestamp;
use gs2e_trajectory::Trajectory;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A trajectory whose speed grows, with every picture at every pose.
const RECIPE: &str = "\
version: 1
scene: lab
seed: 7
source:
  procedural: { kind: still-life, gaussians: 4000, views: 6, arc: 10, seed: 1 }
camera: { width: 80, height: 60 }
trajectories:
  - name: base
    refine: { window: 1, factor: 5 }
    speed: { function: \"1 + t\" }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } }
outputs: [events, sharp, depth, flow]
";
pub(crate) const POSES: usize = 30;

pub(crate) fn release() -> &'static Path {
    static RELEASE: OnceLock<TempDir> = OnceLock::new();
    let folder = RELEASE.get_or_init(|| released(RECIPE));
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| folder.path().join("out"))
}

/// A folder with the release `out` of a recipe.
fn released(recipe: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("lab.yaml"), recipe).unwrap();
    let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "lab.yaml"]);
    assert!(output.status.success(), "{}", said(&output));
    folder
}

/// The records of `check --tree` on a copy with a fault. `left_out` are folders of pictures that the
/// copy lacks.
fn checked(left_out: &[&str], plant: impl Fn(&Path)) -> Vec<Value> {
    checked_copy(release(), left_out, plant)
}

fn checked_copy(release: &Path, left_out: &[&str], plant: impl Fn(&Path)) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    for (path, bytes) in read(release) {
        if !left_out.iter().any(|kind| path.contains(&format!("/{kind}/"))) {
            let target = folder.path().join(path);
            fs::create_dir_all(target.parent().unwrap()).unwrap();
            fs::write(target, bytes).unwrap();
        }
    }
    plant(&folder.path().join("lab/base"));
    reseal_sums(folder.path());
    let output = gs2e(folder.path(), &["check", "--json", "--tree", "."]);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(!text.is_empty(), "{}", said(&output));
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// `check#part` of the findings with this verdict.
fn with_verdict(records: &[Value], verdict: &str) -> Vec<String> {
    let named = |record: &Value| {
        let subject = record["subject"].as_str().unwrap().replace("lab/base", "");
        format!("{}{subject}", record["check"].as_str().unwrap())
    };
    // A fault that is planted in some files makes them disagree with the others, and so does an absent
    // folder. These tests ask what the pictures and the poses show by themselves.
    let others = records.iter().filter(|record| record["check"] != "records");
    others.filter(|record| record["verdict"] == verdict).map(named).collect()
}

fn poses(folder: &Path, change: impl FnOnce(&mut Vec<Se3>)) {
    let path = folder.join("poses.txt");
    let mut trajectory = Trajectory::read_poses(fs::read(&path).unwrap().as_slice()).unwrap();
    change(&mut trajectory.world_from_camera);
    trajectory.write_poses(fs::File::create(&path).unwrap()).unwrap();
}

fn events(folder: &Path, change: impl Fn(i64) -> i64) {
    let path = folder.join("events.h5");
    let mut reader = h5::Reader::open(&path).unwrap();
    let (header, mut events, mut chunk) = (reader.header().unwrap(), Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        events.extend_from_slice(&chunk);
    }
    let end = i64::try_from(POSES - 1).unwrap() * 1_000_000 / 2400;
    events.iter_mut().for_each(|e: &mut Event| e.t = Timestamp::from_micros(change(e.t.floor_micros())));
    events.retain(|event| (0..=end).contains(&event.t.floor_micros()));
    events.sort_by_key(Event::file_order);
    let mut writer = h5::Writer::create_as(&path, &header, H5Options::default()).unwrap();
    writer.append(&events).unwrap();
    writer.finish(end).unwrap();
}

/// Renames the files of a kind: pose `j` gets the file of `from(j)`.
fn pictures(folder: &Path, kind: &str, from: impl Fn(usize) -> usize) {
    let extension = if kind == "sharp" { "png" } else { "npy" };
    let name = |j: usize| folder.join(format!("{kind}/{j:06}.{extension}"));
    let all: Vec<Vec<u8>> = (0..POSES).map(|j| fs::read(name(j)).unwrap()).collect();
    (0..POSES).for_each(|j| fs::write(name(j), &all[from(j)]).unwrap());
}

/// Multiplies the numbers of all depth images.
fn scale_depth(folder: &Path, factor: f32) {
    for entry in fs::read_dir(folder.join("depth")).unwrap() {
        let path = entry.unwrap().path();
        let mut bytes = fs::read(&path).unwrap();
        let head = bytes.len() - 4 * 80 * 60;
        for number in bytes[head..].as_chunks_mut().0 {
            *number = (factor * f32::from_le_bytes(*number)).to_le_bytes();
        }
        fs::write(path, bytes).unwrap();
    }
}

fn opengl(pose: &mut Se3) {
    pose.rotation *= DQuat::from_mat3(&DMat3::from_diagonal(OPENCV_FROM_OPENGL));
}

fn scaled(poses: &mut [Se3], factor: f64) {
    poses.iter_mut().for_each(|pose| pose.translation *= factor);
}

/// Noise of this share of a step, from a fixed sequence.
fn shaken(poses: &mut [Se3], share: f64) {
    let step = (poses[15].translation - poses[14].translation).length();
    for (j, pose) in poses.iter_mut().enumerate() {
        let part = |k: f64| ((j as f64 * k).fract() - 0.5) * 12f64.sqrt();
        let draw = DVec3::new(part(0.618_034), part(0.754_878), part(0.569_840));
        pose.translation += share * step * draw;
    }
}

fn swapped(j: usize) -> usize {
    match j {
        12 => 13,
        13 => 12,
        j => j,
    }
}

/// A fault: its name, and its plant.
type Planted = (&'static str, Box<dyn Fn(&Path)>);

fn planted(name: &'static str, plant: impl Fn(&Path) + 'static) -> Planted {
    (name, Box::new(plant))
}

fn of_poses(name: &'static str, change: impl Fn(&mut Vec<Se3>) + 'static) -> Planted {
    planted(name, move |folder| poses(folder, &change))
}

/// The faults of poses and pictures, each with the passes that must find it with depth and without
/// flow images, which would find most of them at once.
fn faults() -> Vec<(Planted, &'static [&'static str])> {
    let motion: &[&str] = &["photometric#motion"];
    let noise: &[&str] = &["pose_continuity#noise-translation"];
    vec![
        (of_poses("inverted", |p| p.iter_mut().for_each(|p| *p = p.inverse())), motion),
        (of_poses("OpenGL axes", |p| p.iter_mut().for_each(opengl)), motion),
        (of_poses("translation of another scale", |p| scaled(p, 1.1)), motion),
        (of_poses("reversed poses", |p| p.reverse()), motion),
        (
            of_poses("constant poses", |p| {
                let first = p[0];
                p.fill(first);
            }),
            motion,
        ),
        (of_poses("two poses swapped", |p| p.swap(12, 13)), noise),
        (of_poses("noise of half a step", |p| shaken(p, 0.5)), noise),
        (of_poses("noise of a hundredth of a step", |p| shaken(p, 0.01)), noise),
        (
            of_poses("a turned pose", |p| p[14].rotation *= DQuat::from_rotation_x(0.1f64.to_radians())),
            &["pose_continuity#noise-rotation"],
        ),
        (planted("reversed frames", |f| pictures(f, "sharp", |j| POSES - 1 - j)), motion),
        (planted("shuffled frames", |f| pictures(f, "sharp", |j| 7 * j % POSES)), &["photometric#frames"]),
        (planted("two frames swapped", |f| pictures(f, "sharp", swapped)), &["photometric#frames"]),
        (planted("depth of another scale", |f| scale_depth(f, 1.1)), motion),
        (
            planted("reversed depth", |f| pictures(f, "depth", |j| POSES - 1 - j)),
            &["depth_consistency#motion"],
        ),
        (planted("two depths swapped", |f| pictures(f, "depth", swapped)), &["depth_consistency#frames"]),
    ]
}

#[test]
fn a_sound_release_raises_no_alarm_and_states_what_would_be_found() {
    for left_out in [&[][..], &["flow"], &["depth", "flow"]] {
        let records = checked(left_out, |_| ());
        assert_eq!(with_verdict(&records, "fail"), [""; 0], "{left_out:?}: {records:#?}");
        assert_eq!(with_verdict(&records, "warn"), [""; 0], "{left_out:?}: {records:#?}");
        let mut passed = with_verdict(&records, "pass");
        passed.retain(|name| {
            ["event_times", "photo", "depth_", "flow_", "pose_continuity#noise"]
                .iter()
                .any(|of| name.starts_with(of))
        });
        let mut wanted = vec![
            "event_times#offset",
            "event_times#scale",
            "event_times#grid",
            "pose_continuity#noise-translation",
            "pose_continuity#noise-rotation",
        ];
        if !left_out.contains(&"depth") {
            wanted.extend(["photometric#motion", "photometric#frames"]);
        }
        wanted.push("photometric#order");
        if !left_out.contains(&"depth") {
            wanted.extend(["depth_consistency#motion", "depth_consistency#frames"]);
        }
        if left_out.is_empty() {
            wanted.push("flow_projection");
        }
        assert_eq!(passed, wanted, "{records:#?}");
        for record in records.iter().filter(|r| r["verdict"] == "pass") {
            let stated = &record["detects"]["size"];
            let name = record["check"].as_str().unwrap();
            let states =
                ["event_times", "photometric", "depth_consistency", "flow_projection"].contains(&name);
            if states && !record["subject"].as_str().unwrap().ends_with("#order") {
                assert!(stated.as_f64().unwrap() > 0.0, "{record:#}");
            }
        }
    }
}

#[test]
fn planted_faults_of_poses_and_pictures_are_found_by_depth_and_frames() {
    let mut missed = Vec::new();
    for ((name, plant), wanted) in faults() {
        let records = checked(&["flow"], plant);
        let failed = with_verdict(&records, "fail");
        if !wanted.iter().all(|of| failed.iter().any(|name| name == of)) {
            let of = |record: &&Value| {
                ["photometric", "depth_consistency", "pose_continuity"].iter().any(|c| record["check"] == *c)
            };
            let found: Vec<&Value> = records.iter().filter(of).map(|r| &r["because"]).collect();
            missed.push(format!("{name}: wanted {wanted:?}, found {failed:?}: {found:#?}"));
        }
    }
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

#[test]
fn flow_images_show_faults_of_poses_and_depth() {
    let shift = |j: usize| (j + 1).min(POSES - 1);
    for (name, plant) in [
        of_poses("poses shifted by one", move |p| *p = (0..POSES).map(|j| p[shift(j)]).collect()),
        planted("depth of the next pose", move |f| pictures(f, "depth", shift)),
        planted("depth of another scale", |f| scale_depth(f, 1.01)),
        planted("flow of the next pose", move |f| pictures(f, "flow", shift)),
        of_poses("noise of a hundredth of a step", |p| shaken(p, 0.01)),
    ] {
        let failed = with_verdict(&checked(&[], plant), "fail");
        assert!(failed.contains(&"flow_projection".to_owned()), "{name}: {failed:?}");
    }
}

#[test]
fn planted_faults_of_the_clock_are_found_from_events_and_frames() {
    let late = |us: i64| planted("late", move |f| events(f, |t| t + us));
    for ((name, plant), wanted) in [
        (late(100), "event_times#offset"),
        (late(-100), "event_times#offset"),
        (late(20), "event_times#offset"),
        (planted("slow", |f| events(f, |t| t * 99 / 100)), "event_times#scale"),
        (planted("rounded", |f| events(f, |t| t / 100 * 100)), "event_times#grid"),
        (planted("rounded by 3", |f| events(f, |t| t / 3 * 3)), "event_times#grid"),
    ] {
        let records = checked(&["depth", "flow"], plant);
        let failed = with_verdict(&records, "fail");
        let found: Vec<&Value> =
            records.iter().filter(|r| r["check"] == "event_times").map(|r| &r["because"]).collect();
        assert!(failed.iter().any(|of| of == wanted), "{name}: {failed:?} {found:#?}");
    }
}

/// Sensors with unequal pixels, with a noise floor and with a dead time, among them the default one.
#[test]
fn faults_of_the_clock_are_found_for_unequal_and_noisy_pixels() {
    for sensor in [
        "voltmeter: {}",
        "voltmeter: { preset: evk4 }",
        "esim: { threshold: { on: 0.1, off: 0.1, spread: 0.015 } }",
    ] {
        let usual = "voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } }";
        let recipe = RECIPE.replace(usual, sensor).replace(", depth, flow]", "]");
        // Noise of the photoreceptor hides small offsets where the picture moves slowly.
        let size =
            if sensor.contains("evk4") { "{ width: 240, height: 180 }" } else { "{ width: 80, height: 60 }" };
        let recipe = recipe.replace("{ width: 80, height: 60 }", size);
        let folder = released(&recipe);
        let report = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
        // Behind a dead time, events do not balance the drift, and there is no picture of their difference.
        assert_eq!(report.contains("alt=\"check event_frame\""), !sensor.contains("evk4"), "{sensor}");
        let clock = |change: fn(i64) -> i64| {
            let records = checked_copy(&folder.path().join("out"), &[], |f| events(f, change));
            let of_clock = records.into_iter().filter(|record| record["check"] == "event_times");
            of_clock.map(|record| (record["verdict"].to_string(), record)).collect::<Vec<_>>()
        };
        let sound = clock(|t| t);
        assert!(sound.iter().all(|(verdict, _)| verdict == "\"pass\""), "{sensor}: {sound:#?}");
        for (name, part, change) in [
            ("50 us late", 0, (|t| t + 50) as fn(i64) -> i64),
            ("50 us early", 0, |t| t - 50),
            ("100 us late", 0, |t| t + 100),
            ("a clock of 0.99", 1, |t| t * 99 / 100),
            ("a clock of 1.01", 1, |t| t * 101 / 100),
        ] {
            let found = clock(change);
            assert_eq!(found[part].0, "\"fail\"", "{sensor}, {name}: {found:#?}");
        }
    }
}

#[test]
fn without_depth_the_order_of_frames_and_the_noise_of_poses_are_judged() {
    for ((name, plant), wanted) in [
        (planted("two frames swapped", |f| pictures(f, "sharp", swapped)), "photometric#order"),
        (planted("shuffled frames", |f| pictures(f, "sharp", |j| 7 * j % POSES)), "photometric#order"),
        (
            of_poses("constant poses", |p| {
                let first = p[0];
                p.fill(first);
            }),
            "photometric#order",
        ),
        (of_poses("noise of half a step", |p| shaken(p, 0.5)), "pose_continuity#noise-translation"),
    ] {
        let failed = with_verdict(&checked(&["depth", "flow"], plant), "fail");
        assert!(failed.iter().any(|of| of == wanted), "{name}: {failed:?}");
    }
}

/// Paths and speeds of every family, most of them with corners, cusps or bursts.
const FAMILIES: &str = "\
version: 1
scene: families
seed: 7
source: { procedural: { kind: still-life, gaussians: 200, views: 14, arc: 12, seed: 1 } }
camera: { width: 32, height: 24 }
trajectories:
  - { name: base, refine: { window: 2, factor: 5 } }
  - { name: raw, refine: { window: 0, factor: 3 } }
  - { name: nearest, refine: { window: 0, factor: 4, order: nearest } }
  - { name: corners, refine: { window: 1, factor: 6, curve: slerp-lerp } }
  - { name: b-spline, refine: { window: 1, factor: 4, curve: cumulative } }
  - { name: bezier, refine: { window: 1, factor: 4, curve: { bezier: { degree: 4 } } } }
  - { name: chords, refine: { window: 1, factor: 5, literal: true } }
  - { name: levels, refine: { window: 2, factor: 8 }, speed: { list: { multipliers: [1, 0.3, 3], blend: 0 } } }
  - { name: denser, refine: { window: 2, factor: 8 }, speed: { list: { multipliers: [1, 0.5, 2], meaning: frame-rate } } }
  - { name: cusp, refine: { window: 2, factor: 5 }, speed: { function: \"0.05 + abs(t - 0.5)\" } }
  - { name: bursts, refine: { window: 2, factor: 5 }, speed: { function: \"1.01 + sin(60*t)\" } }
  - { name: spurts, refine: { window: 2, factor: 9 }, speed: { function: \"0.1 + abs(sin(40*t))\" } }
  - { name: novel, novel: { groups: 2, keyframes: 5, frames: 60 } }
  - { name: lines, novel: { groups: 1, keyframes: 5, frames: 60, curve: slerp-lerp } }
  - { name: orbit, orbit: { arc: 40, frames: 60 } }
  - name: keyframes
    keyframes:
      frames: 60
      poses:
        - { position: [0, 0, 4], look_at: [0, 0, 0], up: [0, 1, 0] }
        - { position: [0.3, 0, 4], look_at: [0, 0, 0], up: [0, 1, 0] }
        - { position: [0.3, 0.3, 4], look_at: [0, 0.1, 0], up: [0, 1, 0] }
        - { position: [0.31, 0.3, 4.2], look_at: [0, 0, 0], up: [0, 1, 0] }
      curve: slerp-lerp
outputs: [depth]
depth: { every: 1000 }
";

#[test]
fn no_family_of_paths_and_speeds_looks_like_noise() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("families.yaml"), FAMILIES).unwrap();
    let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "families.yaml"]);
    assert!(output.status.success(), "{}", said(&output));
    let output = gs2e(folder.path(), &["check", "--json", "--tree", "out"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let records: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let noise: Vec<&Value> =
        records.iter().filter(|r| r["subject"].as_str().unwrap().contains("#noise-")).collect();
    // Bursts have too few poses per view where they are fastest; all others are judged.
    let judged = noise.iter().filter(|r| r["verdict"] == "pass").count();
    assert!(judged >= noise.len() - 4 && noise.len() == 34, "{noise:#?}");
    assert!(noise.iter().all(|r| r["verdict"] == "pass" || r["verdict"] == "not-run"), "{noise:#?}");
}

#[test]
fn a_usual_mistake_is_named() {
    let records = checked(&["flow"], |f| poses(f, |p| p.iter_mut().for_each(opengl)));
    let found = records.iter().find(|r| r["check"] == "photometric" && r["verdict"] == "fail").unwrap();
    assert!(
        found["because"].as_str().unwrap().ends_with("they agree with camera axes of OpenGL"),
        "{found:#}"
    );
}
