//! From key poses to a dense path: law, arc length, inversion, pose.

use super::amount;
use crate::measure::{Workload, timed};
use glam::{DMat3, DQuat, DVec3};
use gs2e::se3::Se3;
use gs2e::speed::Speed;
use gs2e::speed::function::Expression;
use gs2e::trajectory::refine::{Refine, refine};
use gs2e::trajectory::sample::Summation;
use gs2e::trajectory::travel::Count;
use gs2e::trajectory::{NamedPose, Timing};
use gs2e::units::Hertz;

const VIEWS: u32 = 30;
const POSES: u32 = 100_000;

pub(super) fn workloads() -> Vec<Workload> {
    let views: Vec<(String, Se3)> = (0..VIEWS).map(|i| (format!("{i:03}.jpg"), orbit(i))).collect();
    let params = Refine { count: Count::Frames(u64::from(POSES)), ..Refine::default() };
    let speed = Speed::Function(Expression::parse("0.25*sin(t) + 1.1").expect("it is the paper's"));
    let rate = Hertz("2400".parse().expect("it is a ratio"));
    let run = move || {
        let named = views.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose });
        let views: Vec<NamedPose<'_>> = named.collect();
        let timing = Timing { speed: &speed, rate, law: Summation::Sum };
        timed(|| {
            let refined = refine(&views, &params, timing).expect("an orbit can be followed");
            vec![amount(refined.trajectory.world_from_camera.len(), "Mpose")]
        })
    };
    let what = format!("refine {VIEWS} views on a half circle into {POSES} poses, reports included");
    vec![Workload { part: "trajectory", what, rival: false, run: Box::new(run) }]
}

/// View `i` of a half circle of radius 2, looking at its centre, unevenly spaced.
fn orbit(i: u32) -> Se3 {
    let uneven = f64::from(i) + 0.3 * f64::from(i % 3);
    let phi = std::f64::consts::PI * uneven / f64::from(VIEWS);
    let centre = DVec3::new(2.0 * libm::cos(phi), 2.0 * libm::sin(phi), 0.4);
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    Se3 { rotation, translation: centre }
}
