//! From key poses to a dense path: law, arc length, inversion, pose.

use super::amount;
use crate::measure::{Workload, timed};
use glam::{DMat3, DQuat, DVec3};
use gs2e_num::se3::Se3;
use gs2e_num::se3::arc_length::ArcLength;
use gs2e_num::se3::rotation::canonical_sign;
use gs2e_num::units::Hertz;
use gs2e_trajectory::curve::{CubicPair, MeasuredCurve, PoseCurve};
use gs2e_trajectory::metric::MixedMetric;
use gs2e_trajectory::refine::{RefinePath, refine_views};
use gs2e_trajectory::sample::{PoseSchedule, SummationRule};
use gs2e_trajectory::speed::SpeedChoice;
use gs2e_trajectory::speed::function::SpeedExpression;
use gs2e_trajectory::travel::PoseCount;
use gs2e_trajectory::{NamedPose, PoseTiming};
use std::f64::consts::PI;

/// Views of the short capture, as MVImgNet has them.
const VIEWS: u32 = 30;
/// Poses of the one long path.
const POSES: u32 = 1_000_000;
/// Total number of views and poses in paths of growing length. A sixth are views: the paper's
/// factor is 5.
const SIZES: [u32; 3] = [100_000, 1_000_000, 10_000_000];

pub(super) fn workloads() -> Vec<Workload> {
    let mut all = vec![sampling(), refining(VIEWS, POSES)];
    all.extend(SIZES.map(|size| refining(size / 6, size - size / 6)));
    all
}

fn paper() -> SpeedChoice {
    SpeedChoice::Function(SpeedExpression::parse("0.25*sin(t) + 1.1").expect("it is the paper's"))
}

/// Speed law, inversion and poses on one core, as in a trajectory whose curve is fitted and
/// measured.
fn sampling() -> Workload {
    let knots: Vec<Se3> = (0..VIEWS).map(|i| orbit(i, VIEWS)).collect();
    let metric = MixedMetric { scale: 2.0 };
    let steps: Vec<f64> = knots.windows(2).map(|w| metric.distance(&w[0], &w[1])).collect();
    let speed = paper();
    let run = move || {
        let curve = CubicPair::through_knots(steps.clone(), &knots).expect("an orbit turns evenly");
        let arc = ArcLength::measure_curve(curve.steps(), MeasuredCurve { curve: &curve, metric });
        timed(|| {
            let schedule =
                PoseSchedule::new(&speed, POSES as usize, SummationRule::Sum).expect("the law is positive");
            let mut walk = arc.walk();
            let pose = |share: &f64| {
                let pose = curve.pose(walk.to(share * arc.total()));
                Se3 { rotation: canonical_sign(pose.rotation), ..pose }
            };
            let poses: Vec<Se3> = schedule.shares.iter().map(pose).collect();
            vec![amount(std::hint::black_box(poses).len(), "Mpose")]
        })
    };
    let what =
        format!("law, inversion and pose for {POSES} poses on the curve through {VIEWS} views, one core");
    Workload { part: "trajectory", what, rival: false, run: Box::new(run) }
}

/// A whole trajectory, from views to its report.
fn refining(views: u32, poses: u32) -> Workload {
    let captured: Vec<(String, Se3)> = (0..views).map(|i| (format!("{i:08}.jpg"), orbit(i, views))).collect();
    let params = RefinePath { count: PoseCount::Frames(u64::from(poses)), ..RefinePath::default() };
    let speed = paper();
    let rate = Hertz("2400".parse().expect("it is a ratio"));
    let run = move || {
        let named = captured.iter().map(|(name, pose)| NamedPose { name, world_from_camera: *pose });
        let named: Vec<NamedPose<'_>> = named.collect();
        let timing = PoseTiming { speed: &speed, rate, law: SummationRule::Sum };
        timed(|| {
            let made = refine_views(&named, &params, timing).expect("an orbit can be followed");
            let done = made.trajectory.world_from_camera.len();
            vec![amount(done, "Mpose"), amount(done + named.len(), "Mview+pose")]
        })
    };
    let what = format!("refine {views} views on a half circle into {poses} poses, report included");
    Workload { part: "trajectory", what, rival: false, run: Box::new(run) }
}

/// View `i` of a half circle of radius 2, looking at its centre, unevenly spaced.
fn orbit(i: u32, views: u32) -> Se3 {
    let uneven = f64::from(i) + 0.3 * f64::from(i % 3);
    let phi = PI * uneven / f64::from(views);
    let centre = DVec3::new(2.0 * libm::cos(phi), 2.0 * libm::sin(phi), 0.4);
    let forward = -centre.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let rotation = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    Se3 { rotation, translation: centre }
}
