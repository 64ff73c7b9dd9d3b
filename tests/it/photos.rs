//! Scenes from photos alone or from a video: poses by COLMAP, frames by ffmpeg. Where one of them is
//! absent, a message goes to stderr; with `REQUIRE_COLMAP=1` or `REQUIRE_FFMPEG=1` that is a failure.

mod fox;
mod planted;
mod scripted;
mod video;

use crate::support::foreign::{colmap_is_there, programs};
use crate::support::workspace::Workspace;
use gs2e_num::se3::Se3;
use gs2e_source::colmap::ColmapModel;
use gs2e_source::foreign::align::{CameraPair, pose_distances};
use gs2e_source::foreign::photos::{SolvedPhotos, solve_photos};
use gs2e_source::reconstruct::ProgramWorkspace;
use gs2e_source::solving::{PoseSolving, SolvedLens};
use planted::Corner;
use std::fs;
use std::path::{Path, PathBuf};

/// Few key points: tests match them without optimisation.
const FEATURES: u32 = 600;

/// Finds poses in a new folder.
fn solve(place: &Workspace, photos: &[(String, PathBuf)], to: &str) -> SolvedPhotos {
    let [out, folder] = [to.to_owned(), format!("{to}.workspace")].map(|name| place.path(&name));
    [&out, &folder].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let (log, programs) = (place.path("log"), programs());
    let workspace = ProgramWorkspace { folder: &folder, log: &log, goes_on: &|| true, programs: &programs };
    let solving = PoseSolving { lens: SolvedLens::Pinhole, features: FEATURES, ..PoseSolving::default() };
    solve_photos(photos, &solving, &out, workspace, &|_| {}).unwrap()
}

fn bytes_of(model: &Path) -> Vec<Vec<u8>> {
    ["cameras.bin", "images.bin", "points3D.bin"].map(|name| fs::read(model.join(name)).unwrap()).to_vec()
}

/// COLMAP's poses of photos whose poses are known. A picture of 320 px with a focal length of 300 px
/// has 0.19 degrees per pixel; poses that follow from hundreds of key points are ten times better.
#[test]
fn poses_of_photos_are_those_of_the_cameras() {
    if !colmap_is_there() {
        return;
    }
    let place = Workspace::new();
    let corner = Corner::default();
    let mut photos = corner.write_photos(&place, "photos");
    // A photo of something else, without any key point.
    photos.push(("a grey one.png".to_owned(), planted::grey(&place, "photos/grey.png", corner.size())));
    let solved = solve(&place, &photos, "model");
    let count = corner.poses.len();
    assert_eq!((solved.given, solved.models[0], solved.cameras), (count + 1, count, 1));
    assert!(solved.reprojection_px.unwrap() < 1.0, "{solved:?}");
    let model = ColmapModel::find_model(&place.path("model")).unwrap();
    let images = model.images().unwrap();
    let pair = |(stated, (name, _)): (&Se3, &(String, PathBuf))| {
        let image = images.iter().find(|image| image.name == *name).unwrap();
        let camera_from_world = Se3 { rotation: image.rotation.rotation, translation: image.translation };
        CameraPair { stated: *stated, found: camera_from_world.inverse() }
    };
    let pairs: Vec<CameraPair> = corner.poses.iter().zip(&photos).map(pair).collect();
    for (apart, (name, _)) in pose_distances(&pairs).iter().zip(&photos) {
        let degrees = apart.rotation.to_degrees();
        // The cameras are 5 units from what they see.
        assert!(degrees < 0.5 && apart.translation < 0.05, "{name}: {degrees} deg, {apart:?}");
    }
    let camera = model.cameras().unwrap().into_values().next().unwrap().camera;
    assert!((camera.fx / planted::FOCAL_PX - 1.0).abs() < 0.03, "{camera:?}");
    // The same photos give the same bytes.
    solve(&place, &photos, "again");
    assert_eq!(bytes_of(&place.path("model")), bytes_of(&place.path("again")));
}

/// From photos alone to a release, by one recipe.
#[test]
fn photos_alone_become_a_release() {
    if !colmap_is_there() {
        return;
    }
    let place = Workspace::new();
    Corner::default().write_photos(&place, "photos");
    place.write("recipe.yaml", scripted::recipe(&format!("lens: pinhole, features: {FEATURES}")));
    place.ok("release -q --to out recipe.yaml");
    place.ok("audit out");
    let scene: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("out/lab/corner/scene.json")).unwrap()).unwrap();
    assert_eq!(scene["source"]["kind"], "photos");
    assert_eq!(scene["reconstruction"]["kind"], "builtin");
    let used = scene["images"].as_array().unwrap().iter().filter(|image| image["used"] == true).count();
    assert_eq!(used, Corner::default().poses.len());
    assert_eq!(place.stale("recipe.yaml"), [""; 0]);
}
