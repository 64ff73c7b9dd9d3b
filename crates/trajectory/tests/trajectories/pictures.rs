//! The pictures of trajectories: complete, finite, and reproducible. Their appearance was judged by
//! eye.

use super::{LAW, named, orbit, refined, still};
use glam::{DQuat, DVec3};
use gs2e_trajectory::TrajectoryBuild;
use gs2e_trajectory::picture::trajectory_svg;
use gs2e_trajectory::refine::RefinePath;
use gs2e_trajectory::travel::PoseCount;

fn picture(refined: &TrajectoryBuild) -> String {
    trajectory_svg(&refined.trajectory, &refined.report)
}

#[test]
fn a_picture_shows_frusta_path_and_speeds() {
    let got = refined(&orbit(30, 0.005, 0.5, 1), &RefinePath::default(), "0.25*sin(2*pi*t) + 1.1");
    let text = picture(&got);
    if let Ok(folder) = std::env::var("GS2E_PICTURES") {
        std::fs::write(std::path::Path::new(&folder).join("trajectory.svg"), &text).unwrap();
    }
    assert!(text.starts_with("<svg") && text.ends_with("</svg>\n"));
    assert_eq!(text, picture(&got));
    for word in ["from above", "from the side", "asked", "linear", "angular", "mixed", "62.1 ms", "1 unit<"] {
        assert!(text.contains(word), "{word}");
    }
}

#[test]
fn every_path_has_a_picture_without_nan() {
    let line = |size: f64| named((0..5).map(|k| still(DQuat::IDENTITY, DVec3::X * (size * f64::from(k)))));
    let turn =
        named((0..5).map(|k| {
            still(gs2e_num::se3::rotation::exp_vector(DVec3::Y * (0.1 * f64::from(k))), DVec3::ZERO)
        }));
    for views in [line(0.0), orbit(9, 0.0, 0.0, 1), line(1e90), line(1e-9), turn] {
        for count in [1, 2, 5000] {
            let params = RefinePath { count: PoseCount::Frames(count), ..RefinePath::default() };
            let text = picture(&refined(&views, &params, LAW));
            assert!(!text.contains("NaN") && !text.contains("inf"), "{count}");
            assert!(text.len() < 300_000, "{}", text.len());
        }
    }
}
