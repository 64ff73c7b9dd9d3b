//! Velocity of a camera at each pose of a sampled path.
//!
//! It is the derivative, at a pose, of the polynomial through that pose and its neighbours: five
//! poses in all, or every pose of a shorter path. Positions are in world axes. Rotations enter as
//! the rotation vectors from this pose to each of the others, whose derivative here is the body
//! rate. At evenly spaced times away from the ends this is the central difference of fourth order,
//! with an error of `h^4/30` of the fifth derivative. Where the path is only twice differentiable,
//! at the knots of a cubic spline, the error is at most `h^2/6` of the jump of the third
//! derivative.

use glam::DVec3;
use gs2e_num::se3::rotation::log_vector;
use gs2e_num::se3::{Se3, Twist};

/// Maximum number of poses that a derivative is taken from.
const NEAR: usize = 5;

/// Twist of each pose `world_from_camera` at these times, per second. A single pose has a zero
/// twist.
///
/// # Panics
/// There are more or fewer times than poses, or the times are not strictly increasing.
#[must_use]
pub fn pose_twists(poses: &[Se3], seconds: &[f64]) -> Vec<Twist> {
    assert_eq!(poses.len(), seconds.len(), "one time a pose");
    assert!(seconds.windows(2).all(|pair| pair[0] < pair[1]), "times increase");
    (0..poses.len()).map(|at| pose_twist(poses, seconds, at)).collect()
}

/// The first and the last of [`pose_twists`].
///
/// # Panics
/// There is no pose, or not one time a pose.
#[must_use]
pub(crate) fn end_twists(poses: &[Se3], seconds: &[f64]) -> [Twist; 2] {
    assert_eq!(poses.len(), seconds.len(), "one time a pose");
    [0, poses.len() - 1].map(|at| pose_twist(poses, seconds, at))
}

fn pose_twist(poses: &[Se3], seconds: &[f64], at: usize) -> Twist {
    // At the ends the window moves inwards instead of shrinking, which keeps the order of the
    // error.
    let near = NEAR.min(poses.len());
    let first = at.saturating_sub(NEAR / 2).min(poses.len() - near);
    let here = poses[at];
    let mut twist = Twist { linear: DVec3::ZERO, angular: DVec3::ZERO };
    for i in (first..first + near).filter(|i| *i != at) {
        // Relative to this pose both are zero here, so that its own weight is not needed.
        let weight = derivative_weight(&seconds[first..first + near], at - first, i - first);
        twist.linear += weight * (poses[i].translation - here.translation);
        twist.angular += weight * log_vector(here.rotation.conjugate() * poses[i].rotation);
    }
    twist
}

/// The weight of the value at `times[i]` in the derivative at `times[at]` of the polynomial through
/// all.
fn derivative_weight(times: &[f64], at: usize, i: usize) -> f64 {
    // The derivative of a Lagrange polynomial at another node: of its factors, the one that is zero
    // at `at` leaves only its slope, `1 / (times[i] - times[at])`.
    let others = (0..times.len()).filter(|k| *k != i && *k != at);
    others.map(|k| (times[at] - times[k]) / (times[i] - times[k])).product::<f64>() / (times[i] - times[at])
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::se3::rotation::exp_vector;

    /// A path that is quartic in time, turning about a fixed axis by a quartic angle.
    fn quartic(t: f64) -> (Se3, Twist) {
        let value = |c: [f64; 5]| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
        let rate = |c: [f64; 5]| (1..5).rev().fold(0.0, |sum, i| sum * t + i as f64 * c[i]);
        let (x, y, angle) =
            ([1e6, 2.0, -3.0, 1.0, 4.0], [0.0, -1.0, 0.5, 2.0, -1.0], [0.3, 0.7, -0.4, 0.2, 0.9]);
        let axis = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        let pose = Se3 {
            rotation: exp_vector(axis * value(angle)),
            translation: DVec3::new(value(x), value(y), 7.0),
        };
        (pose, Twist { linear: DVec3::new(rate(x), rate(y), 0.0), angular: axis * rate(angle) })
    }

    #[test]
    fn quartic_paths_have_their_exact_rates_at_any_times_and_at_the_ends() {
        for times in [
            (0..9).map(|j| f64::from(j) / 8.0).collect::<Vec<_>>(),
            vec![0.0, 0.1, 0.15, 0.4, 0.41, 0.7, 0.95],
            vec![0.0, 0.2, 0.3, 0.7, 0.9],
        ] {
            let poses: Vec<Se3> = times.iter().map(|t| quartic(*t).0).collect();
            for (found, t) in pose_twists(&poses, &times).into_iter().zip(&times) {
                let wanted = quartic(*t).1;
                // Positions of 1e6 lose 1e-10; times as close as 0.01 amplify it.
                assert!((found.linear - wanted.linear).length() < 1e-6, "{t}: {found:?} {wanted:?}");
                assert!((found.angular - wanted.angular).length() < 1e-11, "{t}: {found:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn the_error_of_a_smooth_path_falls_with_the_fourth_power_of_the_step() {
        // Turning about an axis that turns itself: the body rate is not along any fixed axis.
        let pose = |t: f64| {
            let turn = exp_vector(DVec3::new(0.0, 0.0, 2.0 * t))
                * exp_vector(DVec3::new(0.8 * libm::sin(3.0 * t), 0.0, 0.0));
            Se3 { rotation: turn, translation: DVec3::new(libm::sin(2.0 * t), libm::cos(5.0 * t), t) }
        };
        let wanted = |t: f64| {
            let tilt = 0.8 * libm::sin(3.0 * t);
            let about_z = 2.0 * DVec3::new(0.0, libm::sin(tilt), libm::cos(tilt));
            Twist {
                linear: DVec3::new(2.0 * libm::cos(2.0 * t), -5.0 * libm::sin(5.0 * t), 1.0),
                angular: about_z + DVec3::new(2.4 * libm::cos(3.0 * t), 0.0, 0.0),
            }
        };
        let worst = |n: u32| {
            let times: Vec<f64> = (0..=n).map(|j| f64::from(j) / f64::from(n)).collect();
            let poses: Vec<Se3> = times.iter().map(|t| pose(*t)).collect();
            let found = pose_twists(&poses, &times);
            let inner = 2..times.len() - 2;
            inner.fold([0.0f64; 2], |[linear, angular], j| {
                let wanted = wanted(times[j]);
                let away = [found[j].linear - wanted.linear, found[j].angular - wanted.angular];
                [linear.max(away[0].length()), angular.max(away[1].length())]
            })
        };
        let (coarse, fine) = (worst(50), worst(100));
        for k in 0..2 {
            let order = libm::log2(coarse[k] / fine[k]);
            assert!((3.8..4.2).contains(&order), "{order}");
        }
        // h^4/30 of the fifth derivative, 5^5 here.
        assert!(coarse[0] < 3125.0 / 30.0 / 50f64.powi(4), "{coarse:?}");
    }

    #[test]
    fn short_paths_have_what_their_poses_say() {
        let at = |x: f64| Se3 { translation: DVec3::new(x, 0.0, 0.0), ..Se3::IDENTITY };
        assert!(pose_twists(&[], &[]).is_empty());
        assert_eq!(pose_twists(&[at(1.0)], &[0.0])[0].linear, DVec3::ZERO);
        let two = pose_twists(&[at(1.0), at(4.0)], &[0.0, 2.0]);
        assert!(two.iter().all(|twist| (twist.linear.x - 1.5).abs() < 1e-15));
    }
}
