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
//!
//! Poses and exact rates come from `gs2e-num`, the camera and the survey of a scene from `gs2e-scene`,
//! and the memory limits of readers from `gs2e-files`. `gs2e-recipe` parses the paths and `gs2e-build`
//! makes them. `gs2e-render` measures the motion of the picture, and `gs2e-sampling` chooses frames.
//! The poses are read by `gs2e-source`, `gs2e-check`, `gs2e-dataset`, `gs2e-release`, `gs2e-audit`,
//! `gs2e-export` and `gs2e-lab`; `gs2e-tree` reads those of a release.
//!
//! # Examples
//!
//! ```
//! # use glam::DVec3;
//! # use gs2e_num::units::Hertz;
//! use gs2e_trajectory::speed::{SpeedChoice, function::SpeedExpression};
//! use gs2e_trajectory::{PoseTiming, orbit::OrbitPath, path, sample::SummationRule, travel::PoseCount};
//!
//! // A quarter turn from x to y about z, in 91 poses at 100 Hz and at a constant speed.
//! let speed = SpeedChoice::Function(SpeedExpression::parse("1")?);
//! let timing = PoseTiming { speed: &speed, rate: Hertz("100".parse()?), law: SummationRule::Integral };
//! let [centre, from, up] = [DVec3::ZERO, DVec3::X, DVec3::Z].map(Some);
//! let orbit = OrbitPath { centre, from, up, arc: 90.0, count: PoseCount::Frames(91) };
//! let ground = path::PathInputs { views: &[], base: None, scene: None };
//! let found = path::CameraPath::Orbit(orbit).make(ground, timing, None)?.trajectory;
//! assert!((found.world_from_camera[90].translation - DVec3::Y).length() < 1e-9);
//! assert_eq!(found.stamps_us[90], 900_000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
pub use travel::{MAX_POSES, MAX_RATE_HZ, MIN_RATE_HZ, PoseTiming, TrajectoryBuild};

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
