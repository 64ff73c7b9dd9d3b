//! Reading scene files from memory.

use super::{amount, shared};
use crate::measure::{Workload, timed};
use gs2e_demo as procedural;
use gs2e_demo::StillLife;
use gs2e_scene::form::SceneFormat;
use gs2e_scene::{Gaussians, SceneError, ply, spz};
use std::path::Path;

type Reader = fn(&[u8]) -> Result<Gaussians, SceneError>;

pub(super) fn workloads() -> Vec<Workload> {
    let mut file = Vec::new();
    let scene = procedural::still_life(&StillLife::default());
    ply::write_ply(&scene, &mut file).expect("memory can be written");
    let own = workload("the still life as .ply", file, ply::read_ply);
    let real = shared("playbot.spz").map(|path| {
        let file = std::fs::read(path).expect("the scene can be read");
        workload("playbot.spz", file, spz::read_spz)
    });
    [Some(own), real, shared("playbot.spz").map(|path| written(&path))].into_iter().flatten().collect()
}

fn workload(name: &str, bytes: Vec<u8>, read: Reader) -> Workload {
    let scene = read(&bytes).expect("the scene is sound");
    let what = format!("read {name}: {} Gaussians, SH degree {}", scene.len(), scene.sh_degree);
    let run = move || timed(|| vec![amount(read(&bytes).expect("it was sound").len(), "MGaussian")]);
    Workload { part: "scene", what, rival: false, run: Box::new(run) }
}

/// Writing as `.spz`, including the measurement of the loss.
fn written(path: &Path) -> Workload {
    let file = std::fs::read(path).expect("the scene can be read");
    let scene = spz::read_spz(&file).expect("the scene is sound");
    let what = format!("write playbot.spz as .spz and compare: {} Gaussians", scene.len());
    let run = move || {
        timed(|| {
            SceneFormat::Spz.write(&scene).expect("it fits");
            vec![amount(scene.len(), "MGaussian")]
        })
    };
    Workload { part: "scene", what, rival: false, run: Box::new(run) }
}
