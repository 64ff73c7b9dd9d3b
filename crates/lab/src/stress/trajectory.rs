//! Paths and speeds: lengths of curves that almost stop, rotations near zero and near a half turn,
//! speed laws, and the loss of precision far from the origin.

mod lengths;
mod smoothness;

pub use lengths::length_case;
pub use smoothness::{joints_case, rates_case};

use super::answers::{KnownAnswer, find_answers};
use super::{CaseResult, StressArea, StressCase, StressPoint, WorstPoint};
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::{exp_vector, log_vector};
use gs2e_num::se3::{Se3, look_at};
use gs2e_num::units::{Hertz, Ratio};
use gs2e_trajectory::refine::{RefinePath, refine_views};
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::speed::list::SpeedLevels;
use gs2e_trajectory::speed::{SpeedChoice, SpeedLaw, SpeedMeaning};
use gs2e_trajectory::{NamedPose, PoseTiming, TrajectoryBuild};
use std::f64::consts::PI;

/// All cases of paths.
#[must_use]
pub(crate) fn trajectory_cases<'a>() -> Vec<StressCase<'a>> {
    let case = |words, run: fn() -> CaseResult| StressCase::new(StressArea::Trajectory, words, run);
    vec![
        case(
            ["arc-length", "near-cusps down to 1e-9 of the path, a cusp, a speed ratio of 50", "of S"],
            || length_case(lengths::measured_length),
        ),
        case(["inversion", "the same curves, 200 lengths each", "of S"], lengths::inversion_case),
        case(["log-exp", "0, 1e-10, 1e-6, 1e-3, .3, 1, 3, pi - 1e-9, pi up to its sign", "rel"], || {
            turns_case(log_vector)
        }),
        case(["exp", "the same", "1"], exponentials_case),
        case(["published-speed-law", "the integral of 0.25 sin t + 1.1", "1"], law_case),
        case(["blend-integral", "the integral of levels 1, 0.5, 2, blended over 0.1", "1"], blend_case),
        case(["body-rate", "cubic and cumulative curves, against differences of 4th order", "rad"], || {
            rates_case(&smoothness::smooth_curves())
        }),
        case(["c2-at-knots", "one-sided differences of both rates, step 1e-4", "rad, units"], || {
            joints_case(&smoothness::smooth_curves())
        }),
        case(["far-from-origin", "a capture 1e6 units away, and its twin at 0", "of S"], far_away),
    ]
}

/// The rotation vector of an exponential is the vector from which it was made; `log` is the
/// inverse.
#[must_use]
pub fn turns_case(log: impl Fn(DQuat) -> DVec3) -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, .. } in find_answers("turn") {
        let r = DVec3::new(given[0], given[1], given[2]);
        let (angle, found) = (r.length(), log(exp_vector(r)));
        // At a half turn, both directions are the same turn.
        let ends = if angle > PI - 1e-12 { [r, -r] } else { [r, r] };
        let error = (found - ends[0]).length().min((found - ends[1]).length());
        let error = if angle > 0.0 { error / angle } else { error };
        let point = StressPoint { computed: found.length(), answer: angle, error, limit: 1e-15 };
        worst.see(point, || format!("{angle} about {:.2}", r.normalize_or_zero()));
    }
    worst.found()
}

fn exponentials_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    for KnownAnswer { given, wanted } in find_answers("turn") {
        let found = exp_vector(DVec3::new(given[0], given[1], given[2])).to_array();
        for (i, (found, wanted)) in found.into_iter().zip(wanted).enumerate() {
            worst.see(StressPoint::absolute_error(found, wanted, 1e-15), || {
                format!("component {i} of {given:?}")
            });
        }
    }
    worst.found()
}

fn law_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    let law = SpeedExpression::parse("0.25*sin(t) + 1.1").expect("the published law");
    let answers = find_answers("law");
    let found = law.distances(answers.len() - 1);
    for (found, KnownAnswer { given, wanted }) in found.into_iter().zip(answers) {
        worst.see(StressPoint::absolute_error(found, wanted[0], 1e-14), || format!("t = {}", given[0]));
    }
    worst.found()
}

fn blend_case() -> CaseResult {
    let mut worst = WorstPoint::default();
    let list = SpeedLevels::new(vec![1.0, 0.5, 2.0], 0.1, SpeedMeaning::Speed).expect("positive levels");
    for KnownAnswer { given, wanted } in find_answers("blend") {
        let point = StressPoint::absolute_error(list.distance(given[0]), wanted[0], 1e-14);
        worst.see(point, || format!("t = {}", given[0]));
    }
    worst.found()
}

/// A hand-held half circle about the origin, with centres on a grid of 2^-20, so that adding an
/// offset of 1e6 or 2^20 loses nothing.
fn half_circle(offset: DVec3) -> Vec<(String, Se3)> {
    let pose = |i: i32| {
        let phi = PI * f64::from(i) / 29.0 + 0.02 * libm::sin(f64::from(7 * i));
        let centre = DVec3::new(2.0 * libm::cos(phi), 2.0 * libm::sin(phi), 0.4);
        let centre = (centre * f64::from(1 << 20)).round() / f64::from(1 << 20);
        let rotation = look_at(-centre, DVec3::Z).expect("it looks inwards");
        (format!("{i:02}.jpg"), Se3 { rotation, translation: centre + offset })
    };
    (0..30).map(pose).collect()
}

fn make_trajectory(offset: DVec3) -> TrajectoryBuild {
    let views = half_circle(offset);
    let views: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    let speed =
        SpeedChoice::Function(SpeedExpression::parse("0.25*sin(t) + 1.1").expect("the published law"));
    let rate = Hertz(Ratio::new(2400, 1).expect("positive"));
    let timing = PoseTiming { speed: &speed, rate, law: SummationRule::Sum };
    refine_views(&views, &RefinePath::default(), timing).expect("a sound capture")
}

fn far_away() -> CaseResult {
    let mut worst = WorstPoint::default();
    let here = make_trajectory(DVec3::ZERO).trajectory.world_from_camera;
    let length: f64 = here.windows(2).map(|w| (w[1].translation - w[0].translation).length()).sum();
    for offset in [DVec3::splat(1e6), DVec3::new(1.0, -2.0, 0.5) * f64::from(1 << 20)] {
        let there = make_trajectory(offset).trajectory.world_from_camera;
        for (i, (a, b)) in here.iter().zip(&there).enumerate() {
            let way = (b.translation - offset - a.translation).length();
            worst.see(
                StressPoint { error: way / length, ..StressPoint::absolute_error(way, 0.0, 1e-9) },
                || format!("pose {i}"),
            );
            let turn = log_vector(a.rotation.conjugate() * b.rotation).length();
            worst.see(StressPoint::absolute_error(turn, 0.0, 1e-9), || format!("turn of pose {i}"));
        }
    }
    worst.found()
}
