//! Mini-trajectories between key poses that are drawn from a dense trajectory.

use super::edges::{is_finite, sound, wild_pose};
use super::{LAW, law, orbit, refined, still, timing};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::{exp_vector, relative_angle};
use gs2e_num::seed::Seed;
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::novel::{BaseTrajectory, GroupCurve, NovelGroup};
use gs2e_trajectory::path::{CameraPath, PathInputs};
use gs2e_trajectory::refine::RefinePath;
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{CourseKind, TrajectoryBuild, TrajectoryError, TrajectoryWarning};
use proptest::prelude::*;

/// The paper's numbers: 3 groups of 5 key poses, 150 poses each.
const NOVEL: NovelGroup = NovelGroup {
    group: 0,
    groups: 3,
    keyframes: 5,
    count: PoseCount::Frames(150),
    curve: GroupCurve::Any,
    literal: false,
    keyframes_seed: Seed(11),
    curve_seed: Seed(12),
};

fn try_made(novel: &NovelGroup, poses: &[Se3], scale: f64) -> Result<TrajectoryBuild, TrajectoryError> {
    let ground = PathInputs { views: &[], base: Some(BaseTrajectory { poses, scale }), scene: None };
    CameraPath::Novel(novel.clone()).make(ground, timing(&law("1")), None)
}

fn made(novel: &NovelGroup, base: &TrajectoryBuild) -> TrajectoryBuild {
    try_made(novel, &base.trajectory.world_from_camera, base.report.scale_distance).unwrap()
}

fn dense() -> TrajectoryBuild {
    refined(&orbit(30, 0.005, 0.5, 1), &RefinePath::default(), LAW)
}

fn near(a: &Se3, b: &Se3) -> bool {
    (a.translation - b.translation).length() < 1e-13 && relative_angle(a.rotation, b.rotation) < 1e-13
}

#[test]
fn groups_run_between_their_own_key_poses_at_a_constant_pace() {
    let base = dense();
    let mut seen = Vec::new();
    for group in 0..3 {
        let got = made(&NovelGroup { group, ..NOVEL }, &base);
        let (report, poses) = (&got.report, &got.trajectory.world_from_camera);
        let keys = &report.keyframes;
        assert_eq!(
            (report.kind, keys.len(), keys.is_sorted(), poses.len()),
            (CourseKind::Novel, 5, true, 150)
        );
        let of = |k: usize| &base.trajectory.world_from_camera[keys[k]];
        assert!(near(&poses[0], of(0)) && near(&poses[149], of(4)));
        assert_eq!((got.trajectory.stamps_us[0], got.trajectory.stamps_us[149]), (0, 62_083));
        assert_eq!(report.scale_distance.to_bits(), base.report.scale_distance.to_bits());
        let follow = report.mixed_ratio.unwrap();
        assert!(follow.min > 1.0 - 1e-6 && follow.max < 1.0 + 1e-6, "{follow:?}");
        // Uniform targets: l * s / (F - 1).
        let target = |l: usize| report.length * l as f64 / 149.0;
        assert!(report.s.iter().enumerate().all(|(l, s)| (s - target(l)).abs() < 1e-14 * report.length));
        assert!(
            report.knot_jumps.is_some_and(|j| j.c0.max(j.c1).max(j.c2) < 1e-6),
            "{:?}",
            report.knot_jumps
        );
        assert!(got.warnings.is_empty() && report.merged.is_empty() && report.gaps.is_empty());
        seen.extend_from_slice(keys);
    }
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 15);
}

#[test]
fn drawn_curves_are_reported_with_the_degree_that_was_used() {
    let base = dense();
    let mut degrees = Vec::new();
    for group in 0..40 {
        let got = made(&NovelGroup { group, groups: 40, keyframes: 3, ..NOVEL }, &base).report;
        match (got.curve, got.degree_drawn, got.degree_used) {
            (Some(CurveKind::Cubic), None, None) => assert!(got.knot_distance.unwrap() < 1e-12),
            (Some(CurveKind::Bezier { degree }), Some(drawn), Some(2)) if degree == drawn => {
                // Three key poses determine degree 2, which passes them.
                assert!(got.knot_distance.unwrap() < 1e-12, "{:?}", got.knot_distance);
                degrees.push(drawn);
            }
            other => panic!("{other:?}"),
        }
    }
    degrees.sort_unstable();
    degrees.dedup();
    assert_eq!(degrees, [2, 3, 4, 5]);
}

#[test]
fn a_given_curve_is_used() {
    let base = dense();
    let curves =
        [CurveKind::Cubic, CurveKind::Cumulative, CurveKind::SlerpLerp, CurveKind::Bezier { degree: 3 }];
    let keys = made(&NOVEL, &base).report.keyframes;
    for curve in curves {
        let got = made(&NovelGroup { curve: GroupCurve::Fixed(curve), ..NOVEL }, &base).report;
        assert_eq!((got.curve, got.degree_drawn, &got.keyframes), (Some(curve), None, &keys));
    }
    let high = NovelGroup { curve: GroupCurve::Fixed(CurveKind::Bezier { degree: 21 }), ..NOVEL };
    let poses = &base.trajectory.world_from_camera;
    assert!(matches!(
        try_made(&high, poses, 1.0),
        Err(TrajectoryError::Parameter { field: "bezier.degree", .. })
    ));
}

#[test]
fn seeds_are_all_that_a_draw_depends_on() {
    let base = dense();
    let a = made(&NOVEL, &base);
    assert_eq!(a, made(&NOVEL, &base));
    let other_curve = made(&NovelGroup { curve_seed: Seed(99), ..NOVEL }, &base);
    assert_eq!(a.report.keyframes, other_curve.report.keyframes);
    let other_keys = made(&NovelGroup { keyframes_seed: Seed(99), ..NOVEL }, &base);
    assert_eq!(a.report.curve, other_keys.report.curve);
    assert_ne!(a.report.keyframes, other_keys.report.keyframes);
    // The draw depends on the group's index, not on the number of groups.
    let more = made(&NovelGroup { groups: 9, ..NOVEL }, &base);
    assert_eq!(a.trajectory, more.trajectory);
}

#[test]
fn one_frame_is_the_first_key_pose() {
    let base = dense();
    let got = made(&NovelGroup { count: PoseCount::Frames(1), ..NOVEL }, &base);
    assert_eq!(got.trajectory.stamps_us, [0]);
    let first = &base.trajectory.world_from_camera[got.report.keyframes[0]];
    assert!(near(&got.trajectory.world_from_camera[0], first));
}

#[test]
fn two_key_poses_make_a_line_and_a_slerp_for_every_curve() {
    let base = dense();
    for degree in 1..=20 {
        let novel =
            NovelGroup { keyframes: 2, curve: GroupCurve::Fixed(CurveKind::Bezier { degree }), ..NOVEL };
        let got = made(&novel, &base);
        assert_eq!((got.report.degree_used, got.warnings.len()), (Some(1), 0));
        let poses = &got.trajectory.world_from_camera;
        let share = 49.0 / 149.0;
        let line = poses[0].translation.lerp(poses[149].translation, share);
        assert!((poses[49].translation - line).length() < 1e-12);
        let turned = gs2e_num::se3::rotation::slerp(poses[0].rotation, poses[149].rotation, share);
        assert!(relative_angle(poses[49].rotation, turned) < 1e-12);
    }
}

#[test]
fn equal_key_poses_stand_still() {
    let pose = still(exp_vector(DVec3::new(0.3, -0.2, 1.0)), DVec3::new(5.0, 6.0, 7.0));
    let got = try_made(&NOVEL, &[pose; 20], 2.0).unwrap();
    assert_eq!(got.warnings, [TrajectoryWarning::Still { views: 5 }]);
    assert!(got.trajectory.world_from_camera.iter().all(|p| near(p, &pose)));
    assert_eq!((got.trajectory.world_from_camera.len(), got.report.degree_used), (150, None));
}

#[test]
fn impossible_numbers_are_refused() {
    let poses = dense().trajectory.world_from_camera;
    let t = |novel: NovelGroup, scale: f64, field: &str| {
        let refused = try_made(&novel, &poses, scale).unwrap_err();
        assert!(
            matches!(&refused, TrajectoryError::Parameter { field: named, .. } if *named == field),
            "{refused}"
        );
    };
    t(NovelGroup { groups: 0, ..NOVEL }, 1.0, "groups");
    t(NovelGroup { group: 3, ..NOVEL }, 1.0, "group");
    t(NovelGroup { keyframes: 0, ..NOVEL }, 1.0, "keyframes");
    t(NovelGroup { keyframes: 1, ..NOVEL }, 1.0, "keyframes");
    t(NovelGroup { count: PoseCount::Frames(0), ..NOVEL }, 1.0, "frames");
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        t(NOVEL, scale, "metric.scale");
    }
    let few = |novel: NovelGroup, poses: &[Se3], wanted: u64| {
        let refused = try_made(&novel, poses, 1.0).unwrap_err();
        let (groups, keyframes, found) = (novel.groups, novel.keyframes, poses.len());
        assert_eq!(refused, TrajectoryError::FewPoses { groups, keyframes, wanted, found });
    };
    few(NOVEL, &poses[..14], 15);
    few(NOVEL, &[], 15);
    few(
        NovelGroup { groups: u32::MAX, keyframes: u32::MAX, ..NOVEL },
        &poses,
        u64::from(u32::MAX) * u64::from(u32::MAX),
    );
    assert!(try_made(&NOVEL, &poses[..15], 1.0).is_ok());
}

#[test]
fn an_invalid_pose_is_named() {
    let mut poses = dense().trajectory.world_from_camera;
    let key = try_made(&NOVEL, &poses, 1.0).unwrap().report.keyframes[2];
    poses[key].translation.z = f64::NAN;
    let name = format!("pose {key}");
    assert_eq!(try_made(&NOVEL, &poses, 1.0), Err(TrajectoryError::Centre { name: name.clone() }));
    poses[key] = still(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.5), DVec3::ZERO);
    let refused = try_made(&NOVEL, &poses, 1.0).unwrap_err();
    assert!(matches!(&refused, TrajectoryError::Rotation { name: named, .. } if *named == name), "{refused}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(256) })]
    #[test]
    fn no_base_makes_a_nan(
        poses in prop::collection::vec(wild_pose(), 0..30),
        (groups, keyframes, group) in (0..4u32, 0..7u32, 0..4u32),
        count in 1..40u64,
        scale in prop::sample::select(&[1.0, 1e-300, 1e300, 0.1][..]),
        (seed, literal) in (any::<u64>(), any::<bool>()),
    ) {
        let [keyframes_seed, curve_seed] = [seed, !seed].map(Seed);
        let count = PoseCount::Frames(count);
        let novel = NovelGroup { group, groups, keyframes, count, literal, keyframes_seed, curve_seed, ..NOVEL };
        match try_made(&novel, &poses, scale) {
            Ok(got) => prop_assert!(sound(&got.trajectory) && is_finite(&got.report), "{:?}", got),
            Err(refused) => prop_assert!(!refused.to_string().contains("NaN"), "{refused}"),
        }
    }
}
