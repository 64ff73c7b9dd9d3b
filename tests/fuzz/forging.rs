//! A release whose files are mutated one at a time, with every digest rewritten, as a careful
//! forger would. The audit finds each change, except changes that it cannot know of.
//!
//! An input is a path below the release, a NUL, and the bytes of that file. A mutated path adds a
//! file.

#[path = "../it/release/forger.rs"]
#[expect(dead_code, reason = "the tables of forgeries change JSON files as well")]
mod forger;
#[path = "../it/release/unfindable.rs"]
mod unfindable;

use crate::corpus::Corpus;
use gs2e_audit::audit_release;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

/// One trajectory, as small as possible for a release with every kind of file.
const RECIPE: &str = "\
version: 1
scene: forged/scene
source:
  procedural: { kind: still-life, gaussians: 200, views: 4, arc: 4, seed: 1 }
camera: { width: 32, height: 24 }
trajectories:
  - name: base
    refine: { window: 1, factor: 3 }
sensor:
  voltmeter: { preset: dvs346 }
outputs: [events, sharp, blur, depth, flow]
blur: { frames: 3 }
sharp: { every: 6 }
depth: { every: 12 }
flow: { every: 12 }
";

struct Release {
    /// Keeps the folder alive: dropping it removes the folder.
    _folder: TempDir,
    tree: PathBuf,
    files: BTreeMap<String, Vec<u8>>,
}

fn release() -> &'static Release {
    static RELEASE: OnceLock<Release> = OnceLock::new();
    RELEASE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("recipe.yaml"), RECIPE).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(["-q", "release", "--copy", "--backend", "cpu", "--to", "out", "recipe.yaml"]);
        assert!(command.current_dir(folder.path()).status().unwrap().success(), "the release can be made");
        let tree = folder.path().join("out");
        let files = forger::read(&tree);
        Release { _folder: folder, tree, files }
    })
}

/// One file of each kind. Sums are left out, since they are rewritten.
pub(crate) fn corpus() -> Corpus {
    let own = |name: &str| format!("forged/scene/base/{name}");
    let tops = ["manifest.json", "gs2e.py", "README.md", "report.html", "croissant.json", "index.parquet"];
    let of_scene =
        ["speed.json", "poses.txt", "checks.json", "transforms.json", "events.h5", "sharp/000000.png"];
    let paths = tops.map(str::to_owned).into_iter().chain(["forged/scene/scene.json".to_owned()]);
    let paths = paths.chain(of_scene.map(own)).chain([own("depth/000000.npy")]);
    paths.map(|path| (path.clone(), input(&path, &release().files[&path]))).collect()
}

fn input(path: &str, bytes: &[u8]) -> Vec<u8> {
    [path.as_bytes(), &[0], bytes].concat()
}

/// Writes the input into the release. Returns true if the audit finds no fault.
///
/// # Panics
/// The audit misses a change that it can know of, or finds a fault in the tree as released.
pub(crate) fn read(input: &[u8]) -> bool {
    let Some((path, bytes)) = parse(input) else { return false };
    let Release { tree, files, .. } = release();
    let place = tree.join(path);
    // A path may lead into a file or to a folder: then there is nothing to forge.
    let folder = place.parent().unwrap();
    if std::fs::create_dir_all(folder).is_err() || std::fs::write(&place, bytes).is_err() {
        restore(tree, files);
        return false;
    }
    forger::reseal(tree);
    // The forger rewrites sizes and digests in the manifest.
    let bytes = &std::fs::read(&place).unwrap()[..];
    let sound = audit_release(tree).unwrap().faults.is_empty();
    let before = files.get(path).map_or(&[][..], Vec::as_slice);
    let same = files.contains_key(path) && before == bytes;
    let unknowable = unfindable::is_data(path) || unfindable::is_unfindable(path, before, bytes);
    restore(tree, files);
    assert!(!same || sound, "{path} as it was released has a fault");
    assert!(
        same || !sound || unknowable,
        "{path} was changed, and the audit found nothing:\n{}\nwas\n{}",
        difference_excerpt(bytes, before),
        difference_excerpt(before, bytes)
    );
    sound
}

/// The text of `shown` from shortly before its first difference to `other`.
fn difference_excerpt(shown: &[u8], other: &[u8]) -> String {
    let first = shown.iter().zip(other).take_while(|(a, b)| a == b).count();
    String::from_utf8_lossy(&shown[first.saturating_sub(80)..shown.len().min(first + 80)]).into_owned()
}

/// Path and bytes; `None` if the path leaves the tree or names a file of sums.
fn parse(input: &[u8]) -> Option<(&str, &[u8])> {
    let end = input.iter().position(|byte| *byte == 0)?;
    let path = std::str::from_utf8(&input[..end]).ok()?;
    let inside = Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
    let sums = ["SHA256SUMS", "B3SUMS"];
    (inside && !path.is_empty() && !path.contains('\n') && !sums.contains(&path))
        .then(|| (path, &input[end + 1..]))
}

fn restore(tree: &Path, files: &BTreeMap<String, Vec<u8>>) {
    std::fs::remove_dir_all(tree).unwrap();
    for (path, bytes) in files {
        let place = tree.join(path);
        std::fs::create_dir_all(place.parent().unwrap()).unwrap();
        std::fs::write(place, bytes).unwrap();
    }
}
