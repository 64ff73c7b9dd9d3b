//! A release of a small scene, and faults that are planted in copies of its files.

use crate::release::small::{gs2e, reseal, said};
use gs2e_event::{Event, EventSink as _, EventSource as _, h5};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Folder of the only trajectory.
pub(super) const BASE: &str = "planted/scene/base";
/// Size of the pictures.
pub(super) const SIZE: [u16; 2] = [200, 150];

/// Thirty poses of a quick path over 2,500 Gaussians, with pictures of every kind.
const RECIPE: &str = "\
version: 1
scene: planted/scene
seed: 3
source:
  procedural: { kind: still-life, gaussians: 2500, views: 8, arc: 10, seed: 4 }
camera: { width: 200, height: 150 }
trajectories:
  - name: base
    refine: { window: 1, factor: 5 }
sampling: { rate: 1200 }
sensor:
  voltmeter: { preset: dvs346, threshold: { on: 0.5, off: 0.5 } }
outputs: [events, sharp, blur, depth, flow]
blur: { frames: 5, subframes: literal }
depth: { every: 4 }
flow: { every: 4 }
";

/// A release, made once and never changed.
pub(super) type PlantedRelease = OnceLock<(TempDir, PathBuf)>;

/// The release of a recipe.
fn release(made: &'static PlantedRelease, recipe: &str) -> &'static Path {
    let (_, path) = made.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.yaml"), recipe).unwrap();
        let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "scene.yaml"]);
        assert!(output.status.success(), "{}", said(&output));
        let path = folder.path().join("out");
        (folder, path)
    });
    path
}

/// A copy of the release. Files are links to the same bytes, so a change must replace the file.
pub(super) struct PlantedTree {
    folder: TempDir,
    base: &'static str,
}

impl PlantedTree {
    pub(super) fn new() -> Self {
        static RELEASE: PlantedRelease = OnceLock::new();
        Self::of(&RELEASE, RECIPE, BASE)
    }

    /// A copy of the release of a recipe, whose changes are in the trajectory of the folder `base`.
    pub(super) fn of(made: &'static PlantedRelease, recipe: &str, base: &'static str) -> Self {
        let release = release(made, recipe);
        let folder = tempfile::tempdir_in(release.parent().unwrap()).unwrap();
        for entry in walkdir::WalkDir::new(release).into_iter().map(Result::unwrap) {
            let target = folder.path().join(entry.path().strip_prefix(release).unwrap());
            if entry.file_type().is_dir() {
                fs::create_dir_all(target).unwrap();
            } else {
                fs::hard_link(entry.path(), target).unwrap();
            }
        }
        Self { folder, base }
    }

    pub(super) fn path(&self) -> &Path {
        self.folder.path()
    }

    fn in_base(&self, name: &str) -> PathBuf {
        self.folder.path().join(self.base).join(name)
    }

    pub(super) fn write(&self, path: &str, bytes: &[u8]) {
        let path = self.folder.path().join(path);
        fs::remove_file(&path).unwrap();
        fs::write(path, bytes).unwrap();
    }

    pub(super) fn stamps(&self) -> Vec<i64> {
        let text = fs::read_to_string(self.in_base("timestamps_us.txt")).unwrap();
        text.lines().map(|line| line.parse().unwrap()).collect()
    }

    /// Rewrites the events, sorted.
    pub(super) fn events(&self, change: impl FnOnce(&mut Vec<Event>)) {
        let path = self.in_base("events.h5");
        let mut reader = h5::Reader::open(&path).unwrap();
        let (header, mut events, mut chunk) = (reader.header().unwrap(), Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk).unwrap() {
            events.extend_from_slice(&chunk);
        }
        change(&mut events);
        events.sort_by_key(Event::file_order);
        fs::remove_file(&path).unwrap();
        let mut writer = h5::Writer::create(&path, &header).unwrap();
        writer.append(&events).unwrap();
        writer.finish(*self.stamps().last().unwrap()).unwrap();
    }

    /// Computes all sums again and runs `check --tree`: the exit code, and `check#part: sentence` of
    /// each finding that is a failure or a warning.
    pub(super) fn faults(&self) -> (Option<i32>, Vec<String>) {
        let (code, found) = self.findings();
        let is_unsound = |(verdict, _): &(String, String)| ["fail", "warn"].contains(&verdict.as_str());
        (code, found.into_iter().filter(is_unsound).map(|(_, text)| text).collect())
    }

    /// Computes all sums again and runs `check --tree`: the exit code, and the verdict and `check#part:
    /// sentence` of each finding.
    pub(super) fn findings(&self) -> (Option<i32>, Vec<(String, String)>) {
        // The forger writes into files, which are shared with the release.
        for name in ["manifest.json", "croissant.json", "SHA256SUMS", "B3SUMS"] {
            let bytes = fs::read(self.path().join(name)).unwrap();
            self.write(name, &bytes);
        }
        reseal(self.path());
        let output = gs2e(self.path(), &["check", "--json", "--tree", "."]);
        let text = String::from_utf8(output.stdout.clone()).unwrap();
        let records = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let found = |r: Value| {
            let of = |key: &str| r[key].as_str().unwrap().to_owned();
            let part = of("subject").split_once('#').map_or("", |(_, part)| part).to_owned();
            (of("verdict"), format!("{}#{part}: {}", of("check"), of("because")))
        };
        (output.status.code(), records.map(found).collect())
    }
}
