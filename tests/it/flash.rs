//! Gaussians that pass the near plane before the camera: found by the check `flash` where they change the
//! events, and hidden by `render.near`.

use crate::release::small::{gs2e, said};
use crate::support::given::transforms;
use glam::DVec3;
use gs2e_demo::{StillLife, still_life};
use gs2e_event::{EventSource as _, h5};
use gs2e_num::se3::Se3;
use gs2e_scene::Gaussians;
use gs2e_scene::form::SceneFormat;
use gs2e_trajectory::Trajectory;
use serde_json::Value;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// An orbit of 48 ms about the still life, which turns by 15 degrees.
const RECIPE: &str = "\
version: 1
scene: flashing
seed: 3
source: { nerfstudio: { path: transforms.json } }
reconstruct: { given: { path: scene.ply } }
camera: { width: 160, height: 90, fx: 150, fy: 150, cx: 80, cy: 45 }
trajectories:
  - name: base
    orbit: { centre: [0.12, -0.56, 0.12], from: [-0.3, -1.7, -4], up: [0, -1, 0], arc: 15, frames: 116 }
sampling: { rate: 2400 }
sensor: { voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } } }
outputs: [events, sharp]
checks: { waive: [{ check: flash, because: a test plants it }, { check: polarity, because: a flash }] }
";

const POSES: usize = 116;
/// The pose at which a planted Gaussian is on the near plane.
const AT: usize = 60;
const PIXELS: f64 = 160.0 * 90.0;
/// Depth of the renderer's near plane.
const NEAR: f64 = 0.2;

/// A release of the still life, perhaps with another Gaussian.
struct Flashing {
    folder: TempDir,
}

impl Flashing {
    fn new(scene: &Gaussians, recipe: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.ply"), SceneFormat::Ply.write(scene).unwrap().0).unwrap();
        fs::write(folder.path().join("transforms.json"), transforms(1.0)).unwrap();
        fs::write(folder.path().join("flashing.yaml"), recipe).unwrap();
        let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "flashing.yaml"]);
        assert!(output.status.success(), "{}", said(&output));
        Self { folder }
    }

    fn base(&self) -> std::path::PathBuf {
        self.folder.path().join("out/flashing/base")
    }

    /// ON and OFF events of each whole millisecond.
    fn rates(&self) -> Vec<[f64; 2]> {
        let mut reader = h5::Reader::open(&self.base().join("events.h5")).unwrap();
        let (mut rates, mut chunk) = (vec![[0.0; 2]; 47], Vec::new());
        while reader.next_chunk(&mut chunk).unwrap() {
            for event in &chunk {
                let at = usize::try_from(event.t.floor_micros() / 1000).unwrap();
                let of = usize::from(event.polarity == gs2e_event::Polarity::Off);
                rates.get_mut(at).into_iter().for_each(|rate| rate[of] += 1.0);
            }
        }
        rates
    }

    /// The findings of the check in the build.
    fn findings(&self) -> Vec<Value> {
        let text = fs::read_to_string(self.base().join("checks.json")).unwrap();
        let all: Value = serde_json::from_str(&text).unwrap();
        flashes(all.as_array().or_else(|| all["findings"].as_array()).unwrap())
    }

    /// The findings of the check from the files of the release.
    fn findings_of_files(&self) -> Vec<Value> {
        let output = gs2e(self.folder.path(), &["check", "--json", "--tree", "out"]);
        let text = String::from_utf8(output.stdout).unwrap();
        flashes(&text.lines().map(|line| serde_json::from_str(line).unwrap()).collect::<Vec<_>>())
    }
}

fn flashes(findings: &[Value]) -> Vec<Value> {
    findings.iter().filter(|finding| finding["check"] == "flash").cloned().collect()
}

/// The finding of a statement.
fn statement<'f>(findings: &'f [Value], name: &str) -> &'f Value {
    let ends = |finding: &&Value| finding["subject"].as_str().unwrap().ends_with(&format!("#{name}"));
    findings.iter().find(ends).unwrap_or_else(|| panic!("{name}: {findings:#?}"))
}

fn is_alarm(finding: &Value) -> bool {
    match finding["verdict"].as_str().unwrap() {
        "waived" => true,
        "pass" => false,
        other => panic!("{other}: {finding:#}"),
    }
}

fn room() -> Gaussians {
    still_life(&StillLife { gaussians: 4000, seed: 1, ..StillLife::default() })
}

#[expect(clippy::cast_possible_truncation, reason = "scene files have 32 bits")]
fn log_scale(size: f64) -> f32 {
    size.ln() as f32
}

/// The room with a round, white, opaque Gaussian at a place before the camera of a pose.
fn with_blob(pose: &Se3, place: DVec3, size: f64) -> Gaussians {
    let mut scene = room();
    let mean = pose.rotation * place + pose.translation - scene.origin;
    let functions = scene.sh_len();
    scene.positions.push(mean.as_vec3().to_array());
    scene.log_scales.push([log_scale(size); 3]);
    scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
    scene.opacity_logits.push(1.0);
    // Harmonic 0 is 0.5 + 0.282 c.
    scene.sh.push([1.7; 3]);
    scene.sh.extend(vec![[0.0; 3]; functions - 1]);
    scene.screening.read += 1;
    scene
}

fn poses(base: &Path) -> Trajectory {
    Trajectory::read_poses(fs::read(base.join("poses.txt")).unwrap().as_slice()).unwrap()
}

/// The most events that a Gaussian adds to a millisecond, per pixel, and that millisecond.
fn most_added(with: &[[f64; 2]], without: &[[f64; 2]]) -> (f64, usize) {
    let added = with.iter().zip(without).map(|(w, o)| (w[0] - o[0]).max(w[1] - o[1]) / PIXELS);
    added.zip(0..).max_by(|(a, _), (b, _)| a.total_cmp(b)).unwrap()
}

/// Ten Gaussians by distance to the side and size: large ones cover the picture when they reach the near
/// plane.
const PLANTED: [[f64; 2]; 10] = [
    [0.3, 0.02],
    [0.3, 0.15],
    [0.3, 0.4],
    [0.6, 0.05],
    [0.6, 0.3],
    [1.0, 0.1],
    [1.0, 0.5],
    [1.5, 0.2],
    [1.5, 0.8],
    [2.0, 0.25],
];

#[test]
fn a_gaussian_that_flashes_is_found_by_its_events_and_its_frames_and_named() {
    let sound = Flashing::new(&room(), RECIPE);
    for findings in [sound.findings(), sound.findings_of_files()] {
        assert!(!findings.iter().any(is_alarm), "{findings:#?}");
    }
    let (trajectory, usual) = (poses(&sound.base()), sound.rates());
    let pose = &trajectory.world_from_camera[AT];
    let (mut found, mut silent) = (0, 0);
    for [side, size] in PLANTED {
        let planted = Flashing::new(&with_blob(pose, DVec3::new(side, 0.0, NEAR), size), RECIPE);
        let (added, millisecond) = most_added(&planted.rates(), &usual);
        let findings = planted.findings();
        let events = statement(&findings, "events");
        let because = events["because"].as_str().unwrap();
        eprintln!("{side} {size}: {added:.4} per pixel in ms {millisecond}: {because}");
        // The usual rate is below 0.1 per pixel, and an alarm needs five times as many. Between the bounds,
        // either is right.
        if added > 0.6 {
            found += 1;
            assert!(is_alarm(events), "{side} {size}: {events:#}");
            let begin: f64 = because.split(' ').nth(1).unwrap().parse().unwrap();
            assert!((begin - millisecond as f64).abs() <= 4.0, "{millisecond}: {because}");
            assert!(because.contains("; Gaussian 4000, "), "{because}");
            assert!(is_alarm(statement(&findings, "frames")), "{findings:#?}");
            assert!(planted.findings_of_files().iter().all(is_alarm), "{side} {size}");
        } else if added < 0.03 {
            silent += 1;
            assert!(!findings.iter().any(is_alarm), "{side} {size}: {findings:#?}");
        }
    }
    assert!(found >= 3 && silent >= 3, "{found} {silent}");
}

#[test]
fn a_path_without_the_gaussians_near_it_has_no_flash() {
    let sound = Flashing::new(&room(), RECIPE);
    let trajectory = poses(&sound.base());
    let scene = with_blob(&trajectory.world_from_camera[AT], DVec3::new(1.0, 0.0, NEAR), 0.5);
    let hidden = Flashing::new(&scene, &format!("{RECIPE}render: {{ near: 0 }}\n"));
    assert!(!hidden.findings().iter().any(is_alarm), "{:#?}", hidden.findings());
    // Without the planted Gaussian, the bytes are those of the room.
    assert_eq!(hidden.rates(), sound.rates());
    assert_eq!(trajectory.stamps_us.len(), POSES);
    let frame = |of: &Flashing| fs::read(of.base().join(format!("sharp/{AT:06}.png"))).unwrap();
    assert_eq!(frame(&hidden), frame(&sound));
}
