//! A small release, made by the program itself, and helpers that change and reseal it.

pub(crate) use super::forger::{edit, read, reseal, resum};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Two trajectories of 24 poses over 2,000 Gaussians, at 64x48, with events and pictures of every
/// kind.
pub(crate) const RECIPE: &str = "\
version: 1
scene: small/one
seed: 7
source:
  procedural: { kind: still-life, gaussians: 2000, views: 6, arc: 8, seed: 1 }
camera: { width: 64, height: 48 }
trajectories:
  - name: base
    refine: { window: 1, factor: 4 }
  - name: slow
    refine: { window: 1, factor: 6 }
    speed: { function: \"1 + t\" }
sensor:
  voltmeter: { preset: dvs346 }
outputs: [events, sharp, blur, depth, flow]
sharp: { every: 4 }
depth: { every: 12 }
flow: { every: 12 }
";

/// Runs the program in `folder`.
pub(crate) fn gs2e(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gs2e")).args(arguments).current_dir(folder).output().unwrap()
}

/// A run's output as text, for messages of tests.
pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The release of [`RECIPE`], made once and never changed.
pub(crate) fn release() -> &'static Path {
    static RELEASE: OnceLock<TempDir> = OnceLock::new();
    let folder = RELEASE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("small.yaml"), RECIPE).unwrap();
        let output = gs2e(folder.path(), &["release", "--copy", "--to", "out", "small.yaml"]);
        assert!(output.status.success(), "{}", said(&output));
        folder
    });
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    PATH.get_or_init(|| folder.path().join("out"))
}

/// A copy of the release, to be damaged.
pub(crate) fn copy() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (path, bytes) in read(release()) {
        let target = folder.path().join(path);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, bytes).unwrap();
    }
    folder
}
