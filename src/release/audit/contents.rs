//! Whether a scene's files hold what their formats prescribe and what `scene.json` says of them.

mod events;
mod motion;
mod pictures;

use super::bytes::Bytes;
use super::{Code, Fault, claims};
use crate::camera::Camera;
use crate::check::{Finding, Verdict};
use crate::image::Size;
use crate::release::scene::{SceneFile, TrajectoryPart};
use rayon::prelude::*;
use std::path::Path;

/// A trajectory folder under audit.
#[derive(Debug, Clone, Copy)]
struct Folder<'a> {
    dir: &'a Path,
    path: &'a str,
    part: &'a TrajectoryPart,
    camera: Camera,
}

impl Folder<'_> {
    fn path_of(&self, name: &str) -> String {
        format!("{}/{name}", self.path)
    }

    fn fault(&self, code: Code, name: &str, message: impl Into<String>) -> Fault {
        Fault::of_file(code, &self.path_of(name), message)
    }
}

/// Audits the contents of a scene's files that are there; those that are not are faults already.
pub(super) fn scene(dir: &Path, scene: &SceneFile, bytes: &Bytes) -> Vec<Fault> {
    let part = &scene.camera;
    let size = Size { width: part.width, height: part.height };
    let camera = Camera { size, fx: part.fx, fy: part.fy, cx: part.cx, cy: part.cy };
    let mut faults = Vec::new();
    for part in &scene.trajectories {
        let path = format!("{}/{}", scene.id, part.name);
        let folder = Folder { dir, path: &path, part, camera };
        faults.extend(incomplete(&folder, scene, bytes));
        let there = |name: &&str| bytes.contains_key(&folder.path_of(name));
        let names = ["poses.txt", "events.h5", "checks.json"].into_iter().filter(there).collect::<Vec<_>>();
        let contents = names.into_par_iter().flat_map(|name| match name {
            "poses.txt" => motion::audit(&folder),
            "events.h5" => events::audit(&folder),
            _ => checks(&folder),
        });
        faults.extend(contents.collect::<Vec<_>>());
        faults.extend(pictures::audit(&folder, bytes));
    }
    faults.into_iter().map(|fault| fault.in_scene(&scene.id)).collect()
}

/// The files that the scene's own description asks for and that are not there.
fn incomplete(folder: &Folder<'_>, scene: &SceneFile, bytes: &Bytes) -> Vec<Fault> {
    let mut wanted: Vec<String> =
        ["poses.txt", "timestamps_us.txt", "transforms.json", "speed.json", "checks.json"]
            .map(str::to_owned)
            .to_vec();
    let outputs = scene.recipe.get("outputs").and_then(|outputs| outputs.as_array());
    let asked = |output: &str| outputs.is_some_and(|outputs| outputs.iter().any(|o| o == output));
    if asked("events") {
        wanted.push("events.h5".into());
    }
    if asked("sharp") {
        let every = scene.recipe.pointer("/sharp/every").and_then(serde_json::Value::as_u64).unwrap_or(1);
        let every = usize::try_from(every).unwrap_or(usize::MAX).max(1);
        wanted.extend((0..folder.part.poses).step_by(every).map(|j| format!("sharp/{j:06}.png")));
    }
    let absent = wanted.iter().filter(|name| !bytes.contains_key(&folder.path_of(name)));
    absent
        .map(|name| folder.fault(Code::SceneIncomplete, name, "the scene needs it, and it is not there"))
        .collect()
}

fn checks(folder: &Folder<'_>) -> Vec<Fault> {
    let mut faults = Vec::new();
    let findings: Option<Vec<Finding>> =
        claims::parse(folder.dir, &folder.path_of("checks.json"), &mut faults);
    let failed = findings.into_iter().flatten().filter(|finding| finding.verdict == Verdict::Fail);
    faults.extend(failed.map(|f| {
        let message = format!("{} failed: {}", f.check, f.because);
        folder.fault(Code::CheckFailedUnwaived, "checks.json", message)
    }));
    faults
}
