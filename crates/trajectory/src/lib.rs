//! Camera trajectories: one pose for each time stamp.
//!
//! ```text
//! refine     views -> order -> smooth -> knots ─┐
//! novel      poses of another -> draw -> knots ─┼─> curve ─┐
//! keyframes  poses by hand ------------> knots ─┘          ├─> course
//! orbit      a point and an axis ---------------> circle ──┘
//!
//! course + speed law -> travel -> Trajectory, SpeedReport
//! ```
//! A [`path`] makes a course; [`travel`] follows it, and only travel knows speed and time. Each
//! step is a file. One [`metric`] measures knots, merges them, and finds gaps.

mod course;
pub mod curve;
mod error;
pub mod flow;
pub mod imu;
pub mod keyframes;
pub mod knots;
pub mod metric;
pub mod mount;
pub mod novel;
pub mod orbit;
pub mod order;
pub mod path;
pub mod picture;
pub mod refine;
pub mod report;
pub mod sample;
pub mod sampled;
pub mod smooth;
pub mod speed;
pub mod text;
pub mod transforms;
pub mod travel;
pub mod twist;
pub mod walk;

pub use course::CourseKind;
pub use error::{TrajectoryError, TrajectoryWarning};
pub use travel::{MAX_POSES, MAX_RATE_HZ, MIN_RATE_HZ, MadeTrajectory, PoseTiming};

use gs2e_num::se3::Se3;

/// A dense camera path.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Pose of each frame, camera to world, OpenCV camera axes.
    pub world_from_camera: Vec<Se3>,
    /// Stamp of each frame in microseconds, strictly increasing, from 0.
    pub stamps_us: Vec<i64>,
}

impl Trajectory {
    /// Time of a pose by its stamp, s.
    ///
    /// # Panics
    /// There is no pose of this number.
    #[must_use]
    pub fn seconds(&self, index: usize) -> f64 {
        self.stamps_us[index] as f64 * 1e-6
    }
}

/// A view of a capture: the name of its image, and its pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedPose<'a> {
    /// Image file name as the source gives it.
    pub name: &'a str,
    /// Camera to world, OpenCV camera axes.
    pub world_from_camera: Se3,
}
