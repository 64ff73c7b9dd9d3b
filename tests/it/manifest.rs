//! Compares the demo's committed manifest with a fresh build, digest by digest, since there is one numerical
//! class. The test runs an unoptimised program, the manifest comes from an optimised build: equal digests
//! also show that no optimisation changes a bit. It is the README's first command, whose second run makes
//! nothing.

use gs2e_release::{ManifestScene, ReleaseManifest};
use std::path::Path;
use std::process::Command;

fn read(path: &Path) -> ReleaseManifest {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// The differences between two scenes, one line each. The first differing steps show the cause.
fn differences(fresh: &ManifestScene, committed: &ManifestScene) -> Vec<String> {
    let mut lines = Vec::new();
    for (a, b) in fresh.steps.iter().zip(&committed.steps) {
        if a.key != b.key {
            lines.push(format!("{}: key {} was {}", a.step, a.key, b.key));
        }
        let changed = a.outputs.iter().zip(&b.outputs).filter(|(a, b)| a != b).count();
        if changed > 0 || a.outputs.len() != b.outputs.len() {
            lines.push(format!("{}: {changed} of {} outputs differ", a.step, a.outputs.len()));
        }
    }
    lines
}

#[test]
fn a_fresh_demo_is_the_committed_one() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let readme = std::fs::read_to_string(root.join("README.md")).unwrap();
    assert!(readme.lines().any(|line| line == "cargo run --release -- release --to out recipes/demo.yaml"));
    let release = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
        command.args(["release", "--to"]).arg(&out).arg("recipes/demo.yaml");
        command.arg("--store").arg(folder.path().join("store"));
        let ended = command.current_dir(root).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert!(ended.status.success(), "{said}");
        said
    };
    release();
    let second = release();
    assert!(second.lines().any(|line| line.starts_with("0 steps built,")), "{second}");
    let [fresh, committed] =
        [out.join("manifest.json"), root.join("manifests/demo.json")].map(|path| read(&path));
    let lines: Vec<String> =
        fresh.scenes.iter().zip(&committed.scenes).flat_map(|(a, b)| differences(a, b)).collect();
    assert!(
        lines.is_empty(),
        "the demo changed; `cargo xtask manifest` commits it anew:\n{}",
        lines.join("\n")
    );
    assert_eq!(fresh, committed);
}
