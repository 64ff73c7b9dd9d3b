//! Real captures, if `../shared` is there: hand-held photos and the key views of captured scenes.

use super::{LAW, Views, refined};
use glam::{DMat3, DVec3};
use gs2e_num::se3::{OPENCV_FROM_OPENGL, Se3, rotation_from_matrix};
use gs2e_trajectory::knots::CaptureGap;
use gs2e_trajectory::refine::RefinePath;
use gs2e_trajectory::travel::PoseCount;
use serde::Deserialize;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct Transforms {
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
}

fn data(name: &str) -> Option<PathBuf> {
    gs2e_testing::shared::path(&format!("data/{name}"))
}

fn views(path: &Path) -> Views {
    let read: Transforms = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let pose = |m: [[f64; 4]; 4]| {
        let rows = [0, 1, 2].map(|i| DVec3::new(m[i][0], m[i][1], m[i][2]));
        let axes = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
            * DMat3::from_diagonal(OPENCV_FROM_OPENGL);
        let rotation = rotation_from_matrix(&axes).unwrap().rotation;
        Se3 { rotation, translation: DVec3::new(m[0][3], m[1][3], m[2][3]) }
    };
    read.frames.into_iter().map(|f| (f.file_path, pose(f.transform_matrix))).collect()
}

#[test]
fn real_captures_are_followed() {
    for name in
        ["captures/fox/transforms.json", "scenes/playbot.transforms.json", "scenes/plant.transforms.json"]
    {
        let Some(path) = data(name) else { return };
        for window in [0, 2] {
            let views = views(&path);
            let got = refined(&views, &RefinePath { window, ..RefinePath::default() }, LAW);
            let report = &got.report;
            assert_eq!(report.poses, 5 * views.len());
            let (arc, chord) = (report.mixed_ratio.unwrap(), report.mixed_chord_ratio.unwrap());
            eprintln!(
                "{name}, window {window}: D {:.3}, S {:.3}, length ratio {:.5}",
                report.scale_distance,
                report.length,
                report.length_ratio.unwrap()
            );
            eprintln!(
                "  chord {chord:.4?}\n  linear {:.3?}\n  angular {:.3?}",
                report.linear_ratio.unwrap(),
                report.angular_ratio.unwrap()
            );
            eprintln!(
                "  largest turn {:.2} deg, change {:.3}, {:?}",
                report.max_step_deg, report.max_step_change, got.warnings
            );
            assert!(arc.min > 1.0 - 1e-9 && arc.max < 1.0 + 1e-9, "{arc:?}");
            // Chords fall short of arcs where a hand-held path turns sharply; elsewhere they are
            // close.
            assert!(chord.min > 0.85 && chord.max < 1.01 && chord.rms < 0.02, "{chord:?}");
            // The photos between these two did not register.
            let gap = |g: &CaptureGap| g.after == "images/0054.jpg" && g.before == "images/0068.jpg";
            assert_eq!(report.gaps.iter().any(gap), name.contains("fox"));
        }
    }
}

#[test]
fn a_long_path_of_a_real_capture_is_followed() {
    let Some(path) = data("captures/fox/transforms.json") else { return };
    let got = refined(
        &views(&path),
        &RefinePath { count: PoseCount::Frames(20_000), ..RefinePath::default() },
        LAW,
    );
    let (arc, chord) = (got.report.mixed_ratio.unwrap(), got.report.mixed_chord_ratio.unwrap());
    assert!(
        arc.min > 1.0 - 1e-9 && arc.max < 1.0 + 1e-9 && chord.min > 0.999 && chord.max < 1.001,
        "{arc:?} {chord:?}"
    );
}
