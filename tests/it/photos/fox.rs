//! The poses of a hand-held capture from its photos alone, compared with those of the COLMAP model
//! that it came with. The given model has other key points and a refinement of its own, so the
//! difference of the two is what COLMAP's poses are worth.

use super::{colmap_is_there, programs};
use crate::support::absent::runs_slow_tests;
use crate::support::shared;
use crate::support::workspace::Workspace;
use gs2e_num::se3::Se3;
use gs2e_source::colmap::ColmapModel;
use gs2e_source::foreign::align::{CameraPair, pose_distances};
use gs2e_source::foreign::photos::solve_photos;
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_source::solving::PoseSolving;
use std::fs;
use std::path::{Path, PathBuf};

/// `RUN_SLOW_TESTS=1 cargo test --release --test it -- --nocapture photos::fox`
#[test]
fn poses_from_photos_alone_are_those_of_the_given_model() {
    if !runs_slow_tests() {
        return;
    }
    let Some(capture) = shared::path("data/captures/fox").filter(|_| colmap_is_there()) else { return };
    let place = Workspace::new();
    let [out, folder] = ["model", "desk"].map(|name| place.path(name));
    [&out, &folder].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let (log, programs) = (place.path("log"), programs());
    let workspace = ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| true, programs: &programs };
    let photos = photos_of(&capture.join("images"));
    let solved = solve_photos(&photos, &PoseSolving::default(), &out, workspace, &|_| {}).unwrap();
    eprintln!("fox: {} of {} photos, {:?} px", solved.models[0], solved.given, solved.reprojection_px);
    assert_eq!(solved.models[0], photos.len());
    let [rotations, positions] = differences(&out, &capture.join("sparse/0"));
    let [median, worst] = median_and_worst(rotations);
    eprintln!("fox: rotation {median:.4} deg in the median, {worst:.4} at most");
    // Key points have errors of about 1 px, and 1 px is 0.04 degrees here. Hundreds of them per
    // photo leave a tenth; what is left is the difference of two lens models.
    assert!(median < 0.1 && worst < 0.5, "{median} {worst}");
    let [median, worst] = median_and_worst(positions);
    eprintln!("fox: position {median:.4} % of the cameras' spread in the median, {worst:.4} % at most");
    assert!(median < 0.5 && worst < 2.0, "{median} {worst}");
}

fn photos_of(folder: &Path) -> Vec<(String, PathBuf)> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
    let mut photos: Vec<(String, PathBuf)> = paths.map(|path| (name(&path), path)).collect();
    photos.sort();
    photos
}

/// Differences of the poses that two models have in common, after the best similarity: of the
/// rotations in degrees, and of the positions in percent of the cameras' spread, their root mean
/// square distance from their mean.
fn differences(found: &Path, given: &Path) -> [Vec<f64>; 2] {
    let [found, given] = [found, given].map(|path| ColmapModel::find_model(path).unwrap().images().unwrap());
    let pose = |image: &gs2e_source::colmap::ColmapImage| {
        Se3 { rotation: image.rotation.rotation, translation: image.translation }.inverse()
    };
    let pair = |stated: &gs2e_source::colmap::ColmapImage| {
        let found = found.iter().find(|image| image.name == stated.name)?;
        Some(CameraPair { stated: pose(stated), found: pose(found) })
    };
    let pairs: Vec<CameraPair> = given.iter().filter_map(pair).collect();
    assert_eq!(pairs.len(), given.len(), "every photo has a pose in both models");
    let centres = || pairs.iter().map(|pair| pair.stated.translation);
    let mean = centres().sum::<glam::DVec3>() / pairs.len() as f64;
    let square = centres().map(|centre| (centre - mean).length_squared()).sum::<f64>();
    let spread = (square / pairs.len() as f64).sqrt();
    let apart = pose_distances(&pairs);
    [
        apart.iter().map(|apart| apart.rotation.to_degrees()).collect(),
        apart.iter().map(|apart| 100.0 * apart.translation / spread).collect(),
    ]
}

fn median_and_worst(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values[values.len() / 2], values[values.len() - 1]]
}
