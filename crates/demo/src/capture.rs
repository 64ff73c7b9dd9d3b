//! The capture of the still life: photos from an arc, by hand.

use super::StillLife;
use super::draw::SceneDraws;
use super::primitive::{table_point, turn_sine};
use glam::{DMat3, DQuat, DVec3};
use gs2e_image::Size;
use gs2e_num::se3::Se3;
use gs2e_scene::camera::Camera;
use gs2e_source::{Capture, CapturedView, LensModel};

/// The photos' size and focal length, px: a horizontal field of view of 52.2 degrees.
const SIZE: Size = Size { width: 640, height: 360 };
const FOCAL: f64 = 653.0;
/// Target of the camera, and its distance and height.
const TARGET: DVec3 = DVec3::new(0.12, -0.56, 0.12);
const DISTANCE: f64 = 4.25;
const RISE: f64 = 15.5 / 360.0;
/// Standard deviations of the hand: position in units, direction in turns.
const SHAKE: f64 = 0.0035;
const TREMBLE: f64 = 0.05 / 360.0;

/// Streams of the draws for the arc and for the hand.
const STREAM: u64 = 2 << 32;

pub(super) fn arc_capture(life: &StillLife) -> Capture {
    let mut draws = SceneDraws::new(life.seed, STREAM);
    let turns = uneven_angles(life.views, life.arc / 360.0, &mut draws);
    // Names of equal length sort in the order of the views.
    let digits = life.views.to_string().len().max(3);
    let views = turns.into_iter().enumerate().map(|(k, turns)| CapturedView {
        name: format!("{:0digits$}.jpg", k + 1),
        world_from_camera: arc_pose(turns, &mut draws),
        camera: Camera::pinhole(
            SIZE,
            [FOCAL, FOCAL, f64::from(SIZE.width) / 2.0, f64::from(SIZE.height) / 2.0],
        ),
        lens: LensModel::Pinhole,
        sha256: None,
    });
    views.collect::<Vec<CapturedView>>().into()
}

/// `count` angles from `-arc / 2` to `arc / 2`, in turns, with steps that differ by up to a factor
/// of two.
fn uneven_angles(count: u32, arc: f64, draws: &mut SceneDraws) -> Vec<f64> {
    let mut sums = vec![0.0];
    for k in 1..count {
        sums.push(sums[k as usize - 1] + draws.uniform(0.67, 1.33));
    }
    let total = sums[sums.len() - 1];
    sums.into_iter().map(|s| arc * (s / total - 0.5)).collect()
}

/// The camera at this angle around the target. Its height varies slightly along the arc, and it
/// trembles.
fn arc_pose(turns: f64, draws: &mut SceneDraws) -> Se3 {
    let (sin, cos) = turn_sine(turns);
    let (up, out) = turn_sine(RISE + 0.004 * turn_sine(4.0 * turns).0);
    let shake = |draws: &mut SceneDraws| DVec3::new(draws.bell(SHAKE), draws.bell(SHAKE), draws.bell(SHAKE));
    // The draws of place, aim and roll come in this order: another order would be another capture.
    let centre = TARGET + DISTANCE * table_point(out * sin, up, -out * cos) + shake(draws);
    let aim = TARGET + shake(draws);
    let forward = (aim - centre).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let steady = DMat3::from_cols(right, forward.cross(right), forward);
    let rotation = DQuat::from_mat3(&steady) * roll_turn(draws.bell(TREMBLE));
    Se3 { rotation: rotation.normalize(), translation: centre }
}

/// A rotation about the optical axis.
fn roll_turn(turns: f64) -> DQuat {
    let (sin, cos) = turn_sine(turns / 2.0);
    DQuat::from_xyzw(0.0, 0.0, sin, cos)
}
