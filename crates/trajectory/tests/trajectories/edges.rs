//! The edge cases of pipeline 2.10, each with its stated behaviour, and no NaN from any input.

use super::{LAW, Views, hertz, law, named, orbit, refined, still, timing, try_refined};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{exp_vector, relative_angle, slerp};
use gs2e_trajectory::refine::{
    EndRule, GapRule, RefinePath, RotationMean, TranslationScale, ViewOrder, refine_views,
};
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{MAX_POSES, NamedPose, PoseTiming, Trajectory, TrajectoryError, TrajectoryWarning};
use proptest::prelude::*;
use std::f64::consts::PI;

fn frames(count: u64) -> RefinePath {
    RefinePath { count: PoseCount::Frames(count), ..RefinePath::default() }
}

fn unsmoothed(count: u64) -> RefinePath {
    RefinePath { window: 0, ..frames(count) }
}

fn at(x: f64) -> Se3 {
    still(exp_vector(DVec3::new(0.0, 0.1 * x, 0.0)), DVec3::new(x, 0.0, 0.0))
}

#[test]
fn captures_without_usable_poses_are_refused_by_name() {
    assert_eq!(try_refined(&[], &RefinePath::default(), LAW), Err(TrajectoryError::NoViews));
    let mut views = orbit(9, 0.0, 0.0, 1);
    views[3].1.translation.y = f64::NAN;
    let refused = |views: &Views| try_refined(views, &RefinePath::default(), LAW).unwrap_err();
    assert_eq!(refused(&views), TrajectoryError::Centre { name: "3.jpg".to_owned() });
    views[3].1.translation.y = 1e101;
    assert_eq!(refused(&views), TrajectoryError::Centre { name: "3.jpg".to_owned() });
    views[3] = views[2].clone();
    assert_eq!(refused(&views), TrajectoryError::SameName { name: "2.jpg".to_owned() });
    views[3] = ("3.jpg".to_owned(), still(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.5), DVec3::ONE));
    assert!(matches!(refused(&views), TrajectoryError::Rotation { name, .. } if name == "3.jpg"));
    views[3].1.rotation = DQuat::from_xyzw(0.0, f64::INFINITY, 0.0, 0.5);
    assert!(matches!(refused(&views), TrajectoryError::Rotation { name, .. } if name == "3.jpg"));
    views[3].1.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.0001);
    let warnings = refined(&views, &unsmoothed(5), LAW).warnings;
    assert!(matches!(&warnings[..], [TrajectoryWarning::Projected { name, .. }, ..] if name == "3.jpg"));
}

#[test]
fn one_pose_or_equal_poses_stand_still() {
    let pose = still(exp_vector(DVec3::new(0.1, 2.0, 0.3)), DVec3::new(1.0, 2.0, 3.0));
    for views in [named([pose]), named([pose; 2]), named([pose; 7])] {
        let got = refined(&views, &frames(40), LAW);
        let poses = &got.trajectory.world_from_camera;
        assert!(poses.iter().all(|p| p == &poses[0]) && poses.len() == 40);
        assert!(
            relative_angle(poses[0].rotation, pose.rotation) < 1e-15
                && poses[0].translation == pose.translation
        );
        assert_eq!(got.warnings, [TrajectoryWarning::Still { views: views.len() }]);
        assert_eq!((got.report.length, got.report.length_ratio, got.report.mixed_ratio), (0.0, None, None));
        assert_eq!(got.report.merged.len(), usize::from(views.len() > 1));
        assert_eq!(got.report.warnings.len(), 1);
    }
}

#[test]
fn two_views_make_a_line_and_a_slerp() {
    let ends = [at(0.0), still(exp_vector(DVec3::new(0.0, 1.0, 0.2)), DVec3::new(1.0, 1.0, 0.0))];
    let got = refined(&named(ends), &unsmoothed(11), "1");
    for (j, pose) in got.trajectory.world_from_camera.iter().enumerate() {
        let share = f64::from(u32::try_from(j).unwrap()) / 10.0;
        assert!((pose.translation - ends[0].translation.lerp(ends[1].translation, share)).length() < 1e-13);
        assert!(relative_angle(pose.rotation, slerp(ends[0].rotation, ends[1].rotation, share)) < 1e-13);
    }
}

#[test]
fn three_views_make_a_parabola() {
    let corner = [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 0.0, 0.0)];
    let got = refined(&named(corner.map(|c| still(DQuat::IDENTITY, c))), &unsmoothed(101), "1");
    for pose in &got.trajectory.world_from_camera {
        let x = pose.translation.x;
        assert!((pose.translation.y - x * (2.0 - x)).abs() < 1e-13);
    }
}

#[test]
fn few_poses_start_at_the_start_and_end_at_the_end() {
    let views = orbit(12, 0.0, 0.0, 1);
    let (first, last) = (views[0].1, views[11].1);
    let ends = |count| {
        let got = refined(&views, &RefinePath { ends: EndRule::Pinned, ..frames(count) }, LAW);
        assert_eq!(got.trajectory.stamps_us[0], 0);
        assert_eq!(got.report.s.len(), usize::try_from(count).unwrap());
        got.trajectory.world_from_camera
    };
    let near = |a: &Se3, b: &Se3| {
        (a.translation - b.translation).length() < 1e-13 && relative_angle(a.rotation, b.rotation) < 1e-13
    };
    let one = ends(1);
    assert!(one.len() == 1 && near(&one[0], &first), "{one:?} {first:?}");
    for count in [2, 3, 60] {
        let poses = ends(count);
        assert!(near(&poses[0], &first) && near(&poses[poses.len() - 1], &last));
    }
    // Truncated windows pull the ends inwards: the first pose is about the mean of the first three.
    let pulled = refined(&views, &frames(60), LAW).trajectory.world_from_camera[0].translation;
    let mean = (views[0].1.translation + views[1].1.translation + views[2].1.translation) / 3.0;
    assert!((pulled - mean).length() < 1e-13);
}

#[test]
fn counts_outside_their_range_are_refused() {
    let views = orbit(9, 0.0, 0.0, 1);
    let t = |count: PoseCount| try_refined(&views, &RefinePath { count, ..RefinePath::default() }, LAW);
    assert!(matches!(t(PoseCount::Frames(0)), Err(TrajectoryError::Parameter { field: "frames", .. })));
    assert_eq!(t(PoseCount::Frames(MAX_POSES + 1)), Err(TrajectoryError::TooMany { count: 20_000_001 }));
    assert_eq!(
        t(PoseCount::Factor("5000000".parse().unwrap())),
        Err(TrajectoryError::TooMany { count: 45_000_000 })
    );
    assert!(matches!(
        t(PoseCount::Factor("999999999999999999".parse().unwrap())),
        Err(TrajectoryError::TooMany { .. })
    ));
    assert!(matches!(
        t(PoseCount::Duration("999999999999999999".parse().unwrap())),
        Err(TrajectoryError::TooMany { .. })
    ));
    let sparse = t(PoseCount::Factor("0.5".parse().unwrap())).unwrap();
    assert_eq!(sparse.trajectory.stamps_us.len(), 5);
    assert_eq!(sparse.warnings, [TrajectoryWarning::Sparse { factor: "1/2".to_owned() }]);
    for rate in ["1000001", "1/1001"] {
        let poses: Vec<NamedPose<'_>> =
            views.iter().map(|(name, p)| NamedPose { name, world_from_camera: *p }).collect();
        let refused = refine_views(
            &poses,
            &RefinePath::default(),
            PoseTiming { rate: hertz(rate), ..timing(&law(LAW)) },
        );
        assert!(matches!(refused, Err(TrajectoryError::Parameter { field: "sampling.rate", .. })), "{rate}");
    }
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let params = RefinePath { scale: TranslationScale::Fixed(scale), ..RefinePath::default() };
        let refused = try_refined(&views, &params, LAW);
        assert!(matches!(refused, Err(TrajectoryError::Parameter { field: "metric.scale", .. })), "{scale}");
    }
}

#[test]
fn repeated_poses_are_merged_and_counted() {
    let mut poses: Vec<Se3> = (0..10u32).map(|i| at(f64::from(i))).collect();
    poses.insert(4, poses[3]);
    poses.insert(5, at(3.0 + 1e-8));
    let got = refined(&named(poses.clone()), &unsmoothed(100), LAW);
    let merged = &got.report.merged;
    assert_eq!(merged.len(), 1);
    assert_eq!((&*merged[0].first, &*merged[0].last, merged[0].count), ("3.jpg", "5.jpg", 3));
    assert!(got.trajectory.world_from_camera.iter().all(Se3::is_finite));
    // The number of poses counts the views before merging.
    assert_eq!(refined(&named(poses), &RefinePath::default(), LAW).report.poses, 60);
}

#[test]
fn gaps_are_bridged_with_a_finding_or_refused() {
    let poses = (0..20u32).map(|i| at(f64::from(i) + if i >= 7 { 30.0 } else { 0.0 }));
    let views = named(poses);
    let got = refined(&views, &unsmoothed(100), LAW);
    let [gap] = &got.report.gaps[..] else { panic!("{:?}", got.report.gaps) };
    assert_eq!((&*gap.after, &*gap.before), ("6.jpg", "7.jpg"));
    assert!((gap.times_median - 31.0).abs() < 1e-9);
    assert!(matches!(&got.warnings[..], [TrajectoryWarning::Gap { .. }]));
    let refused =
        try_refined(&views, &RefinePath { gaps: GapRule::Refuse, ..unsmoothed(100) }, LAW).unwrap_err();
    assert!(matches!(&refused, TrajectoryError::Gap { after, .. } if after == "6.jpg"), "{refused}");
}

#[test]
fn a_half_turn_takes_the_axis_with_a_positive_leading_component() {
    for axis in [DVec3::Y, -DVec3::Y, DVec3::new(-0.6, 0.8, 0.0)] {
        for short in [0.0, 1e-8, 9e-7] {
            let poses =
                [still(DQuat::IDENTITY, DVec3::ZERO), still(exp_vector(axis * (PI - short)), DVec3::X)];
            let got = refined(&named(poses), &unsmoothed(3), "1");
            assert!(
                matches!(&got.warnings[..], [TrajectoryWarning::HalfTurn { after, .. }] if after == "0.jpg")
            );
            let leading = if axis.x + axis.y > 0.0 && axis.x >= 0.0 { axis } else { -axis };
            let halfway = got.trajectory.world_from_camera[1].rotation;
            assert!(relative_angle(halfway, exp_vector(leading * (PI / 2.0))) < 1e-6, "{axis} {short}");
            let end = got.trajectory.world_from_camera[2].rotation;
            assert!(relative_angle(end, poses[1].rotation) < 1e-13, "{axis} {short}");
        }
    }
}

#[test]
fn windows_wider_than_a_quarter_turn_are_refused_by_name() {
    let poses =
        (0..6u32).map(|i| still(exp_vector(DVec3::Y * (1.2 * f64::from(i))), DVec3::X * f64::from(i)));
    let refused = try_refined(&named(poses), &RefinePath::default(), LAW).unwrap_err();
    assert!(refused.to_string().starts_with("views `0.jpg`, `1.jpg`, `2.jpg`"), "{refused}");
}

#[test]
fn the_literal_rotation_mean_is_the_middle_of_the_window() {
    let views = orbit(9, 0.0, 0.0, 3);
    let params = RefinePath { rotation: RotationMean::SlerpMidpoint, ..frames(2) };
    let ends = refined(&views, &params, LAW).trajectory.world_from_camera;
    // w = 2: R_1 at the left end, and its mirror image at the right.
    assert!(relative_angle(ends[0].rotation, views[1].1.rotation) < 1e-15);
    assert!(relative_angle(ends[1].rotation, views[7].1.rotation) < 1e-15);
}

#[test]
fn wild_speeds_are_reported_with_their_largest_turn() {
    let got = refined(&orbit(30, 0.0, 0.0, 1), &frames(200), "exp(9.3*t)");
    let [TrajectoryWarning::SpeedRange { ratio, degrees }] = got.warnings[..] else {
        panic!("{:?}", got.warnings)
    };
    // The last of 199 steps starts at t = 198/199.
    assert!((ratio - (9.3f64 * 198.0 / 199.0).exp()).abs() < 1e-6 * ratio, "{ratio}");
    assert!((degrees - got.report.max_step_deg).abs() < 1e-12 && degrees > 5.0);
    let follow = got.report.mixed_ratio.unwrap();
    assert!(follow.min > 1.0 - 1e-6 && follow.max < 1.0 + 1e-6, "{follow:?}");
    let cornered = refined(&orbit(30, 0.0, 0.0, 1), &frames(20), "max(t, 0.5)");
    assert!(
        matches!(&cornered.warnings[..], [TrajectoryWarning::Rough { because }] if because == "it uses max")
    );
}

#[test]
fn steps_of_any_size_in_one_path_are_followed() {
    // From 1e-5 to 1e6 of the median: nearer poses would merge.
    let xs = [0.0, 1e-5, 1.0, 2.0, 3.0, 4.0, 5.0, 1e6, 1e6 + 1.0];
    let got = refined(&named(xs.map(|x| still(DQuat::IDENTITY, DVec3::X * x))), &unsmoothed(1000), LAW);
    assert!(got.trajectory.world_from_camera.iter().all(Se3::is_finite));
    assert_eq!(got.report.gaps.len(), 1);
    let follow = got.report.mixed_ratio.unwrap();
    assert!(follow.min > 1.0 - 1e-6 && follow.max < 1.0 + 1e-6, "{follow:?}");
}

/// Returns true if every number of a report is finite: JSON has no other numbers, and writes NaN as
/// null.
pub(super) fn is_finite(report: &gs2e_trajectory::report::SpeedReport) -> bool {
    let text = serde_json::to_string(report).unwrap();
    serde_json::from_str::<gs2e_trajectory::report::SpeedReport>(&text).is_ok_and(|read| &read == report)
}

pub(super) fn sound(trajectory: &Trajectory) -> bool {
    let unit = |q: DQuat| (q.length_squared() - 1.0).abs() < 1e-14 && q.w >= 0.0;
    trajectory.world_from_camera.iter().all(|p| p.is_finite() && unit(p.rotation))
        && trajectory.stamps_us[0] == 0
        && trajectory.stamps_us.windows(2).all(|w| w[0] < w[1])
        && trajectory.stamps_us.len() == trajectory.world_from_camera.len()
}

/// A view's centre and rotation vector: small walks, repeats, leaps over all magnitudes.
pub(super) fn wild_pose() -> impl Strategy<Value = Se3> {
    let size = prop_oneof![3 => Just(1.0), 1 => Just(0.0), 1 => Just(1e-9), 1 => Just(1e-200), 1 => Just(1e6), 1 => Just(1e90)];
    let turn = prop_oneof![3 => Just(0.2), 1 => Just(0.0), 1 => Just(1e-9), 1 => Just(PI), 1 => Just(20.0)];
    (prop::array::uniform3(-1.0..1.0f64), prop::array::uniform3(-1.0..1.0f64), size, turn).prop_map(
        |(c, r, size, turn)| still(exp_vector(DVec3::from_array(r) * turn), DVec3::from_array(c) * size),
    )
}

fn parameters() -> impl Strategy<Value = RefinePath> {
    let count = prop_oneof![
        (1..60u64).prop_map(PoseCount::Frames),
        (1..40u64, 1..9u64).prop_map(|(a, b)| PoseCount::Factor(gs2e_num::units::Ratio::new(a, b).unwrap())),
    ];
    let scale = prop_oneof![
        Just(TranslationScale::Scene),
        Just(TranslationScale::None),
        Just(TranslationScale::Fixed(1e-300)),
        Just(TranslationScale::Fixed(1e300)),
        Just(TranslationScale::Fixed(0.1)),
    ];
    (0..4u32, count, scale, prop::array::uniform4(any::<bool>())).prop_map(|(window, count, scale, b)| {
        RefinePath {
            window,
            count,
            scale,
            order: if b[0] { ViewOrder::Name } else { ViewOrder::Nearest },
            rotation: if b[1] { RotationMean::Mean } else { RotationMean::SlerpMidpoint },
            ends: if b[2] { EndRule::Truncated } else { EndRule::Pinned },
            literal: b[3],
            ..RefinePath::default()
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]
    #[test]
    fn no_input_makes_a_nan(
        poses in prop::collection::vec(wild_pose(), 1..9),
        params in parameters(),
        law in prop::sample::select(&[LAW, "1", "1e-300 + t^9", "1e300", "exp(600*t)", "exp(-600*t)", "2 + sin(90*t)"][..]),
    ) {
        match try_refined(&named(poses), &params, law) {
            Ok(got) => prop_assert!(sound(&got.trajectory) && is_finite(&got.report), "{:?}", got),
            Err(refused) => prop_assert!(!refused.to_string().contains("NaN"), "{refused}"),
        }
    }
}
