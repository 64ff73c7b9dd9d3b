//! Refined trajectories, compared with closed forms, independent quadrature and SciPy.

#![expect(clippy::unwrap_used, reason = "test code outside of test functions")]

mod captures;
mod curves;
mod edges;
mod following;
mod goldens;
mod invariance;
mod laws;
mod novel;
mod orbits;
mod pictures;

use glam::{DMat3, DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::units::Hertz;
use gs2e_trajectory::refine::{RefinePath, refine_views};
use gs2e_trajectory::sample::SummationRule;
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::{NamedPose, PoseTiming, TrajectoryBuild, TrajectoryError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

/// Views by name.
type Views = Vec<(String, Se3)>;

const LAW: &str = "0.25*sin(t) + 1.1";

fn law(text: &str) -> SpeedChoice {
    SpeedChoice::Function(SpeedExpression::parse(text).unwrap())
}

fn hertz(text: &str) -> Hertz {
    Hertz(text.parse().unwrap())
}

/// The left sum of a law at 2400 Hz.
fn timing(speed: &SpeedChoice) -> PoseTiming<'_> {
    PoseTiming { speed, rate: hertz("2400"), law: SummationRule::Sum }
}

fn try_refined(
    views: &[(String, Se3)],
    params: &RefinePath,
    law_text: &str,
) -> Result<TrajectoryBuild, TrajectoryError> {
    let named: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    refine_views(&named, params, timing(&law(law_text)))
}

fn refined(views: &[(String, Se3)], params: &RefinePath, law_text: &str) -> TrajectoryBuild {
    try_refined(views, params, law_text).unwrap()
}

fn named(poses: impl IntoIterator<Item = Se3>) -> Views {
    poses.into_iter().enumerate().map(|(i, pose)| (format!("{i}.jpg"), pose)).collect()
}

fn still(rotation: DQuat, translation: DVec3) -> Se3 {
    Se3 { rotation, translation }
}

/// A camera at `centre` that looks at the origin, with its image's down direction along world -z.
fn look_at_origin(centre: DVec3) -> Se3 {
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let columns = DMat3::from_cols(right, forward.cross(right), forward);
    Se3 { rotation: DQuat::from_mat3(&columns), translation: centre }
}

/// A standard normal draw, by Box and Muller.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (2.0 * PI * v).cos()
}

/// The capture of table 2.11: a half circle of radius 2 around the origin at height 0.4, uneven
/// steps with a coefficient of variation of 0.3, centres jittered by `units` and rotations by
/// `degrees` (standard deviations per axis).
fn orbit(views: usize, units: f64, degrees: f64, seed: u64) -> Views {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let steps: Vec<f64> = (1..views).map(|_| (1.0 + 0.3 * normal(&mut rng)).max(0.2)).collect();
    let total: f64 = steps.iter().sum();
    let mut jitter = |size: f64| DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)) * size;
    let mut at = 0.0;
    let poses: Vec<Se3> = (0..views)
        .map(|i| {
            let phi = PI * at / total;
            at += steps.get(i).copied().unwrap_or(0.0);
            let ideal = DVec3::new(2.0 * phi.cos(), 2.0 * phi.sin(), 0.4);
            let mut pose = look_at_origin(ideal + jitter(units));
            pose.rotation *= gs2e_num::se3::rotation::exp_vector(jitter(degrees.to_radians()));
            pose
        })
        .collect();
    named(poses)
}
