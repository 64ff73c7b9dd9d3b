//! Camera trajectories: a pose for each time stamp.
//!
//! ```text
//! views -> order -> smooth -> knots (metric, merging, gaps) -> curve -> sample (speed law) -> Trajectory, Report
//! ```
//! [`refine`](refine::refine) is that chain for the paper's section 3.5.1. Each step is a file of its own.

pub mod curve;
pub mod knots;
pub mod metric;
pub mod order;
pub mod picture;
pub mod refine;
pub mod report;
pub mod sample;
pub mod smooth;
pub mod text;

use crate::se3::rotation::MeanError;
use crate::se3::rotation_spline::Unsettled;
use crate::se3::{RotationError, Se3};

/// A dense camera path.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Pose of each frame, camera to world, OpenCV camera axes.
    pub world_from_camera: Vec<Se3>,
    /// Stamp of each frame in microseconds, strictly increasing, the first is 0.
    pub stamps_us: Vec<i64>,
}

/// A view of a capture: the name of its image and where it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedPose<'a> {
    /// Image file name as the source gives it.
    pub name: &'a str,
    /// Camera to world, OpenCV camera axes.
    pub world_from_camera: Se3,
}

/// More poses than this are refused: 2.3 hours at 2400 Hz.
pub const MOST_POSES: u64 = 20_000_000;

/// Why there is no trajectory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// The capture is empty.
    #[error("the capture has no views, at least 1 is needed")]
    NoViews,
    /// Two views share a name, so their order is not known.
    #[error("two views are named `{name}`")]
    SameName {
        /// The name.
        name: String,
    },
    /// A centre is NaN, infinite, or absurdly far out.
    #[error("the centre of view `{name}` is not finite or beyond 1e100 units")]
    Centre {
        /// Image of the view.
        name: String,
    },
    /// A rotation is none.
    #[error("view `{name}`: {source}")]
    Rotation {
        /// Image of the view.
        name: String,
        /// What was found.
        source: RotationError,
    },
    /// Neighbouring rotations have no mean.
    #[error("views {}: {source}", quoted(names))]
    Mean {
        /// Images of the window.
        names: Vec<String>,
        /// Why.
        source: MeanError,
    },
    /// A parameter is out of range.
    #[error("`{field}` is {found}, {wanted} was wanted")]
    Parameter {
        /// The recipe's key.
        field: &'static str,
        /// Its value.
        found: String,
        /// Its range.
        wanted: &'static str,
    },
    /// The path's length overflows, or holds steps that are nothing against it.
    #[error("no curve holds steps of {smallest:e} on a path of length {length:e}")]
    Uneven {
        /// Smallest step, in the metric.
        smallest: f64,
        /// Length of the path, in the metric.
        length: f64,
    },
    /// A gap in the capture that was not to be bridged.
    #[error(
        "there is a gap between `{after}` and `{before}`: {times_median:.1} times the median step, {limit} at most"
    )]
    Gap {
        /// The view before the gap.
        after: String,
        /// The view after the gap.
        before: String,
        /// Its length in median steps.
        times_median: f64,
        /// The limit.
        limit: f64,
    },
    /// The rotations between these views turn too unevenly for a C2 curve.
    #[error("{source} (views `{first}` to `{last}`)")]
    Curve {
        /// The first view.
        first: String,
        /// The last view.
        last: String,
        /// Why.
        source: Unsettled,
    },
    /// Too many poses were asked for.
    #[error("{count} poses were asked for, at most {MOST_POSES} are made")]
    TooMany {
        /// The number, or a lower bound of it.
        count: u64,
    },
    /// The law's values do not add up.
    #[error("the speed law gives {value:e} at t = {t}, a positive finite number was wanted")]
    Speed {
        /// Where.
        t: f64,
        /// Its value there.
        value: f64,
    },
}

/// What the user should know about a trajectory that was made nonetheless.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Warning {
    /// A rotation was projected.
    #[error("the rotation of view `{name}` was off by {deviation:.1e}; the nearest rotation was taken")]
    Projected {
        /// Image of the view.
        name: String,
        /// How far off it was.
        deviation: f64,
    },
    /// Fewer poses than views.
    #[error("factor {factor} makes no more poses than there are views")]
    Sparse {
        /// The factor as a ratio.
        factor: String,
    },
    /// The camera does not move.
    #[error("the camera does not move: {views} views give one pose")]
    Still {
        /// Number of views.
        views: usize,
    },
    /// A gap was bridged.
    #[error(
        "there is a gap between `{after}` and `{before}`, {times_median:.1} times the median step; it was bridged"
    )]
    Gap {
        /// The view before the gap.
        after: String,
        /// The view after the gap.
        before: String,
        /// Its length in median steps.
        times_median: f64,
    },
    /// Neighbours face opposite ways.
    #[error("views `{after}` and `{before}` are half a turn apart; the axis between them was chosen by sign")]
    HalfTurn {
        /// The earlier view.
        after: String,
        /// The later view.
        before: String,
    },
    /// The speed varies wildly.
    #[error("the fastest step is {ratio:.0} times the slowest; the largest turns by {degrees:.2} degrees")]
    SpeedRange {
        /// Largest speed over smallest.
        ratio: f64,
        /// Largest turn between neighbouring poses.
        degrees: f64,
    },
    /// The law is not smooth.
    #[error("the speed need not be twice differentiable: {because}")]
    Rough {
        /// What in the law has corners.
        because: String,
    },
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}
