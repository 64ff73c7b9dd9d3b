//! A release with all products, and forgeries of it that the program judges, as a person runs it.

use crate::release::forger::{read, reseal};
use crate::support::workspace::Workspace;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// A rig with a stereo pair, moving objects of which one has no pivot, inertial data, and labels of a sensor
/// without noise. Every second pose has depth.
const RIG: &str = "\
version: 1
scene: rich/rig
seed: 7
source: { procedural: { kind: still-life, gaussians: 400, views: 4, arc: 4, seed: 1 } }
camera: { width: 32, height: 24, fx: 31, fy: 30, cx: 15, cy: 13 }
trajectories: [{ name: base, refine: { window: 2, factor: 2 } }]
sampling: { rate: 240, between: linear }
sensor: { esim: { labels: true } }
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    path: { straight: { velocity: [0.6, 0, 0], spin: [0, 900, 0] } }
  - name: rest
    select: { box: { low: [-2, -2, 0.2], high: [2, -0.9, 2] } }
    path: { orbit: { centre: [0, 0, 0], axis: [0, 1, 0], degrees_per_second: 500 } }
rig:
  cameras:
    - { name: left }
    - { name: right, extrinsic: { position: [0.12, 0.01, -0.02] } }
  stereo: [[left, right]]
outputs: [events, sharp, depth, disparity, segmentation, imu]
depth: { every: 2 }
scale: { metres_per_unit: 0.5 }
imu: { rate: 1000, up: [0, -1, 0] }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// One camera, an object whose pivot is stated, inertial data under the gravity of the views, and a sensor
/// with noise.
const SINGLE: &str = "\
version: 1
scene: rich/single
seed: 8
source: { procedural: { kind: still-life, gaussians: 400, views: 4, arc: 4, seed: 1 } }
camera: { width: 32, height: 24 }
trajectories: [{ name: alone, refine: { window: 2, factor: 2 } }]
sampling: { rate: 240, between: linear }
objects:
  - name: orange
    select: { sphere: { centre: [0.32, -0.66, -0.04], radius: 0.24 } }
    pivot: [0.3, -0.6, 0]
    path: { straight: { velocity: [0.6, 0, 0], spin: [0, 900, 0] } }
outputs: [events, sharp, depth, segmentation, imu]
scale: { metres_per_unit: 0.5 }
licence: { expression: CC0-1.0, holder: Nobody }
";

/// Exports in formats with tables, archives and pictures.
const INCLUDE: &str = "\
include:
  - { format: evreal, trajectory: alone, lossy: true }
  - { format: robust-e-nerf, trajectory: alone, lossy: true }
  - { format: webdataset, trajectory: alone, lossy: true }
  - { format: dsec, trajectory: alone, lossy: true }
";

/// The release, made once and never changed.
pub(super) fn released() -> &'static Workspace {
    static RELEASED: OnceLock<Workspace> = OnceLock::new();
    RELEASED.get_or_init(|| {
        let place = Workspace::new();
        place.write("recipes/rig.yaml", RIG);
        place.write("recipes/single.yaml", SINGLE);
        place.write("recipes/release.yaml", INCLUDE);
        place.ok("release -q --copy --to tree recipes");
        place
    })
}

/// A change of one file of the release.
pub(super) struct FileForgery {
    pub(super) file: &'static str,
    pub(super) code: &'static str,
    pub(super) forge: Box<dyn Fn(&Path)>,
}

pub(super) fn change(
    file: &'static str,
    code: &'static str,
    forge: impl Fn(Vec<u8>) -> Vec<u8> + 'static,
) -> FileForgery {
    let forge = move |path: &Path| {
        let before = fs::read(path).unwrap();
        let after = forge(before.clone());
        assert!(before != after, "{file} is the same");
        fs::write(path, after).unwrap();
    };
    FileForgery { file, code, forge: Box::new(forge) }
}

/// Code and file of each fault of the release after these changes, with every digest rewritten.
pub(super) fn judged(forge: impl FnOnce(&Path)) -> BTreeSet<String> {
    let place = Workspace::new();
    for (path, bytes) in read(&released().path("tree")) {
        place.write(&format!("tree/{path}"), bytes);
    }
    forge(&place.path("tree"));
    reseal(&place.path("tree"));
    let ended = place.gs2e("audit tree --json");
    let records = ended.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let text = |record: &Value, key: &str| record[key].as_str().unwrap_or_default().to_owned();
    let faults = records.filter(|record| record["code"].is_string());
    let found: BTreeSet<String> =
        faults.map(|record| format!("{} {}", text(&record, "code"), text(&record, "file"))).collect();
    assert_eq!(ended.code, if found.is_empty() { 0 } else { 3 }, "{}", ended.stderr);
    found
}

/// Makes rounds of forgeries, each of files that do not hide each other, and asserts that exactly they are
/// found.
pub(super) fn found_in_rounds(rounds: Vec<Vec<FileForgery>>) {
    for (number, round) in rounds.into_iter().enumerate() {
        let wanted: BTreeSet<String> =
            round.iter().map(|forgery| format!("{} {}", forgery.code, forgery.file)).collect();
        let found = judged(|tree| round.iter().for_each(|forgery| (forgery.forge)(&tree.join(forgery.file))));
        assert_eq!(found, wanted, "round {number}");
    }
}

#[test]
fn the_release_itself_is_sound() {
    assert_eq!(judged(|_| {}), BTreeSet::new());
}
