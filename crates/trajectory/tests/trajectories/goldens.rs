//! SciPy's splines, quadrature and a whole refinement by another program:
//! `tests/golden/trajectory`.

use super::{LAW, named, refined};
use glam::{DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::arc_length::ArcLength;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_num::se3::rotation_spline::RotationSpline;
use gs2e_num::se3::spline::{CubicSegment, CubicSpline, CurvePlace};
use gs2e_trajectory::curve::{CurveKind, PoseCurve};
use gs2e_trajectory::refine::RefinePath;
use serde::Deserialize;

fn golden<T: for<'a> Deserialize<'a>>(name: &str) -> T {
    let path = gs2e_testing::golden::folder("trajectory").join(name);
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[derive(Deserialize)]
struct Splines {
    cases: Vec<SplineCase>,
}

#[derive(Deserialize)]
struct SplineCase {
    steps: Vec<f64>,
    points: Vec<[f64; 3]>,
    quaternions_xyzw: Vec<[f64; 4]>,
    segments: Vec<usize>,
    x: Vec<f64>,
    value: Vec<[f64; 3]>,
    slope: Vec<[f64; 3]>,
    rotation_xyzw: Vec<[f64; 4]>,
    rate: Vec<[f64; 3]>,
    acceleration: Vec<[f64; 3]>,
}

/// Compares relative to the wanted value, or to 1 if that is smaller: values here are of order 1 to
/// 100.
fn close(got: DVec3, want: [f64; 3], tolerance: f64, what: &str) {
    let want = DVec3::from_array(want);
    let error = (got - want).length() / want.length().max(1.0);
    assert!(error <= tolerance, "{what}: {error:e}");
}

#[test]
fn both_splines_are_those_of_scipy() {
    for (k, case) in golden::<Splines>("splines.json").cases.iter().enumerate() {
        let points: Vec<DVec3> = case.points.iter().map(|p| DVec3::from_array(*p)).collect();
        let quaternions: Vec<DQuat> = case.quaternions_xyzw.iter().map(|q| DQuat::from_array(*q)).collect();
        let centres = CubicSpline::not_a_knot(&case.steps, &points);
        let rotations = RotationSpline::new(&case.steps, &quaternions).unwrap();
        for i in 0..case.x.len() {
            let at = CurvePlace { segment: case.segments[i], x: case.x[i] };
            let what = |name: &str| format!("case {k}, {at:?}, {name}");
            let cubic = centres.segment(at.segment);
            close(cubic.value(at.x), case.value[i], 1e-9, &what("value"));
            close(cubic.slope(at.x), case.slope[i], 1e-9, &what("slope"));
            let off = relative_angle(rotations.rotation(at), DQuat::from_array(case.rotation_xyzw[i]));
            assert!(off <= 1e-9, "{}: {off:e}", what("rotation"));
            close(rotations.rate(at), case.rate[i], 1e-9, &what("rate"));
            // SciPy's closed forms cancel below 0.1 rad: README.md of the goldens.
            close(rotations.acceleration(at), case.acceleration[i], 1e-7, &what("acceleration"));
        }
    }
}

#[test]
fn curves_are_twice_differentiable_at_their_knots() {
    for (k, case) in golden::<Splines>("splines.json").cases.iter().enumerate() {
        let quaternions: Vec<DQuat> = case.quaternions_xyzw.iter().map(|q| DQuat::from_array(*q)).collect();
        let spline = RotationSpline::new(&case.steps, &quaternions).unwrap();
        for (i, h) in case.steps[..case.steps.len() - 1].iter().enumerate() {
            let (left, right) = (CurvePlace { segment: i, x: *h }, CurvePlace { segment: i + 1, x: 0.0 });
            assert!(relative_angle(spline.rotation(left), spline.rotation(right)) < 1e-14);
            let jump = |a: DVec3, b: DVec3| (a - b).length() / a.length().max(1.0);
            let rate = jump(spline.rate(left), spline.rate(right));
            let acceleration = jump(spline.acceleration(left), spline.acceleration(right));
            // The rates solve the joint conditions to 1e-12; accelerations divide by steps of 0.3
            // and more.
            assert!(rate < 1e-12 && acceleration < 1e-9, "case {k}, knot {i}: {rate:e}, {acceleration:e}");
        }
    }
}

#[test]
fn body_rates_are_differences_of_rotations() {
    let case = &golden::<Splines>("splines.json").cases[4];
    let quaternions: Vec<DQuat> = case.quaternions_xyzw.iter().map(|q| DQuat::from_array(*q)).collect();
    let spline = RotationSpline::new(&case.steps, &quaternions).unwrap();
    let step = 1e-5;
    for (segment, h) in case.steps.iter().enumerate() {
        let at = |x: f64| CurvePlace { segment, x };
        let x = 0.37 * h;
        let turn = spline.rotation(at(x - step)).conjugate() * spline.rotation(at(x + step));
        let rate = gs2e_num::se3::rotation::log_vector(turn) / (2.0 * step);
        // The error of the central difference is a sixth of the squared step times a third
        // derivative of order 100, plus roundings of 1e-16 over the step.
        assert!((rate - spline.rate(at(x))).length() < 1e-8 * rate.length().max(1.0), "{segment}");
    }
}

#[derive(Deserialize)]
struct Curves {
    cases: Vec<CurveCase>,
}

#[derive(Deserialize)]
struct CurveCase {
    curve: String,
    degree: Option<u32>,
    degree_used: Option<u32>,
    steps: Vec<f64>,
    knots: Vec<[f64; 7]>,
    segments: Vec<usize>,
    x: Vec<f64>,
    centre: Vec<[f64; 3]>,
    linear: Vec<[f64; 3]>,
    linear_slope: Vec<[f64; 3]>,
    rotation_xyzw: Vec<[f64; 4]>,
    angular: Vec<[f64; 3]>,
    angular_slope: Vec<[f64; 3]>,
}

impl CurveCase {
    fn fitted(&self) -> Box<dyn PoseCurve> {
        let curve = match (&*self.curve, self.degree) {
            ("cumulative", None) => CurveKind::Cumulative,
            ("slerp-lerp", None) => CurveKind::SlerpLerp,
            ("bezier", Some(degree)) => CurveKind::Bezier { degree },
            other => panic!("{other:?}"),
        };
        let knots: Vec<Se3> = self.knots.iter().copied().map(pose).collect();
        curve.through(self.steps.clone(), &knots).unwrap()
    }
}

#[test]
fn curves_are_those_of_scipy() {
    let cases = golden::<Curves>("curves.json").cases;
    assert_eq!(cases.len(), 26);
    for (k, case) in cases.iter().enumerate() {
        let curve = case.fitted();
        assert_eq!((curve.degree(), curve.warning()), (case.degree_used, None), "case {k}");
        for i in 0..case.x.len() {
            let at = CurvePlace { segment: case.segments[i], x: case.x[i] };
            let what = |name: &str| format!("case {k}, {} {:?}, {at:?}, {name}", case.curve, case.degree);
            let (pose, twist, bend) = (curve.pose(at), curve.twist(at), curve.acceleration(at));
            close(pose.translation, case.centre[i], 1e-9, &what("centre"));
            let off = relative_angle(pose.rotation, DQuat::from_array(case.rotation_xyzw[i]));
            assert!(off <= 1e-9, "{}: {off:e}", what("rotation"));
            close(twist.linear, case.linear[i], 1e-9, &what("linear"));
            close(twist.angular, case.angular[i], 1e-9, &what("angular"));
            close(bend.linear, case.linear_slope[i], 1e-9, &what("linear slope"));
            close(bend.angular, case.angular_slope[i], 1e-9, &what("angular slope"));
        }
    }
}

#[derive(Deserialize)]
struct Lengths {
    segments: Vec<Segment>,
}

#[derive(Deserialize)]
struct Segment {
    kind: String,
    ends: [[f64; 3]; 2],
    slopes: [[f64; 3]; 2],
    length: f64,
}

#[test]
fn lengths_are_those_of_quadrature_and_of_closed_forms() {
    let mut errors: Vec<(f64, String)> = Vec::new();
    for segment in golden::<Lengths>("lengths.json").segments {
        let cubic = CubicSegment::from_hermite(
            1.0,
            segment.ends.map(DVec3::from_array),
            segment.slopes.map(DVec3::from_array),
        );
        let arc = ArcLength::measure_curve(&[1.0], |at: CurvePlace| cubic.slope(at.x).length());
        let error = (arc.total() - segment.length).abs() / segment.length;
        errors.push((error, segment.kind.clone()));
        for k in 0..=100 {
            let share = f64::from(k) / 100.0;
            let reached = arc.between(CurvePlace { segment: 0, x: 0.0 }, arc.invert(share * arc.total()));
            let residual = (reached - share * arc.total()).abs() / arc.total();
            // The inverse's 1e-13 and the errors of two quadratures, which are up to 1e-12 per
            // panel near a cusp.
            let limit = if segment.kind == "cusp" { 1e-11 } else { 1e-12 };
            assert!(residual < limit, "{} {share}: {residual:e}", segment.kind);
        }
    }
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let quantile = errors[errors.len() * 95 / 100].0;
    let worst = &errors[errors.len() - 1];
    eprintln!("arc length: relative error {quantile:e} at 95 %, {:e} at worst ({})", worst.0, worst.1);
    assert!(quantile <= 1e-10 && worst.0 <= 1e-7);
}

#[derive(Deserialize)]
struct Orbit {
    views: Vec<[f64; 7]>,
    scale_distance: f64,
    #[serde(rename = "S")]
    length: f64,
    length_ratio: f64,
    poses: Vec<[f64; 7]>,
    literal_poses: Vec<[f64; 7]>,
}

fn pose([x, y, z, qx, qy, qz, qw]: [f64; 7]) -> Se3 {
    Se3 { rotation: DQuat::from_xyzw(qx, qy, qz, qw), translation: DVec3::new(x, y, z) }
}

#[test]
fn a_refined_orbit_is_that_of_another_program() {
    let want: Orbit = golden("refined.json");
    let views = named(want.views.iter().copied().map(pose));
    for (literal, poses) in [(false, &want.poses), (true, &want.literal_poses)] {
        let got = refined(&views, &RefinePath { literal, ..RefinePath::default() }, LAW);
        let relative = |a: f64, b: f64| (a - b).abs() / b;
        assert!(relative(got.report.scale_distance, want.scale_distance) < 1e-12);
        assert!(relative(got.report.length, want.length) < 1e-12);
        assert!(relative(got.report.length_ratio.unwrap(), want.length_ratio) < 1e-10);
        assert_eq!(got.trajectory.world_from_camera.len(), poses.len());
        for (j, (a, b)) in
            got.trajectory.world_from_camera.iter().zip(poses.iter().copied().map(pose)).enumerate()
        {
            let (centre, turn) =
                ((a.translation - b.translation).length(), relative_angle(a.rotation, b.rotation));
            assert!(
                centre < 1e-9 * want.length && turn < 1e-9,
                "literal {literal}, {j}: {centre:e}, {turn:e}"
            );
        }
    }
}
