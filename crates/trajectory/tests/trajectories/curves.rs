//! Properties of every curve: rates are derivatives, the ends are right, joints are as smooth as
//! stated.

use super::edges::{is_finite, sound, wild_pose};
use super::{LAW, named, orbit, refined, still, try_refined};
use glam::DVec3;
use gs2e_num::se3::rotation::{exp_vector, log_vector, relative_angle, slerp};
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};
use gs2e_trajectory::curve::{CirclePath, CurveKind, MAX_DEGREE, PoseCurve};
use gs2e_trajectory::refine::{EndRule, RefinePath};
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{TrajectoryError, TrajectoryWarning};
use proptest::prelude::*;
use std::f64::consts::PI;

const CURVES: [CurveKind; 8] = [
    CurveKind::Cubic,
    CurveKind::Cumulative,
    CurveKind::SlerpLerp,
    CurveKind::Bezier { degree: 1 },
    CurveKind::Bezier { degree: 2 },
    CurveKind::Bezier { degree: 3 },
    CurveKind::Bezier { degree: 4 },
    CurveKind::Bezier { degree: 5 },
];

/// A bent walk with turns of 0.2 to 0.5 rad, and uneven steps.
fn walk(count: usize) -> (Vec<f64>, Vec<Se3>) {
    let wave = |i: usize, period: f64, phase: f64| (i as f64 * period + phase).sin();
    let mut pose = still(exp_vector(DVec3::new(0.4, -1.0, 2.0)), DVec3::new(1.0, -2.0, 0.5));
    let knots = (0..count).map(|i| {
        let here = pose;
        pose.translation += DVec3::new(0.8, wave(i, 1.3, 0.2), wave(i, 0.7, 2.0));
        let turn = DVec3::new(wave(i, 0.9, 0.5), 1.0, wave(i, 1.7, 1.0));
        pose.rotation *= exp_vector(turn * (0.25 + 0.1 * wave(i, 2.1, 0.0)));
        here
    });
    let knots: Vec<Se3> = knots.collect();
    ((1..count).map(|i| 1.0 + 0.4 * wave(i, 2.9, 0.3)).collect(), knots)
}

fn fitted(curve: CurveKind, count: usize) -> (Box<dyn PoseCurve>, Vec<Se3>) {
    let (steps, knots) = walk(count);
    (curve.through(steps, &knots).unwrap(), knots)
}

/// More than a quarter turn about a tilted axis, with the camera looking elsewhere.
fn circle() -> CirclePath {
    let start = still(exp_vector(DVec3::new(0.3, 2.0, -0.4)), DVec3::new(3.0, 1.0, 2.0));
    CirclePath::new(DVec3::new(1.0, 1.0, -1.0), DVec3::new(0.6, -0.3, 1.9), start)
}

/// The derivative of `f` at 0 by central differences over one and two steps, which cancel the third
/// order.
fn derivative(f: impl Fn(f64) -> DVec3, step: f64) -> DVec3 {
    let central = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    (central(step) * 4.0 - central(2.0 * step)) / 3.0
}

fn check_derivatives(curve: &dyn PoseCurve, name: &str) {
    // The step's fourth power over 30 times a fifth derivative of up to 1e5, and roundings of 1e-15
    // over the step.
    const STEP: f64 = 1e-3;
    const TOLERANCE: f64 = 1e-8;
    let close = |a: DVec3, b: DVec3, what: &str| {
        let error = (a - b).length() / b.length().max(1.0);
        assert!(error < TOLERANCE, "{name}, {what}: {error:e}, {a} {b}");
    };
    for (segment, step) in curve.steps().iter().enumerate() {
        for share in [0.1, 0.5, 0.83] {
            let near = |h: f64| CurvePlace { segment, x: share * step + h };
            let (pose, twist, bend) =
                (curve.pose(near(0.0)), curve.twist(near(0.0)), curve.acceleration(near(0.0)));
            let turned = |h: f64| log_vector(pose.rotation.conjugate() * curve.pose(near(h)).rotation);
            close(twist.linear, derivative(|h| curve.pose(near(h)).translation, STEP), "linear");
            close(twist.angular, derivative(turned, STEP), "angular");
            close(bend.linear, derivative(|h| curve.twist(near(h)).linear, STEP), "linear acceleration");
            close(bend.angular, derivative(|h| curve.twist(near(h)).angular, STEP), "angular acceleration");
            assert!((pose.rotation.length() - 1.0).abs() < 1e-15, "{name}");
        }
    }
}

#[test]
fn rates_and_accelerations_are_derivatives() {
    for curve in CURVES {
        for count in [2, 3, 4, 9] {
            check_derivatives(fitted(curve, count).0.as_ref(), &format!("{curve:?}, {count} knots"));
        }
    }
    check_derivatives(&circle(), "circle");
}

/// Distance between two poses: of order 1 between neighbouring knots of the walk.
fn apart(a: &Se3, b: &Se3) -> f64 {
    (a.translation - b.translation).length() + relative_angle(a.rotation, b.rotation)
}

#[test]
fn curves_start_and_end_in_their_outer_knots() {
    for curve in CURVES {
        for count in [2, 3, 4, 9] {
            let (fitted, knots) = fitted(curve, count);
            let start = fitted.pose(CurvePlace { segment: 0, x: 0.0 });
            assert!(apart(&start, &knots[0]) < 1e-14 && fitted.knot(0) == CurvePlace { segment: 0, x: 0.0 });
            let last = fitted.steps().len() - 1;
            let end = CurvePlace { segment: last, x: fitted.steps()[last] };
            assert_eq!(fitted.knot(count - 1), end);
            assert!(apart(&fitted.pose(end), &knots[count - 1]) < 1e-14, "{curve:?}, {count}");
            let farthest = |away: f64, (k, knot)| away.max(apart(&fitted.pose(fitted.knot(k)), knot));
            let farthest = knots.iter().enumerate().fold(0.0, farthest);
            let through = match curve {
                CurveKind::Cubic | CurveKind::SlerpLerp => true,
                CurveKind::Cumulative => count == 2,
                // `count` knots determine a degree of at most `count` - 1.
                CurveKind::Bezier { degree } => degree as usize >= count - 1,
            };
            // Bezier's control points solve a system with a condition number of up to 100.
            assert_eq!(farthest < 1e-12, through, "{curve:?}, {count}: {farthest:e}");
            // A B-spline passes each knot within a third of the neighbouring step.
            assert!(curve != CurveKind::Cumulative || farthest < 1.0, "{count}: {farthest}");
        }
    }
}

#[test]
fn a_circle_keeps_its_distance_and_its_speed() {
    let (circle, centre, axis) = (circle(), DVec3::new(1.0, 1.0, -1.0), DVec3::new(0.6, -0.3, 1.9));
    let at = |x: f64| CurvePlace { segment: 0, x };
    let start = circle.pose(at(0.0));
    for share in [0.0, 0.3, 1.0] {
        let (pose, twist) = (circle.pose(at(share)), circle.twist(at(share)));
        let (arm, first) = (pose.translation - centre, start.translation - centre);
        assert!((arm.length() - first.length()).abs() < 1e-14 && (arm - first).dot(axis).abs() < 1e-14);
        // The view of a point on the axis does not change.
        let seen = |p: &Se3| p.inverse().rotation * (centre - p.translation);
        assert!((seen(&pose) - seen(&start)).length() < 1e-14);
        assert!((twist.angular.length() - axis.length()).abs() < 1e-14);
        assert!((relative_angle(start.rotation, pose.rotation) - axis.length() * share).abs() < 1e-14);
    }
}

/// Jumps of pose, twist and acceleration over all inner joints, relative to their sizes there.
fn jumps(curve: &dyn PoseCurve) -> [f64; 3] {
    let size = |t: Twist| t.linear.length() + t.angular.length();
    let jump = |a: Twist, b: Twist| {
        size(Twist { linear: a.linear - b.linear, angular: a.angular - b.angular })
            / size(a).max(size(b)).max(1e-3)
    };
    let steps = curve.steps();
    let joints = (1..steps.len()).map(|k| {
        let (left, right) =
            (CurvePlace { segment: k - 1, x: steps[k - 1] }, CurvePlace { segment: k, x: 0.0 });
        [
            apart(&curve.pose(left), &curve.pose(right)),
            jump(curve.twist(left), curve.twist(right)),
            jump(curve.acceleration(left), curve.acceleration(right)),
        ]
    });
    joints.fold([0.0; 3], |a, b| [0, 1, 2].map(|k| f64::max(a[k], b[k])))
}

#[test]
fn joints_are_as_smooth_as_the_curve_states() {
    for curve in CURVES {
        for count in [3, 4, 9, 40] {
            let [c0, c1, c2] = jumps(fitted(curve, count).0.as_ref());
            assert!(c0 < 1e-13, "{curve:?}, {count}: {c0:e}");
            if curve == CurveKind::SlerpLerp {
                assert!(c1 > 0.01, "{count}: {c1}");
            } else {
                // The rotation spline's rates settle to 1e-13 of their size; the rest is rounding.
                assert!(c1 < 1e-11 && c2 < 1e-9, "{curve:?}, {count}: {c1:e} {c2:e}");
            }
        }
    }
}

#[test]
fn two_knots_make_a_line_and_a_slerp() {
    let half_turn = |axis: DVec3| {
        [still(exp_vector(axis), DVec3::ZERO), still(exp_vector(axis * (1.0 + PI)), DVec3::ONE)]
    };
    let (_, two) = walk(2);
    for knots in [[two[0], two[1]], half_turn(DVec3::Y), half_turn(DVec3::new(0.6, 0.0, -0.8))] {
        for curve in CURVES.into_iter().filter(|c| *c != CurveKind::Cumulative) {
            let fitted = curve.through(vec![1.5], &knots).unwrap();
            assert!(fitted.warning().is_none(), "{curve:?}");
            for share in [0.0, 0.25, 0.7, 1.0] {
                let pose = fitted.pose(CurvePlace { segment: 0, x: 1.5 * share });
                let line = knots[0].translation.lerp(knots[1].translation, share);
                let turned = slerp(knots[0].rotation, knots[1].rotation, share);
                // Both directions of a half turn are slerps.
                let there = knots[1].rotation.conjugate() * knots[0].rotation;
                let back = slerp(knots[0].rotation, knots[0].rotation * there, share);
                let off = relative_angle(pose.rotation, turned);
                let is_half = relative_angle(knots[0].rotation, knots[1].rotation) > PI - 1e-6;
                let off = if is_half { off.min(relative_angle(pose.rotation, back)) } else { off };
                assert!(
                    (pose.translation - line).length() < 1e-14 && off < 1e-14,
                    "{curve:?}, {share}: {off:e}"
                );
            }
        }
    }
}

/// A cubic polynomial, by its control points.
fn cubic(x: f64) -> DVec3 {
    let [a, b, c, d] =
        [DVec3::ZERO, DVec3::new(1.0, 2.0, -1.0), DVec3::new(3.0, -1.0, 0.5), DVec3::new(2.0, 2.0, 2.0)];
    let y = 1.0 - x;
    a * y * y * y + (b * y + c * x) * (3.0 * x * y) + d * x * x * x
}

#[test]
fn bezier_curves_find_planted_polynomials_of_their_degree() {
    let t = |steps: &[f64], degree: u32, tolerance: f64| {
        let whole: f64 = steps.iter().sum();
        let before: Vec<f64> = (0..=steps.len()).map(|k| steps[..k].iter().sum()).collect();
        let turned = |s: f64| exp_vector(DVec3::X * (2.0 * s / whole));
        let knots: Vec<Se3> = before.iter().map(|s| still(turned(*s), cubic(s / whole))).collect();
        let fitted = CurveKind::Bezier { degree }.through(steps.to_vec(), &knots).unwrap();
        for (segment, step) in steps.iter().enumerate() {
            let (pose, s) =
                (fitted.pose(CurvePlace { segment, x: 0.4 * step }), before[segment] + 0.4 * step);
            let off = (pose.translation - cubic(s / whole)).length();
            assert!((off < tolerance) == (degree >= 3), "{degree}, {segment}: {off:e}");
            // Turns about one axis at a constant rate are a line of rotation vectors.
            assert!(relative_angle(pose.rotation, turned(s)) < tolerance, "{degree}, {segment}");
        }
    };
    let few = [0.3, 1.2, 0.7, 0.2, 1.1, 0.5];
    (1..=6).for_each(|degree| t(&few, degree, 1e-13));
    // At degree 20 a condition number of 1e6 multiplies roundings of 1e-16.
    let many: Vec<f64> = (0..60u8).map(|k| 1.0 + 0.8 * f64::from(k).sin()).collect();
    [1, 3, 5, 12, MAX_DEGREE].into_iter().for_each(|degree| t(&many, degree, 1e-10));
}

#[test]
fn rotations_that_spread_too_far_for_a_bezier_curve_follow_the_spline() {
    let turns = |angles: &[f64]| -> Vec<Se3> {
        angles
            .iter()
            .enumerate()
            .map(|(i, a)| still(exp_vector(DVec3::Y * a.to_radians()), DVec3::X * i as f64))
            .collect()
    };
    let t = |angles: &[f64], spread: bool| {
        let (knots, steps) = (turns(angles), vec![1.0; angles.len() - 1]);
        let fitted = CurveKind::Bezier { degree: 3 }.through(steps.clone(), &knots).unwrap();
        assert_eq!(fitted.warning(), spread.then_some(TrajectoryWarning::Spread), "{angles:?}");
        let spline = CurveKind::Cubic.through(steps, &knots).unwrap();
        let at = CurvePlace { segment: 1, x: 0.3 };
        assert!(!spread || fitted.pose(at).rotation == spline.pose(at).rotation, "{angles:?}");
        assert!(jumps(fitted.as_ref()).into_iter().all(|jump| jump < 1e-9));
    };
    // Three quarters of a circle and more are unrolled around their middle.
    t(&[0.0, 72.0, 144.0, 216.0, 288.0], false);
    t(&[0.0, 84.0, 168.0, 252.0, 336.0], false);
    t(&[0.0, 86.0, 172.0, 258.0, 344.0], true);
    // Around a mean of 240 degrees the first two would be 260 degrees apart.
    t(&[0.0, 100.0, 200.0, 300.0], true);
    let views = named(turns(&[0.0, 86.0, 172.0, 258.0, 344.0]));
    let params = RefinePath { window: 0, curve: CurveKind::Bezier { degree: 4 }, ..RefinePath::default() };
    let got = refined(&views, &params, LAW);
    assert_eq!(got.warnings, [TrajectoryWarning::Spread]);
    assert_eq!(got.report.warnings, [TrajectoryWarning::Spread.to_string()]);
}

#[test]
fn degrees_out_of_range_are_refused() {
    let t = |degree| {
        let params = RefinePath { curve: CurveKind::Bezier { degree }, ..RefinePath::default() };
        try_refined(&orbit(30, 0.0, 0.0, 1), &params, LAW)
    };
    assert_eq!(t(MAX_DEGREE).unwrap().report.degree_used, Some(MAX_DEGREE));
    for degree in [0, MAX_DEGREE + 1, u32::MAX] {
        let refused = t(degree).unwrap_err();
        assert!(matches!(refused, TrajectoryError::Parameter { field: "bezier.degree", .. }), "{refused}");
        assert!(refused.to_string().contains(&format!("1 to {MAX_DEGREE}")));
    }
}

#[test]
fn every_curve_is_followed_and_reports_its_fit() {
    for curve in CURVES {
        let views = orbit(30, 0.005, 0.5, 1);
        let got = refined(&views, &RefinePath { curve, ends: EndRule::Pinned, ..RefinePath::default() }, LAW);
        let report = &got.report;
        let follow = report.mixed_ratio.unwrap();
        let (distance, jumps) = (report.knot_distance.unwrap(), report.knot_jumps.unwrap());
        eprintln!(
            "{curve:?}: {follow:?}, knots {distance:.3e}, {jumps:?}, length {:.5}",
            report.length_ratio.unwrap()
        );
        assert!(follow.min > 1.0 - 1e-6 && follow.max < 1.0 + 1e-6, "{curve:?}: {follow:?}");
        let poses = &got.trajectory.world_from_camera;
        assert!(
            apart(&poses[0], &views[0].1) < 1e-13 && apart(&poses[149], &views[29].1) < 1e-13,
            "{curve:?}"
        );
        assert_eq!((report.curve, report.degree_drawn), (Some(curve), None));
        assert!(jumps.c0 < 1e-12, "{curve:?}: {jumps:?}");
        assert_eq!(jumps.c1 < 1e-6 && jumps.c2 < 1e-6, curve != CurveKind::SlerpLerp, "{curve:?}: {jumps:?}");
        match curve {
            CurveKind::Cubic | CurveKind::SlerpLerp => {
                assert!(distance < 1e-12 && report.degree_used.is_none())
            }
            // A sixth of the bend at a knot: below a third of the neighbouring steps, whose
            // variation is 0.3.
            CurveKind::Cumulative => {
                assert!(distance > 1e-3 && distance < 0.5 && report.degree_used.is_none())
            }
            CurveKind::Bezier { degree } => assert!(distance > 1e-3 && report.degree_used == Some(degree)),
        }
    }
}

#[test]
fn a_line_between_the_ends_of_a_half_circle_misses_its_top() {
    // Degree 1 leaves nothing to fit: the chord of the half circle, 2 units from its top, which are
    // 1 in the metric.
    let params = RefinePath { curve: CurveKind::Bezier { degree: 1 }, window: 0, ..RefinePath::default() };
    let got = refined(&orbit(31, 0.0, 0.0, 1), &params, "1");
    let poses = &got.trajectory.world_from_camera;
    assert!(poses.iter().all(|p| p.translation.y.abs() < 1e-12 && (p.translation.z - 0.4).abs() < 1e-12));
    let apart = got.report.length / 30.0;
    let missed = got.report.knot_distance.unwrap() * apart * got.report.scale_distance;
    assert!(missed > 1.9, "{missed}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]
    #[test]
    fn no_curve_makes_a_nan(
        poses in prop::collection::vec(wild_pose(), 1..9),
        curve in prop::sample::select(&CURVES[..]),
        window in 0..2u32,
        literal in any::<bool>(),
        law in prop::sample::select(&[LAW, "1", "1e-300 + t^9", "2 + sin(90*t)"][..]),
    ) {
        let params = RefinePath { window, literal, curve, count: PoseCount::Frames(40), ..RefinePath::default() };
        match try_refined(&named(poses), &params, law) {
            Ok(got) => prop_assert!(sound(&got.trajectory) && is_finite(&got.report), "{:?}", got),
            Err(refused) => prop_assert!(!refused.to_string().contains("NaN"), "{refused}"),
        }
    }

    #[test]
    fn curves_through_wild_knots_are_finite(
        knots in prop::collection::vec((wild_pose(), prop::sample::select(&[1.0, 1e-6, 0.3, 1e-4, 1e6][..])), 2..9),
        curve in prop::sample::select(&CURVES[..]),
        share in 0.0..1.0f64,
    ) {
        let (knots, mut steps): (Vec<Se3>, Vec<f64>) = knots.into_iter().unzip();
        steps.pop();
        let Ok(curve) = curve.through(steps, &knots) else { return Ok(()) };
        for (segment, step) in curve.steps().iter().enumerate() {
            for share in [0.0, share, 1.0] {
                let at = CurvePlace { segment, x: share * step };
                let (pose, twist) = (curve.pose(at), curve.twist(at));
                prop_assert!(pose.is_finite() && (pose.rotation.length() - 1.0).abs() < 1e-14, "{:?}", pose);
                prop_assert!(twist.linear.is_finite() && twist.angular.is_finite(), "{:?}", twist);
            }
        }
    }
}
