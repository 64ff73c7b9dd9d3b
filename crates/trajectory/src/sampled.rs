//! A trajectory as continuous motion, so that every sampling of it follows the same path.

use crate::curve::{CubicPair, PoseCurve as _};
use crate::{Trajectory, twist};
use glam::DVec3;
use gs2e_num::se3::rotation_spline::SplineDiverged;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::{Se3, Twist};
use gs2e_scene::camera::view::CameraVelocity;

/// The C2 spline over time through the poses of a trajectory.
#[derive(Debug, Clone)]
pub struct SampledPath {
    curve: CubicPair,
    seconds: Vec<f64>,
}

/// Pose and motion at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathMotion {
    /// Pose `world_from_camera`.
    pub pose: Se3,
    /// Velocity in world axes, scene units per second.
    pub velocity: DVec3,
    /// Acceleration in world axes, scene units per second squared.
    pub acceleration: DVec3,
    /// Rate of the rotation in camera axes, rad/s.
    pub angular: DVec3,
}

impl SampledPath {
    /// The spline through these poses at these times.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// There are fewer than two poses, or there is not one strictly increasing time per pose.
    pub fn through_poses(poses: &[Se3], seconds: Vec<f64>) -> Result<Self, SplineDiverged> {
        let steps = seconds.windows(2).map(|pair| pair[1] - pair[0]).collect();
        Ok(Self { curve: CubicPair::through_knots(steps, poses)?, seconds })
    }

    /// As [`SampledPath::through_poses`], with body rates at the ends that are the derivatives of the
    /// polynomial through five poses. The other spline has the mean turns of the first and of the last
    /// interval there, which shows in the rate of the first and last milliseconds, though hardly in the
    /// poses.
    ///
    /// # Errors
    /// The rotation spline does not converge.
    ///
    /// # Panics
    /// As [`SampledPath::through_poses`].
    pub fn with_end_rates(poses: &[Se3], seconds: Vec<f64>) -> Result<Self, SplineDiverged> {
        let steps = seconds.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let ends = twist::end_twists(poses, &seconds).map(|twist| twist.angular);
        Ok(Self { curve: CubicPair::with_end_rates(steps, poses, ends)?, seconds })
    }

    /// Duration from the first pose to the last, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.seconds[self.seconds.len() - 1] - self.seconds[0]
    }

    /// The place on the curve at this time after the first pose, s.
    fn place(&self, seconds: f64) -> CurvePlace {
        let t = self.seconds[0] + seconds;
        let last = self.seconds.len() - 2;
        // The last pose starts no segment, so it stays out of the search.
        let segment = self.seconds[1..=last].partition_point(|start| *start <= t);
        CurvePlace { segment, x: t - self.seconds[segment] }
    }

    /// Pose and motion at this time after the first pose, s.
    #[must_use]
    pub fn motion(&self, seconds: f64) -> PathMotion {
        let at = self.place(seconds);
        let Twist { linear: velocity, angular } = self.curve.twist(at);
        PathMotion {
            pose: self.curve.pose(at),
            velocity,
            acceleration: self.curve.acceleration(at).linear,
            angular,
        }
    }

    /// The pose `world_from_camera` and the velocity of the camera in its own axes, at this time
    /// after the first pose, s.
    #[must_use]
    pub fn at(&self, seconds: f64) -> (Se3, CameraVelocity) {
        let at = self.place(seconds);
        let (pose, twist) = (self.curve.pose(at), self.curve.twist(at));
        // The linear rate of the curve is in world axes, the angular one in the camera's.
        let linear = pose.rotation.conjugate() * twist.linear;
        (pose, CameraVelocity { linear, angular: twist.angular })
    }

    /// Poses and velocities at these microseconds after the first pose. Times beyond the last pose,
    /// whose stamp is rounded, are clamped to it.
    #[must_use]
    pub fn sampled(&self, moments_us: &[i64]) -> (Trajectory, Vec<CameraVelocity>) {
        let at = |us: &i64| self.at((*us as f64 * 1e-6).min(self.seconds()));
        let (world_from_camera, velocities) = moments_us.iter().map(at).unzip();
        (Trajectory { world_from_camera, stamps_us: moments_us.to_vec() }, velocities)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::se3::rotation::exp_vector;

    /// A cubic path with a constant turn about one axis: the spline reproduces it.
    #[test]
    fn a_path_of_its_own_kind_is_met_between_the_poses() {
        let turn = DVec3::new(0.3, -0.2, 0.5);
        let pose = |t: f64| Se3 {
            rotation: exp_vector(turn * t),
            translation: DVec3::new(t * t * t, 1.0 - t, 2.0 * t * t),
        };
        let seconds: Vec<f64> = vec![1.0, 1.2, 1.3, 1.7, 2.0, 2.1];
        let poses: Vec<Se3> = seconds.iter().map(|t| pose(*t)).collect();
        let path = SampledPath::through_poses(&poses, seconds).unwrap();
        assert!((path.seconds() - 1.1).abs() < 1e-12);
        for t in [1.0f64, 1.1, 1.3, 1.55, 1.99, 2.1] {
            let (found, velocity) = path.at(t - 1.0);
            let wanted = pose(t);
            assert!((found.translation - wanted.translation).length() < 1e-12, "{t}");
            assert!((found.rotation.dot(wanted.rotation).abs() - 1.0).abs() < 1e-12, "{t}");
            let world = DVec3::new(3.0 * t * t, -1.0, 4.0 * t);
            assert!((wanted.rotation * velocity.linear - world).length() < 1e-10, "{t}");
            assert!((velocity.angular - turn).length() < 1e-9, "{t}: {:?}", velocity.angular);
            let motion = path.motion(t - 1.0);
            assert!((motion.velocity - world).length() < 1e-10, "{t}");
            assert!((motion.acceleration - DVec3::new(6.0 * t, 0.0, 4.0)).length() < 1e-8, "{t}");
        }
    }
}
