//! The poses of a trajectory with their report, and its inertial data.

use super::{Artifact, ArtifactError, ArtifactFiles};
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::units::Ratio;
use gs2e_scene::camera::view::CameraVelocity;
use gs2e_trajectory::Trajectory;
use gs2e_trajectory::report::SpeedReport;
use gs2e_trajectory::speed::SpeedMeaning;
use gs2e_trajectory::twist::pose_twists;
use std::path::PathBuf;

/// A trajectory with its report.
#[derive(Debug)]
pub struct TrajectoryProduct {
    /// The poses.
    pub trajectory: Trajectory,
    /// Its `speed.json`.
    pub report: SpeedReport,
}

impl TrajectoryProduct {
    /// Time of each pose, s: its index divided by the frame rate, exactly, or its stamp if the rate
    /// varies.
    #[must_use]
    pub fn seconds(&self) -> Vec<f64> {
        let stamps = &self.trajectory.stamps_us;
        // A stamp is rounded to a microsecond, about 1e-3 of a step at 2400 Hz, and a velocity
        // divides by the step.
        match self.report.rate.parse::<Ratio>() {
            Ok(rate) if self.report.meaning != SpeedMeaning::FrameRate => {
                let [p, q] = [rate.numerator(), rate.denominator()].map(|n| n as f64);
                (0..stamps.len()).map(|j| j as f64 * q / p).collect()
            }
            _ => stamps.iter().map(|t| *t as f64 * 1e-6).collect(),
        }
    }

    /// Velocity of the camera at each pose, in its own axes.
    #[must_use]
    pub fn velocities(&self) -> Vec<CameraVelocity> {
        let poses = &self.trajectory.world_from_camera;
        // A twist has its linear rate in world axes, its angular rate in the camera's own.
        let own = |(pose, twist): (&Se3, Twist)| CameraVelocity {
            linear: pose.rotation.conjugate() * twist.linear,
            angular: twist.angular,
        };
        poses.iter().zip(pose_twists(poses, &self.seconds())).map(own).collect()
    }
}

impl Artifact for TrajectoryProduct {
    const KIND: &'static str = "trajectory";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        let trajectory = files.read("poses.txt", Trajectory::read_poses)?;
        Ok(Self { trajectory, report: files.json("speed.json")? })
    }
}

/// Inertial data of a trajectory.
#[derive(Debug)]
pub struct ImuRecording {
    /// Name and path of each file.
    pub files: Vec<(String, PathBuf)>,
}

impl Artifact for ImuRecording {
    const KIND: &'static str = "imu";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        Ok(Self { files: files.iter().map(|(name, path)| (name.to_owned(), path.to_owned())).collect() })
    }
}
