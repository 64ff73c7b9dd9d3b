//! Refined trajectories against closed forms, independent quadrature and SciPy.

#![expect(clippy::unwrap_used, reason = "test code outside of test functions")]

use glam::{DQuat, DVec3};
use gs2e::se3::Se3;
use gs2e::se3::rotation::{angle, exp};
use gs2e::speed::Speed;
use gs2e::speed::function::Expression;
use gs2e::trajectory::NamedPose;
use gs2e::trajectory::refine::{Refine, Refined, refine};
use gs2e::units::Hertz;
use std::f64::consts::PI;

/// A camera at `centre` that looks at the origin, its image's down along world -z.
fn look_at_origin(centre: DVec3) -> Se3 {
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let columns = glam::DMat3::from_cols(right, forward.cross(right), forward);
    Se3 { rotation: DQuat::from_mat3(&columns), translation: centre }
}

/// A half circle of radius 2 around the origin, at height 0.4, with uneven steps (coefficient of variation 0.3).
fn orbit(views: usize) -> Vec<(String, Se3)> {
    let uneven = |i: usize| 1.0 + 0.5 * (f64::from(u32::try_from(i * 7 % 11).unwrap()) / 5.0 - 1.0);
    let steps: Vec<f64> = (1..views).map(uneven).collect();
    let total: f64 = steps.iter().sum();
    let mut at = 0.0;
    (0..views)
        .map(|i| {
            let phi = PI * at / total;
            at += steps.get(i).copied().unwrap_or(0.0);
            let centre = DVec3::new(2.0 * libm::cos(phi), 2.0 * libm::sin(phi), 0.4);
            (format!("{i}.jpg"), look_at_origin(centre))
        })
        .collect()
}

fn refined(views: &[(String, Se3)], params: &Refine) -> Refined {
    let named: Vec<NamedPose<'_>> =
        views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose }).collect();
    let speed = Speed::Function(Expression::parse("0.25*sin(t) + 1.1").unwrap());
    refine(&named, params, &speed, Hertz("2400".parse().unwrap())).unwrap()
}

#[test]
fn an_orbit_is_followed() {
    let dense = refined(&orbit(30), &Refine::default());
    let r = &dense.report;
    eprintln!("{:?} {:?} {:?} {:?}", r.mixed_ratio, r.mixed_chord_ratio, r.linear_ratio, r.angular_ratio);
    eprintln!(
        "{} {} {:?} {} {:?}",
        r.scale_distance, r.length, r.length_ratio, r.max_step_deg, dense.warnings
    );
    let p = &dense.trajectory.world_from_camera;
    eprintln!("{:?} {:?}", p[0], p[149]);
    assert_eq!(dense.trajectory.stamps_us[..4], [0, 417, 833, 1250]);
    assert!(angle(p[0].rotation, exp(DVec3::ZERO)) > 0.0);
}
