//! Plausible formulas in common use: each misses its row.

use glam::{DQuat, DVec3};
use gs2e_event::Polarity;
use gs2e_lab::stress::splat::scenes::NeedleGaussian;
use gs2e_lab::stress::splat::{FloatPrecision, judge_needles, scenes};
use gs2e_lab::stress::{CaseResult, clock, sensor, splat, trajectory};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::exp_vector;
use gs2e_num::seed::CellDraws;
use gs2e_trajectory::curve::CurveKind;

fn misses(found: &CaseResult, what: &str) {
    println!("{what}: {:e} of {:e}, {}", found.worst.error, found.worst.limit, found.at);
    assert!(!found.holds(), "{what} is within its limit: {found:?}");
}

/// As published: `(e^(m b) - 1)/(e^(m b) - e^(-m a))`, and ON where that is 0/0.
#[test]
fn the_published_polarity() {
    let published = |drift: f64, up: f64, down: f64| {
        let share = ((drift * down).exp() - 1.0) / ((drift * down).exp() - (-drift * up).exp());
        if share.is_nan() { 1.0 } else { share }
    };
    let found = sensor::polarity_case(published);
    misses(&found, "polarity as published");
    assert!(found.worst.error > 0.1, "at no drift it is ON");
}

/// As published: `mean + mean^2 y/(2 shape) - mean/(2 shape) sqrt(4 mean shape y + mean^2 y^2)`,
/// whose terms cancel.
#[test]
fn the_published_root_of_the_inverse_gaussian() {
    let published = |a: f64, g: f64, v: f64, z: f64, u: f64| {
        let (mean, shape, y) = (a / g, a * a / v, z * z);
        let root = (4.0 * mean * shape * y + mean * mean * y * y).sqrt();
        let smaller = mean + mean * mean * y / (2.0 * shape) - mean / (2.0 * shape) * root;
        let ratio = if u <= mean / (mean + smaller) { smaller } else { mean * mean / smaller };
        ratio / (1.0 + ratio)
    };
    misses(&sensor::root_case(published), "root as published");
}

/// Only the barrier that is nearer to the path's end counts.
#[test]
fn the_nearer_barrier_alone() {
    let nearer = |[x, y]: [f64; 2], variance: f64, mut draws: CellDraws| {
        let (polarity, a, g) = match y >= 0.0 {
            true => (Polarity::On, 1.0 - x, 1.0 - y),
            false => (Polarity::Off, 1.0 + x, 1.0 + y),
        };
        let touched = g <= 0.0 || draws.uniform() < (-2.0 * a * g / variance).exp();
        touched.then_some(polarity)
    };
    misses(&sensor::first_off(nearer), "the nearer barrier");
    misses(&sensor::bridge_off(nearer), "the nearer barrier of a bridge");
}

/// Microseconds in 32 bits have steps of 1 us at 16.8 s.
#[test]
#[expect(clippy::cast_possible_truncation, reason = "that is the defect")]
fn a_clock_of_32_bits() {
    let clock = |first_us: i64, ns: i64| Some((first_us as f32 + ns as f32 * 1e-3) as i64);
    misses(&clock::absolute_stamps(clock), "a clock of 32 bits");
}

/// `a c - b^2` in 32 bits.
#[test]
#[expect(clippy::cast_possible_truncation, reason = "that is the defect")]
fn the_textbook_determinant() {
    let shape = |needle: &NeedleGaussian| {
        let [along, across] = needle.variances().map(|v| v as f32);
        let (sin, cos) = (needle.angle.sin() as f32, needle.angle.cos() as f32);
        let a = along * cos * cos + across * sin * sin + 0.3;
        let c = along * sin * sin + across * cos * cos + 0.3;
        let b = (along - across) * sin * cos;
        let det = a * c - b * b;
        let camera = needle.view().camera;
        let value = |x: u32, y: u32| {
            let [dx, dy] = [x as f32 + 0.5 - camera.cx as f32, y as f32 + 0.5 - camera.cy as f32];
            f64::from((-0.5 * (c * dx * dx + a * dy * dy - 2.0 * b * dx * dy) / det).exp())
        };
        let [width, height] = [camera.size.width, camera.size.height];
        Ok((0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect())
    };
    misses(
        &judge_needles(scenes::all_needles(), shape, FloatPrecision::Single).unwrap(),
        "the textbook determinant",
    );
}

/// By the arc cosine, which loses half of the digits near the identity.
#[test]
fn a_logarithm_by_the_arc_cosine() {
    let log = |q: DQuat| DVec3::new(q.x, q.y, q.z).normalize_or_zero() * (2.0 * q.w.min(1.0).acos());
    misses(&trajectory::turns_case(log), "log by acos");
}

/// Lengths by the midpoint rule with sixteen points.
#[test]
fn a_length_by_a_fixed_rule() {
    let midpoint =
        |speed: &dyn Fn(f64) -> f64| (0..16).map(|k| speed((f64::from(k) + 0.5) / 16.0) / 16.0).sum();
    misses(&trajectory::length_case(midpoint), "length by the midpoint rule");
}

/// Rates jump at the knots of slerps.
#[test]
fn slerps() {
    let knots: Vec<Se3> = (0..4)
        .map(|i| f64::from(i * i))
        .map(|i| Se3 { rotation: exp_vector(DVec3::new(0.1 * i, 0.2, -0.05 * i)), translation: DVec3::X * i })
        .collect();
    let slerps = CurveKind::SlerpLerp.through(vec![1.0; 3], &knots).unwrap();
    misses(&trajectory::joints_case(&[slerps]), "slerps");
}

/// The naive forms are judged by rows of the program's own table.
#[test]
fn every_row_that_bites_is_one_of_the_table() {
    let stage =
        splat::SplatBench { backends: vec![("cpu", Ok(gs2e_render::backend::Backend::Cpu))], scene: None };
    let all = gs2e_lab::stress::StressArea::ALL.map(|area| gs2e_lab::stress::area_cases(area, &stage));
    let names: Vec<&str> = all.iter().flatten().map(|case| case.name).collect();
    for name in [
        "polarity",
        "inverse-gaussian-root",
        "first-off",
        "bridge",
        "absolute-stamps",
        "needles",
        "log-exp",
        "arc-length",
        "c2-at-knots",
    ] {
        assert!(names.contains(&name), "{name} is no row");
    }
}
