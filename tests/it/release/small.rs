//! A small release, made by the program itself, and a second hand that can reseal it.

use serde_json::Value;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Two trajectories of 24 poses over 2,000 Gaussians, at 64x48, with events and pictures of every kind.
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

/// What a run wrote for people, for messages of tests.
pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The release of [`RECIPE`], made once: nobody changes it.
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

/// A copy of it to be damaged.
pub(crate) fn copy() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (path, bytes) in read(release()) {
        let target = folder.path().join(path);
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::write(target, bytes).unwrap();
    }
    folder
}

/// All files below a folder by path.
pub(crate) fn read(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = walkdir::WalkDir::new(folder).into_iter().map(Result::unwrap);
    let files = files.filter(|entry| entry.file_type().is_file());
    let below = |path: &Path| path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
    files.map(|entry| (below(entry.path()), std::fs::read(entry.path()).unwrap())).collect()
}

/// Writes `manifest.json`, `B3SUMS` and `SHA256SUMS` anew, as one would who tampers with a release and covers it up.
pub(crate) fn reseal(folder: &Path) {
    let mut files = read(folder);
    files.remove("SHA256SUMS");
    files.remove("B3SUMS");
    let manifest = files.remove("manifest.json").unwrap();
    let mut manifest: Value = serde_json::from_slice(&manifest).unwrap();
    let listed = |files: &mut BTreeMap<String, Vec<u8>>, of: &dyn Fn(&str) -> bool| -> Value {
        let names: Vec<String> = files.keys().filter(|path| of(path)).cloned().collect();
        let entry = |path: String| {
            let bytes = files.remove(&path).unwrap();
            let blake3 = blake3::hash(&bytes).to_hex().to_string();
            serde_json::json!({ "path": path, "size": bytes.len(), "blake3": blake3 })
        };
        names.into_iter().map(entry).collect()
    };
    for scene in manifest["scenes"].as_array_mut().unwrap() {
        let prefix = format!("{}/", scene["id"].as_str().unwrap());
        scene["files"] = listed(&mut files, &|path| path.starts_with(&prefix));
    }
    manifest["files"] = listed(&mut files, &|_| true);
    std::fs::write(folder.join("manifest.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let listed = read(folder).into_iter().filter(|(path, _)| path != "B3SUMS" && path != "SHA256SUMS");
    let line = |(path, bytes): (String, Vec<u8>)| format!("{}  {path}\n", blake3::hash(&bytes).to_hex());
    std::fs::write(folder.join("B3SUMS"), listed.map(line).collect::<String>()).unwrap();
    resum(folder);
}

/// Writes `SHA256SUMS` anew.
pub(crate) fn resum(folder: &Path) {
    let files = read(folder).into_iter().filter(|(path, _)| path != "SHA256SUMS");
    let hex = |bytes: &[u8]| Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect::<String>();
    let text: String = files.map(|(path, bytes)| format!("{}  {path}\n", hex(&bytes))).collect();
    std::fs::write(folder.join("SHA256SUMS"), text).unwrap();
}

/// Changes a JSON file.
pub(crate) fn edit(folder: &Path, path: &str, change: impl FnOnce(&mut Value)) {
    let path = folder.join(path);
    let mut value: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut value);
    std::fs::write(path, serde_json::to_vec_pretty(&value).unwrap()).unwrap();
}
