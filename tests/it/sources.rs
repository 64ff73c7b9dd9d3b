//! Captured datasets as they lie on disk: the real ones under `../shared`, and small ones with every known defect.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

use gs2e::source::{Capture, Lens, colmap, nerfstudio};
use std::path::{Path, PathBuf};

/// A path below `../shared`, or `None`, said on stderr.
#[expect(clippy::print_stderr, reason = "a test that is not run says so")]
fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("not run: ../shared is absent");
    None
}

/// Mean distance in pixels between the key points of a model and its points seen through the capture: over points (of
/// each point's mean) and over observations; and the number of points.
fn reprojection(dir: &Path) -> (f64, f64, usize) {
    let model = colmap::Model::find(dir).unwrap();
    let (capture, _) = colmap::read(dir).unwrap();
    let points = model.points().unwrap();
    let mut of_point = std::collections::BTreeMap::<u64, Vec<f64>>::new();
    for image in model.images().unwrap() {
        let view = capture.views.iter().find(|v| v.name == image.name).unwrap();
        let camera_from_world = view.world_from_camera.inverse();
        for key_point in &image.observations {
            let Some(id) = key_point.point else { continue };
            let p = camera_from_world.rotation * points[&id].xyz + camera_from_world.translation;
            let [x, y] = view.lens.distort([p.x / p.z, p.y / p.z]);
            let (u, v) = (view.camera.fx * x + view.camera.cx, view.camera.fy * y + view.camera.cy);
            of_point.entry(id).or_default().push((u - key_point.xy[0]).hypot(v - key_point.xy[1]));
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let means: Vec<f64> = of_point.values().map(|errors| mean(errors)).collect();
    (mean(&means), mean(&of_point.values().flatten().copied().collect::<Vec<_>>()), points.len())
}

#[test]
fn colmaps_points_fall_on_its_key_points() {
    for (name, views, wanted_points, wanted_px) in [("fox", 50, 6_836, 1.09), ("castle", 11, 3_822, 0.75)] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        let (capture, warnings) = colmap::read(&dir).unwrap();
        assert_eq!((capture.views.len(), warnings), (views, vec![]));
        let (px, over_observations, points) = reprojection(&dir);
        // COLMAP's own figures are printed to two digits.
        assert_eq!(points, wanted_points);
        assert!(
            (px - wanted_px).abs() < 0.005,
            "{name}: {px} px over points, {over_observations} over observations"
        );
        assert!(capture.views.iter().all(|v| v.sha256.is_some()), "every photo is there");
    }
}

#[test]
fn transforms_are_read() {
    let Some(file) = shared("scenes/playbot.transforms.json") else { return };
    let (capture, warnings) = nerfstudio::read(&file).unwrap();
    assert_eq!((capture.views.len(), warnings), (30, vec![]));
    assert!(capture.views.iter().all(|v| v.lens == Lens::Pinhole && v.sha256.is_none()));
    let (camera, warning) = Capture::camera(&capture);
    assert_eq!((camera.fx, camera.cx, camera.cy, warning), (1_483.637_806_505_496_2, 960.0, 540.0, None));
}
