//! COLMAP's own figures for real models, compared with the values that are read here.

use super::shared;
use gs2e_source::colmap;
use gs2e_testing::absent::absent;
use std::path::Path;
use std::process::Command;

/// The output of COLMAP with these arguments. If COLMAP is absent, the test is reported as not run
/// and this is `None`.
fn run(arguments: &[&str]) -> Option<String> {
    match Command::new("colmap").args(arguments).output() {
        Ok(output) => {
            assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
            // The version of COLMAP decides which of the two its log goes to.
            Some(String::from_utf8([output.stdout, output.stderr].concat()).unwrap())
        }
        Err(error) => {
            absent("REQUIRE_COLMAP", &format!("COLMAP is absent: {error}"));
            None
        }
    }
}

/// The poses of a text export: name, quaternion w x y z and translation, world to camera.
fn exported(dir: &Path) -> Vec<(String, [f64; 7])> {
    let text = std::fs::read_to_string(dir.join("images.txt")).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    let pose = |line: &&str| {
        let words: Vec<&str> = line.split(' ').collect();
        (words[9].to_owned(), std::array::from_fn(|i| words[i + 1].parse().unwrap()))
    };
    // Every second line holds key points.
    lines.iter().step_by(2).map(pose).collect()
}

#[test]
fn poses_are_those_of_colmaps_own_export() {
    for name in ["fox", "castle"] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        let model = dir.join("sparse/0");
        let out = tempfile::tempdir().unwrap();
        let [from, to] = [&model, out.path()].map(|path: &Path| path.to_str().unwrap().to_owned());
        let arguments =
            ["model_converter", "--input_path", &from, "--output_path", &to, "--output_type", "TXT"];
        if run(&arguments).is_none() {
            return;
        }
        let (capture, _) = colmap::read_capture(&dir).unwrap();
        let exported = exported(out.path());
        assert_eq!(exported.len(), capture.views.len());
        for (image, [w, x, y, z, t @ ..]) in exported {
            let view = capture.views.iter().find(|view| view.name == image).unwrap();
            let found = view.world_from_camera.inverse();
            let q = found.rotation;
            let sign = (q.w * w + q.x * x + q.y * y + q.z * z).signum();
            // The text has 17 digits. The conversion there and back through the camera's centre
            // costs a few roundings of numbers up to 10.
            for (found, wanted) in [(q.w, w), (q.x, x), (q.y, y), (q.z, z)] {
                assert!((sign * found - wanted).abs() < 1e-15, "{image}: {q} for {w} {x} {y} {z}");
            }
            for (found, wanted) in found.translation.to_array().into_iter().zip(t) {
                assert!((found - wanted).abs() < 1e-14, "{image}: {found} for {wanted}");
            }
        }
    }
}

#[test]
fn the_reprojection_error_equals_that_of_colmap() {
    for name in ["fox", "castle"] {
        let Some(dir) = shared(&format!("captures/{name}")) else { return };
        let model = dir.join("sparse/0");
        let Some(said) = run(&["model_analyzer", "--path", model.to_str().unwrap()]) else { return };
        let number = said.split("Mean reprojection error: ").nth(1).unwrap().split("px").next().unwrap();
        let wanted: f64 = number.parse().unwrap();
        let (found, _, _) = super::models::reprojection(&dir);
        // COLMAP prints six digits after the point.
        assert!((found - wanted).abs() < 1e-6, "{name}: {found} px, COLMAP has {wanted}");
    }
}
