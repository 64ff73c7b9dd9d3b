//! `gs2e export`: our own reader of each layout judges what a consumer would see of a plane in closed
//! form, and the traps of each loader.
//!
//! The measure is a log-brightness step along the consumer's own rays: for two events of a pixel, the
//! true change of the logarithm between them less polarity times threshold, in thresholds. It is small
//! only if time, pose, pixel origin, axes, intrinsics and polarity are all right.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::float_cmp,
    reason = "pixels, levels and stamps are whole and small, and written numbers are read back to the bit"
)]

mod arrays;
mod blur;
mod dsec;
mod e2nerf;
mod e_nerf;
mod evdeblurnerf;
mod event_3dgs;
mod eventnerf;
mod huggingface;
mod inceventgs;
mod included;
mod mcap;
mod networks;
mod plane;
mod refusals;
mod robust;
mod samples;
mod steps;
mod trained;

use plane::Plane;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// An export in a folder of its own.
struct TestExport {
    folder: TempDir,
}

impl TestExport {
    /// Exports the trajectory of a plane; it must succeed.
    fn of(plane: &Plane, format: &str, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let output = export(
            plane.release(),
            &folder.path().join("out"),
            format,
            &[&["--trajectory", "base"], more].concat(),
        );
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("out").join(name)
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    /// The names in a folder, sorted.
    fn list(&self, name: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(name)).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// The losses of a kind that `export.json` lists.
    fn losses(&self, kind: &str) -> Vec<String> {
        let description = self.json("export.json");
        let losses = description["losses"].as_array().unwrap().iter().filter(|loss| loss["kind"] == kind);
        losses.map(|loss| loss["field"].as_str().unwrap().to_owned()).collect()
    }
}

/// Runs `gs2e export`.
fn export(release: &Path, out: &Path, format: &str, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gs2e"));
    command.arg("export").arg(release).args(["--to", format]).arg("--out").arg(out).args(more);
    command.output().unwrap()
}
