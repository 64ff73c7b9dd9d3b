//! Reading scene files from memory.

use super::{amount, shared};
use crate::measure::{Workload, timed};
use gs2e::scene::{Gaussians, SceneError, ply, spz};

type Reader = fn(&[u8]) -> Result<Gaussians, SceneError>;

pub(super) fn workloads() -> Vec<Workload> {
    let files: [(&str, Reader); 2] = [("playbot.spz", spz::read_spz), ("playbot_lod3.ply", ply::read_ply)];
    files.into_iter().filter_map(|(name, read)| workload(name, read)).collect()
}

fn workload(name: &'static str, read: Reader) -> Option<Workload> {
    let bytes = std::fs::read(shared(name)?).expect("the scene can be read");
    let scene = read(&bytes).expect("the scene is sound");
    let what = format!("read {name}: {} Gaussians, SH degree {}", scene.len(), scene.sh_degree);
    let run = move || timed(|| vec![amount(read(&bytes).expect("it was sound").len(), "MGaussian")]);
    Some(Workload { part: "scene", what, run: Box::new(run) })
}
