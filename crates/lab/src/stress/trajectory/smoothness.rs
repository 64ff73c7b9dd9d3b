//! Rates of curves of poses, and their continuity where pieces meet.

use crate::stress::{CaseResult, StressPoint, WorstPoint};
use glam::DVec3;
use gs2e_num::se3::rotation::{exp_vector, log_vector};
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};
use gs2e_trajectory::curve::{CurveKind, PoseCurve};

/// Poses with uneven turns of up to 1.5 rad between neighbours.
#[must_use]
fn uneven_knots() -> (Vec<f64>, Vec<Se3>) {
    let steps = vec![0.7, 1.3, 1.0, 0.4, 1.1, 0.9];
    let mut pose = Se3::IDENTITY;
    let mut poses = vec![pose];
    for i in 1..=steps.len() {
        let wave = |k: usize| libm::sin((k * i * i) as f64 + 0.5);
        pose.rotation =
            (pose.rotation * exp_vector(DVec3::new(wave(1), wave(2), wave(3)) * 0.85)).normalize();
        pose.translation += DVec3::new(wave(4), 0.5 + wave(5), wave(6));
        poses.push(pose);
    }
    (steps, poses)
}

/// The curves that are twice differentiable.
pub(super) fn smooth_curves() -> Vec<Box<dyn PoseCurve>> {
    let through = |curve: CurveKind| {
        let (steps, knots) = uneven_knots();
        curve.through(steps, &knots).expect("turns of less than 90 degrees")
    };
    vec![through(CurveKind::Cubic), through(CurveKind::Cumulative)]
}

/// The pose relative to the pose at another place.
fn relative_pose(curve: &dyn PoseCurve, from: CurvePlace, x: f64) -> [DVec3; 2] {
    let (a, b) = (curve.pose(from), curve.pose(CurvePlace { x, ..from }));
    // At the place itself, the derivative of this rotation vector is the body rate.
    [b.translation - a.translation, log_vector(a.rotation.conjugate() * b.rotation)]
}

/// Both rates inside the segments against central differences of fourth order of the poses.
#[must_use]
pub fn rates_case(curves: &[Box<dyn PoseCurve>]) -> CaseResult {
    /// Step of the difference. Its error is the fourth power over 30 times a fifth derivative, plus
    /// 1e-16 divided by the step.
    const STEP: f64 = 1e-3;
    let mut worst = WorstPoint::default();
    for curve in curves {
        for (segment, step) in curve.steps().iter().enumerate() {
            for share in [0.1, 0.35, 0.5, 0.65, 0.9] {
                let at = CurvePlace { segment, x: share * step };
                let near = |k: f64| relative_pose(&**curve, at, at.x + k * STEP);
                let Twist { linear, angular } = curve.twist(at);
                for (what, k, found) in [("linear", 0, linear), ("angular", 1, angular)] {
                    let wide = near(2.0)[k] - near(-2.0)[k];
                    let wanted = ((near(1.0)[k] - near(-1.0)[k]) * 8.0 - wide) / (12.0 * STEP);
                    let error = (found - wanted).length();
                    let point =
                        StressPoint { computed: found.length(), answer: wanted.length(), error, limit: 1e-8 };
                    worst.see(point, || format!("{what} rate at {share} of segment {segment}"));
                }
            }
        }
    }
    worst.found()
}

/// Continuity of both rates and their derivatives at each inner knot.
#[must_use]
pub fn joints_case(curves: &[Box<dyn PoseCurve>]) -> CaseResult {
    const STEP: f64 = 1e-4;
    let mut worst = WorstPoint::default();
    for curve in curves {
        for knot in 1..curve.steps().len() {
            let before =
                |k: f64| curve.twist(CurvePlace { segment: knot - 1, x: curve.steps()[knot - 1] - k * STEP });
            let after = |k: f64| curve.twist(CurvePlace { segment: knot, x: k * STEP });
            for (what, part) in [("linear", linear_rate as fn(Twist) -> DVec3), ("angular", angular_rate)] {
                // Differences to one side, of second order: no point of the other segment enters.
                let slope = |side: &dyn Fn(f64) -> Twist, sign: f64| {
                    let [here, near, far] = [0.0, 1.0, 2.0].map(|k| part(side(k)));
                    (near * 4.0 - far - here * 3.0) * (sign / (2.0 * STEP))
                };
                let pairs = [
                    ("rate", part(before(0.0)), part(after(0.0))),
                    ("acceleration", slope(&before, -1.0), slope(&after, 1.0)),
                ];
                for (of, left, right) in pairs {
                    let error = (right - left).length();
                    let point =
                        StressPoint { computed: right.length(), answer: left.length(), error, limit: 1e-3 };
                    worst.see(point, || format!("{what} {of} at knot {knot}"));
                }
            }
        }
    }
    worst.found()
}

fn linear_rate(twist: Twist) -> DVec3 {
    twist.linear
}

fn angular_rate(twist: Twist) -> DVec3 {
    twist.angular
}
