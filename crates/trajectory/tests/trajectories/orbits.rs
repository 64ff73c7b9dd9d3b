//! Paths without a capture: orbits and poses given by hand.

use super::{Views, law, named, orbit, timing};
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::{exp_vector, relative_angle};
use gs2e_num::se3::{Se3, look_at};
use gs2e_trajectory::curve::CurveKind;
use gs2e_trajectory::keyframes::{CameraFacing, Keyframe, KeyframePath};
use gs2e_trajectory::orbit::OrbitPath;
use gs2e_trajectory::path::{CameraPath, PathInputs};
use gs2e_trajectory::refine::TranslationScale;
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{CourseKind, NamedPose, TrajectoryBuild, TrajectoryError, TrajectoryWarning};
use std::f64::consts::PI;

const FRAMES: PoseCount = PoseCount::Frames(91);

fn made(path: &CameraPath, views: &Views, law_text: &str) -> Result<TrajectoryBuild, TrajectoryError> {
    let views: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    path.make(PathInputs { views: &views, base: None, scene: None }, timing(&law(law_text)), None)
}

fn whole() -> OrbitPath {
    OrbitPath {
        centre: Some(DVec3::new(1.0, 2.0, 3.0)),
        from: Some(DVec3::new(4.0, 2.0, 7.0)),
        up: Some(DVec3::Y * 5.0),
        arc: 90.0,
        count: FRAMES,
    }
}

#[test]
fn an_orbit_is_a_circle_at_constant_speed() {
    let made = made(&CameraPath::Orbit(whole()), &Vec::new(), "1").unwrap();
    for (j, pose) in made.trajectory.world_from_camera.iter().enumerate() {
        // One degree per pose about y, right-handed: z turns towards x. The arm is (3, 0, 4).
        let phi = (j as f64).to_radians();
        let arm = DVec3::new(3.0 * phi.cos() + 4.0 * phi.sin(), 0.0, 4.0 * phi.cos() - 3.0 * phi.sin());
        assert!((pose.translation - DVec3::new(1.0, 2.0, 3.0) - arm).length() < 1e-13, "{j}");
        // The camera looks at the centre with y up: its image's down direction is -y.
        assert!((pose.rotation * DVec3::Z + arm / 5.0).length() < 1e-14, "{j}");
        assert!((pose.rotation * DVec3::Y + DVec3::Y).length() < 1e-14, "{j}");
    }
    let report = &made.report;
    // 90 degrees in 90 steps of 1/2400 s.
    let rate = 2400.0_f64.to_radians();
    assert!(report.angular_rad_s.iter().all(|w| (w / rate - 1.0).abs() < 1e-10));
    // A chord of a degree is 1 - (1/2 degree)^2 / 6 of its arc.
    let short = 1.0 - 0.5_f64.to_radians().powi(2) / 6.0;
    assert!(report.linear_unit_s.iter().all(|v| (v / (5.0 * rate * short) - 1.0).abs() < 1e-8));
    assert!((report.scale_distance - 5.0).abs() < 1e-14);
    // An angle, plus an arc of the same angle at distance D: twice the angle.
    assert!((report.length - PI).abs() < 1e-13 && (report.length_ratio.unwrap() - 1.0).abs() < 1e-12);
    assert_eq!((report.kind, report.curve, report.knot_jumps), (CourseKind::Orbit, None, None));
}

#[test]
fn orbits_follow_a_law_and_turn_as_often_as_asked() {
    let path = CameraPath::Orbit(OrbitPath { arc: -720.0, count: PoseCount::Frames(721), ..whole() });
    let made = made(&path, &Vec::new(), "1 + t").unwrap();
    let follow = made.report.mixed_ratio.unwrap();
    assert!(follow.min > 1.0 - 1e-9 && follow.max < 1.0 + 1e-9, "{follow:?}");
    let poses = &made.trajectory.world_from_camera;
    assert!((poses[720].translation - poses[0].translation).length() < 1e-12);
    // Left-handed: x turns towards z.
    let arm = poses[1].translation - DVec3::new(1.0, 2.0, 3.0);
    assert!(arm.cross(DVec3::new(3.0, 0.0, 4.0)).y > 0.0, "{arm}");
}

#[test]
fn missing_keys_of_an_orbit_come_from_the_capture() {
    // Around the origin at a height of 0.4, z up.
    let views = orbit(30, 0.0, 0.0, 1);
    let path = CameraPath::Orbit(OrbitPath { centre: None, from: None, up: None, arc: 180.0, count: FRAMES });
    let got = made(&path, &views, "1").unwrap();
    let (first, last) = (views[0].1, views[29].1);
    let poses = &got.trajectory.world_from_camera;
    assert!((poses[0].translation - first.translation).length() < 1e-9, "{}", poses[0].translation);
    assert!((poses[0].rotation * DVec3::Z - first.rotation * DVec3::Z).length() < 1e-9);
    // The mean of the views' up directions leans towards the filmed side.
    let tilt = (poses[90].translation - last.translation).length();
    assert!(tilt > 1e-3 && tilt < 1.0, "{tilt}");
    let upright = CameraPath::Orbit(OrbitPath {
        up: Some(DVec3::Z),
        centre: None,
        from: None,
        arc: 180.0,
        count: FRAMES,
    });
    let end = made(&upright, &views, "1").unwrap().trajectory.world_from_camera[90];
    assert!(
        (end.translation - last.translation).length() < 1e-9
            && relative_angle(end.rotation, last.rotation) < 1e-9
    );
}

#[test]
fn orbits_that_are_not_determined_are_refused() {
    let t = |orbit: OrbitPath, views: &Views, words: &str| {
        let refused = made(&CameraPath::Orbit(orbit), views, "1").unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    };
    let none = Vec::new();
    t(OrbitPath { from: None, ..whole() }, &none, "the orbit has no from: it is not given");
    t(OrbitPath { up: None, ..whole() }, &none, "the orbit has no up: it is not given");
    t(
        OrbitPath { centre: None, ..whole() },
        &none,
        "the orbit has no centre: it is not given, and there is no capture",
    );
    t(OrbitPath { up: Some(DVec3::ZERO), ..whole() }, &none, "the orbit has no up: it is zero");
    t(OrbitPath { from: whole().centre, ..whole() }, &none, "the camera starts on the axis");
    t(OrbitPath { from: Some(DVec3::new(1.0, 9.0, 3.0)), ..whole() }, &none, "the camera starts on the axis");
    t(OrbitPath { from: Some(DVec3::NAN), ..whole() }, &none, "the orbit has no");
    let parallel = named((0..5u32).map(|k| super::still(DQuat::IDENTITY, DVec3::X * f64::from(k))));
    t(OrbitPath { centre: None, ..whole() }, &parallel, "optical axes meet nowhere");
}

fn hand(poses: Vec<Keyframe>, curve: CurveKind) -> CameraPath {
    CameraPath::Keyframes(KeyframePath {
        poses,
        count: FRAMES,
        curve,
        scale: TranslationScale::Scene,
        literal: false,
    })
}

fn towards(position: DVec3) -> Keyframe {
    Keyframe { position, facing: CameraFacing::Towards { target: DVec3::ZERO, up: DVec3::Z } }
}

#[test]
fn poses_by_hand_are_passed() {
    let positions = [DVec3::X * 3.0, DVec3::new(2.0, 2.0, 0.5), DVec3::Y * 3.0, DVec3::new(-1.0, 2.5, 1.0)];
    let mut poses: Vec<Keyframe> = positions.map(towards).to_vec();
    let look = look_at(-positions[3], DVec3::Z).unwrap();
    poses[3].facing = CameraFacing::Rotation(-look);
    let got = made(&hand(poses, CurveKind::Cubic), &Vec::new(), "1").unwrap();
    let dense = &got.trajectory.world_from_camera;
    for position in positions {
        let rotation = look_at(-position, DVec3::Z).unwrap();
        let nearest = dense.iter().min_by(|a, b| {
            (a.translation - position).length().total_cmp(&(b.translation - position).length())
        });
        let nearest = nearest.unwrap();
        // Half a step of a path of about 6 units in 90 steps.
        assert!(
            (nearest.translation - position).length() < 0.05
                && relative_angle(nearest.rotation, rotation) < 0.05
        );
    }
    assert!((dense[0].translation - positions[0]).length() < 1e-14);
    assert!(
        (dense[90].translation - positions[3]).length() < 1e-14
            && relative_angle(dense[90].rotation, look) < 1e-14
    );
    let jumps = got.report.knot_jumps.unwrap();
    assert!(jumps.c0 < 1e-12 && jumps.c1 < 1e-10 && jumps.c2 < 1e-8, "{jumps:?}");
    assert!(got.report.knot_distance.unwrap() < 1e-12 && got.report.kind == CourseKind::Keyframes);
}

#[test]
fn an_invalid_pose_by_hand_is_refused_by_its_number() {
    let t = |bad: Keyframe, words: &str| {
        let path = hand(vec![towards(DVec3::X), towards(DVec3::Y), bad], CurveKind::Cubic);
        let refused = made(&path, &Vec::new(), "1").unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
    };
    t(towards(DVec3::ZERO), "keyframe 2 (from 0) looks");
    t(towards(DVec3::Z), "keyframe 2 (from 0) looks");
    let turned = |rotation| Keyframe { position: DVec3::X, facing: CameraFacing::Rotation(rotation) };
    t(turned(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.9)), "view `keyframe 2`: a rotation is not orthonormal");
    t(turned(DQuat::from_xyzw(0.0, 0.0, 0.0, f64::NAN)), "not finite");
    let far =
        Keyframe { position: DVec3::X * f64::INFINITY, facing: CameraFacing::Rotation(DQuat::IDENTITY) };
    t(far, "`keyframe 2` is not finite");
    assert_eq!(made(&hand(Vec::new(), CurveKind::Cubic), &Vec::new(), "1"), Err(TrajectoryError::NoViews));
    let one = made(&hand(vec![towards(DVec3::X)], CurveKind::Cubic), &Vec::new(), "1").unwrap();
    assert_eq!(one.warnings, [TrajectoryWarning::Still { views: 1 }]);
}

#[test]
fn a_turn_between_two_poses_is_the_shorter_one() {
    let turned = |r: DVec3| Keyframe { position: DVec3::ZERO, facing: CameraFacing::Rotation(exp_vector(r)) };
    let path = hand(vec![turned(DVec3::ZERO), turned(DVec3::Z * 3.5)], CurveKind::Cubic);
    let poses = made(&path, &Vec::new(), "1").unwrap().trajectory.world_from_camera;
    let middle = Se3 { rotation: exp_vector(DVec3::Z * ((3.5 - 2.0 * PI) / 2.0)), translation: DVec3::ZERO };
    assert!(relative_angle(poses[45].rotation, middle.rotation) < 1e-13);
}
