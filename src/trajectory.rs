//! Camera trajectories: a pose for each time stamp.

pub mod refine;

use crate::se3::Se3;

/// A dense camera path.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Pose of each frame, camera to world, OpenCV camera axes.
    pub world_from_camera: Vec<Se3>,
    /// Stamp of each frame in microseconds, strictly increasing, the first is 0.
    pub stamps_us: Vec<i64>,
}
