//! Points and their key points: planted ones with known offsets, and real models compared with
//! COLMAP's figures.

use super::shared;
use gs2e_source::colmap::{ColmapModel, ReprojectionStats};
use gs2e_testing::planted::{Camera, Image, Planted};
use std::path::Path;

/// Images at x = 0, 0.1, 0.2, … that look along z through `camera`.
fn images(observations: Vec<Vec<(f64, f64, i64)>>) -> Vec<Image> {
    let image = |(i, observations): (u32, Vec<(f64, f64, i64)>)| Image {
        id: i + 1,
        q: [1.0, 0.0, 0.0, 0.0],
        t: [-0.1 * f64::from(i), 0.0, 0.0],
        camera: 1,
        name: format!("{i}.jpg"),
        observations,
    };
    (0..).zip(observations).map(image).collect()
}

fn pinhole() -> Camera {
    let parameters = vec![500.0, 400.0, 320.0, 180.0];
    Camera { id: 1, model: (1, "PINHOLE"), size: [640, 360], parameters }
}

fn measured(planted: &Planted) -> Result<Option<ReprojectionStats>, String> {
    let dir = tempfile::tempdir().unwrap();
    planted.write_binary(dir.path());
    ColmapModel::find_model(dir.path()).unwrap().reprojection().map_err(|e| e.to_string())
}

fn close(found: f64, wanted: f64, tolerance: f64) {
    assert!((found - wanted).abs() < tolerance, "{found}, {wanted}");
}

/// Point 7 at (0, 0, 5) is seen at u = 320 - 10 i, and its key points are off by (3, 4): 5 px.
/// Point 9 at (1, 0.5, 10) is seen by the first image at (370, 200), and its key point is off by
/// (0, -1).
fn shifted() -> Planted {
    let first = vec![(323.0, 184.0, 7), (370.0, 199.0, 9), (1.0, 2.0, -1)];
    Planted {
        cameras: vec![pinhole()],
        images: images(vec![first, vec![(313.0, 184.0, 7)], vec![(303.0, 184.0, 7)]]),
        // COLMAP's own errors of these points are not used, nor are points without observations.
        points: vec![(7, [0.0, 0.0, 5.0], 0.1), (9, [1.0, 0.5, 10.0], 0.1), (11, [0.0, 0.0, 1.0], 0.1)],
    }
}

#[test]
fn points_are_as_far_off_as_they_were_shifted() {
    let found = measured(&shifted()).unwrap().unwrap();
    assert_eq!((found.points, found.observations, found.behind), (2, 4, 0));
    close(found.over_points_px, f64::midpoint(5.0, 1.0), 1e-12);
    close(found.over_observations_px, (3.0 * 5.0 + 1.0) / 4.0, 1e-12);
}

#[test]
fn the_whole_lens_counts() {
    let mut planted = shifted();
    // At (0.1, 0.05) r^2 is 0.0125: the lens moves point 9 outwards by a share of 0.1, to (375,
    // 202). Point 7 is on the axis of the first image only.
    let parameters = vec![500.0, 400.0, 320.0, 180.0, 8.0, 0.0, 0.0, 0.0];
    planted.cameras = vec![Camera { model: (4, "OPENCV"), parameters, ..pinhole() }];
    planted.images = images(vec![vec![(320.0, 180.0, 7), (375.0, 202.0, 9)]]);
    close(measured(&planted).unwrap().unwrap().over_points_px, 0.0, 1e-12);
}

#[test]
fn points_behind_the_camera_are_counted_apart() {
    let mut planted = shifted();
    planted.points[1].1 = [1.0, 0.5, -10.0];
    let found = measured(&planted).unwrap().unwrap();
    assert_eq!((found.points, found.observations, found.behind), (1, 3, 1));
    close(found.over_observations_px, 5.0, 1e-12);
}

#[test]
fn a_model_without_points_is_not_measured_and_a_false_one_is_refused() {
    let mut unseen = shifted();
    unseen.images = images(vec![vec![(1.0, 2.0, -1)]]);
    assert_eq!(measured(&unseen), Ok(None));
    let mut without = shifted();
    without.points.remove(0);
    let message = measured(&without).unwrap_err();
    assert!(message.contains("images.bin") && message.ends_with("point 7 is not in the model"), "{message}");
    let dir = tempfile::tempdir().unwrap();
    shifted().write_text(dir.path());
    std::fs::remove_file(dir.path().join("points3D.txt")).unwrap();
    assert_eq!(ColmapModel::find_model(dir.path()).unwrap().reprojection().unwrap(), None);
}

/// Compares real models with the figures that COLMAP prints for them, and with the errors that it
/// stored with their points.
#[test]
fn real_models_are_as_far_off_as_colmap_says() {
    let message = |dir: &Path| {
        let points = ColmapModel::find_model(dir).unwrap().points().unwrap();
        points.values().map(|point| point.error).sum::<f64>() / points.len() as f64
    };
    for (name, over_points, over_observations) in [("fox", 1.09, Some(1.15)), ("castle", 0.75, None)] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        let found = ColmapModel::find_model(&dir).unwrap().reprojection().unwrap().unwrap();
        eprintln!("{name}: {found:?}; its file says {:.6}", message(&dir));
        close(found.over_points_px, over_points, 0.005);
        if let Some(wanted) = over_observations {
            close(found.over_observations_px, wanted, 0.005);
        }
        // COLMAP stored the errors after its last adjustment, for the same model in 64 bits.
        close(found.over_points_px, message(&dir), 1e-3);
        assert_eq!(found.behind, 0);
    }
}
