//! Changes that must not change a path: signs, order, offset and scale.

use super::{LAW, Views, named, orbit, refined, still, try_refined};
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_trajectory::TrajectoryError;
use gs2e_trajectory::refine::{RefinePath, TranslationScale, ViewOrder};

fn changed(views: &Views, change: impl Fn(usize, Se3) -> Se3) -> Views {
    views.iter().enumerate().map(|(i, (name, pose))| (name.clone(), change(i, *pose))).collect()
}

#[test]
fn the_sign_of_a_quaternion_changes_no_bit() {
    let views = orbit(30, 0.005, 0.5, 4);
    let flipped = changed(&views, |i, p| if i % 3 == 1 { still(-p.rotation, p.translation) } else { p });
    let (a, b) =
        (refined(&views, &RefinePath::default(), LAW), refined(&flipped, &RefinePath::default(), LAW));
    assert_eq!(a, b);
    assert!(a.trajectory.world_from_camera.iter().all(|p| p.rotation.w >= 0.0));
}

#[test]
fn the_order_of_the_views_changes_no_bit() {
    let views = orbit(30, 0.005, 0.5, 5);
    // 7 and 30 share no divisor, so this visits every view. In byte order `10.jpg` would come
    // before `2.jpg`.
    let shuffled: Views = (0..30).map(|i| views[i * 7 % 30].clone()).collect();
    assert_eq!(refined(&views, &RefinePath::default(), LAW), refined(&shuffled, &RefinePath::default(), LAW));
}

#[test]
fn a_walk_with_meaningless_names_is_ordered_by_nearness() {
    let views = orbit(30, 0.0, 0.0, 6);
    let renamed: Views =
        views.iter().enumerate().map(|(i, (_, p))| (format!("{}.jpg", (30 - i) * 7 % 30), *p)).collect();
    // A greedy order needs an end of the walk as the first name: view 30 - 30 = 0 is `0.jpg`.
    assert_eq!(renamed[0].0, "0.jpg");
    let params = RefinePath { order: ViewOrder::Nearest, ..RefinePath::default() };
    let (a, b) = (refined(&views, &RefinePath::default(), LAW), refined(&renamed, &params, LAW));
    assert_eq!(a.trajectory, b.trajectory);
    // In the order of names the same views jump so far that windows have no mean.
    assert!(matches!(try_refined(&renamed, &RefinePath::default(), LAW), Err(TrajectoryError::Mean { .. })));
}

#[test]
fn an_offset_of_a_million_keeps_a_billionth_of_the_path() {
    // Centres rounded to 2^-20 and an offset of about 2^20, whose sums are exact: only the path may
    // differ.
    let grid = |v: DVec3| (v * 1_048_576.0).round() / 1_048_576.0;
    let views = changed(&orbit(30, 0.005, 0.5, 7), |_, p| still(p.rotation, grid(p.translation)));
    let offset = DVec3::new(1_048_576.0, -2_097_152.0, 1_000_000.0);
    let far = changed(&views, |_, p| still(p.rotation, p.translation + offset));
    let (a, b) = (refined(&views, &RefinePath::default(), LAW), refined(&far, &RefinePath::default(), LAW));
    assert!((a.report.length - b.report.length).abs() < 1e-12);
    for (p, q) in a.trajectory.world_from_camera.iter().zip(&b.trajectory.world_from_camera) {
        // One rounding of a coordinate of 2e6 is 2.3e-10; the path is 5.7 long, in units of 2 scene
        // units.
        assert!((p.translation + offset - q.translation).length() < 5e-10);
        assert!(relative_angle(p.rotation, q.rotation) < 1e-14);
    }
}

#[test]
fn the_scale_of_the_capture_changes_no_share() {
    let views = orbit(30, 0.005, 0.5, 8);
    let large = changed(&views, |_, p| still(p.rotation, p.translation * 1024.0));
    let (a, b) = (refined(&views, &RefinePath::default(), LAW), refined(&large, &RefinePath::default(), LAW));
    assert_eq!((a.report.scale_distance * 1024.0).to_bits(), b.report.scale_distance.to_bits());
    for (p, q) in a.trajectory.world_from_camera.iter().zip(&b.trajectory.world_from_camera) {
        assert_eq!((p.translation * 1024.0, p.rotation), (q.translation, q.rotation));
    }
    // Without D the same capture at another scale moves differently.
    let raw = RefinePath { scale: TranslationScale::None, ..RefinePath::default() };
    let (a, b) = (refined(&views, &raw, LAW), refined(&large, &raw, LAW));
    assert_ne!(a.trajectory.world_from_camera[70].rotation, b.trajectory.world_from_camera[70].rotation);
}

#[test]
fn the_scene_distance_is_that_of_the_point_looked_at() {
    let look = refined(&orbit(30, 0.0, 0.0, 9), &RefinePath::default(), LAW).report;
    assert!((look.scale_distance - (4.0f64 + 0.16).sqrt()).abs() < 1e-12);
    // Parallel axes do not meet: the largest distance between two centres is used instead.
    let views = named((0..5).map(|k| still(glam::DQuat::IDENTITY, DVec3::new(f64::from(k), 0.0, 0.0))));
    let distance = |views: &Views, params: &RefinePath| refined(views, params, LAW).report.scale_distance;
    assert!((distance(&views, &RefinePath::default()) - 4.0).abs() < 1e-12);
    // Axes that meet behind the cameras: the largest distance too.
    let outward = changed(&orbit(30, 0.0, 0.0, 9), |_, p| {
        still(
            p.rotation * gs2e_num::se3::rotation::exp_vector(DVec3::Y * std::f64::consts::PI),
            p.translation,
        )
    });
    assert!((distance(&outward, &RefinePath::default()) - 4.0).abs() < 1e-12);
    let fixed = RefinePath { scale: TranslationScale::Fixed(2.5), ..RefinePath::default() };
    assert!((distance(&views, &fixed) - 2.5).abs() < 1e-15);
}
