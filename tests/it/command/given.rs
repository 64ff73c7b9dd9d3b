//! The input of a program: the photos in capture order, undistorted, and a COLMAP model with
//! pinhole cameras.

use super::{COPY, edit, points, runs, trained_by, views};
use crate::support::given::transforms;
use crate::support::shared::path as shared;
use crate::support::workspace::Workspace;
use glam::DVec3;
use gs2e_image::{Image, Size, png};
use gs2e_source::colmap::{ColmapModel, ColmapPoint};
use gs2e_source::undistort::undistort_photo;
use gs2e_source::{Capture, LensModel, colmap};
use std::fs;

/// A program that keeps a copy of its input in its own folder.
fn keeping() -> String {
    format!("cp -r \"$1\" \"$beside/seen\"; {COPY}")
}

fn built_input(place: &Workspace) -> (Capture, Vec<ColmapPoint>) {
    place.ok("build -q --allow-commands recipe.yaml");
    kept(place)
}

/// The input that the program kept.
fn kept(place: &Workspace) -> (Capture, Vec<ColmapPoint>) {
    let seen = place.path("seen");
    let points = ColmapModel::find_model(&seen).unwrap().points().unwrap().into_values().collect();
    (colmap::read_capture(&seen).unwrap().0, points)
}

fn names(capture: &Capture) -> Vec<&str> {
    capture.views.iter().map(|view| view.name.as_str()).collect()
}

#[test]
fn the_program_sees_the_photos_in_capture_order_with_poses_and_points() {
    let place = trained_by(&keeping());
    let (capture, found) = built_input(&place);
    let numbered = ["000000.png", "000001.png", "000002.png", "000003.png", "000004.png", "000005.png"];
    assert_eq!(names(&capture), numbered);
    assert_eq!(found, points());
    for (view, taken) in capture.views.iter().zip(views()) {
        assert_eq!((view.camera, &view.lens), (taken.camera, &LensModel::Pinhole));
        let apart = view.world_from_camera.translation - taken.world_from_camera.translation;
        // The conversion there and back costs a few roundings of numbers up to 4.
        assert!(apart.length() < 1e-14, "{}: {apart}", taken.name);
        assert!(view.world_from_camera.rotation.angle_between(taken.world_from_camera.rotation) < 1e-7);
        let bytes = |path: &str, name: &str| fs::read(place.path(path).join(name)).unwrap();
        assert_eq!(bytes("seen/images", &view.name), bytes("capture/images", &taken.name));
    }
}

#[test]
fn the_program_does_not_see_held_out_photos() {
    let place = trained_by(&keeping());
    edit(&place, "licence: MIT\n", "licence: MIT\n    hold_out: 3\n");
    let (capture, _) = built_input(&place);
    assert_eq!(names(&capture), ["000001.png", "000002.png", "000004.png", "000005.png"]);
    assert_eq!(fs::read_dir(place.path("seen/images")).unwrap().count(), 4);
}

/// The user's own photos stay unchanged even if the program writes into its copies.
#[test]
fn the_program_cannot_write_into_the_photos() {
    let script = format!("for photo in \"$1\"/images/*; do echo spoilt >> \"$photo\"; done; {COPY}");
    let place = trained_by(&script);
    let photo = place.path("capture/images/photo 9.png");
    let before = fs::read(&photo).unwrap();
    place.ok("build -q --allow-commands recipe.yaml");
    assert_eq!(fs::read(&photo).unwrap(), before);
}

#[test]
fn views_without_a_photo_are_omitted_and_reported() {
    let place = trained_by(&keeping());
    fs::remove_file(place.path("capture/images/photo 10.png")).unwrap();
    let ended = place.ok("build --allow-commands recipe.yaml");
    assert!(
        ended.stderr.contains("1 views were not used for training: their photos are missing"),
        "{}",
        ended.stderr
    );
    let (capture, _) = colmap::read_capture(&place.path("seen")).unwrap();
    assert_eq!(names(&capture), ["000000.png", "000001.png", "000003.png", "000004.png", "000005.png"]);
    fs::remove_dir_all(place.path("capture/images")).unwrap();
    let ended = place.gs2e("build --allow-commands recipe.yaml");
    assert_eq!(ended.code, 1);
    let wanted = "find a photo to train on: 6 views, 6 of them without a photo, 0 held out";
    assert!(ended.stderr.contains(wanted), "{}", ended.stderr);
    assert_eq!(runs(&place), 1);
}

#[test]
fn a_nerfstudio_capture_is_given_without_points() {
    let place = trained_by(&keeping());
    place.write("transforms.json", transforms(1.0));
    edit(&place, "colmap: { path: capture }", "nerfstudio: { path: transforms.json }");
    for i in 0..6 {
        super::photo(&place, "x.png", i);
        let bytes = fs::read(place.path("capture/images/x.png")).unwrap();
        place.write(&format!("images/{i:03}.png"), bytes);
    }
    let (capture, points) = built_input(&place);
    assert_eq!((capture.views.len(), points), (6, vec![]));
    // From an arc around the origin, at 4 units; OpenCV's axes look along z.
    let view = &capture.views[5].world_from_camera;
    assert!((view.translation.length() - 4.0).abs() < 1e-12);
    let ahead = view.rotation * DVec3::Z;
    assert!((ahead * 4.0 + view.translation).length() < 1e-12, "it looks at the origin");
}

/// The photos of a distorted lens arrive undistorted, pixel by pixel as [`undistort_photo`] makes
/// them.
#[test]
fn distorted_photos_arrive_undistorted() {
    let place = trained_by(&keeping());
    fs::remove_dir_all(place.path("capture/sparse")).unwrap();
    place.write("capture/sparse/0/cameras.txt", "1 SIMPLE_RADIAL 64 48 60 32 24 -0.25\n");
    let images: String =
        (1..=6).map(|i| format!("{i} 1 0 0 0 0.{i} 0 4 1 photo {}.png\n\n", i + 7)).collect();
    place.write("capture/sparse/0/images.txt", images);
    place.write("capture/sparse/0/points3D.txt", "1 0.5 -0.25 0.001 255 128 3 0.5\n");
    let row = |j: u8| (0..64).map(move |i: u8| [(i / 5 + j / 4) % 2 * 200, i, 7]);
    let taken = Image::from_vec(Size { width: 64, height: 48 }, (0..48).flat_map(row).collect());
    let mut bytes = Vec::new();
    png::write_image(&taken, &mut bytes).unwrap();
    place.write("capture/images/photo 8.png", bytes);
    let (capture, found) = built_input(&place);
    assert_eq!((capture.views.len(), found), (6, vec![points()[0]]));
    let (bent, _) = colmap::read_capture(&place.path("capture")).unwrap();
    assert_eq!(bent.views[0].lens, LensModel::SimpleRadial { k1: -0.25 });
    for (view, own) in capture.views.iter().zip(&bent.views) {
        assert_eq!((view.camera, &view.lens), (own.camera, &LensModel::Pinhole));
    }
    let given = fs::File::open(place.path("seen/images/000000.png")).unwrap();
    let given = png::read_rgb(std::io::BufReader::new(given)).unwrap();
    let straight = undistort_photo(&taken, &bent.views[0].camera, &bent.views[0].lens);
    assert_eq!(&given, &*straight);
    assert_ne!(given, taken, "the lens does something");
}

/// Real photos, through a real lens. The program fails after it has kept its input, since nothing else is of
/// interest: a comparison of photos of 6 megapixels would take minutes without optimisation.
#[test]
fn a_real_capture_is_given_whole() {
    let Some(castle) = shared("data/captures/castle") else { return };
    let place = trained_by("cp -r \"$1\" \"$beside/seen\"; exit 1");
    edit(&place, "path: capture", &format!("path: {}", castle.display()));
    assert_eq!(place.gs2e("build -q --allow-commands recipe.yaml").code, 1);
    let (capture, points) = kept(&place);
    assert_eq!((capture.views.len(), points.len()), (11, 3822));
    for view in &capture.views {
        let file = fs::File::open(place.path("seen/images").join(&view.name)).unwrap();
        assert_eq!(png::read_rgb(std::io::BufReader::new(file)).unwrap().size(), view.camera.size);
        assert_eq!(view.lens, LensModel::Pinhole);
    }
}
