//! Why there is no trajectory, and what is worth telling about one.

use super::travel::MOST_POSES;
use crate::se3::RotationError;
use crate::se3::rotation::MeanError;
use crate::se3::rotation_spline::Unsettled;

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
    /// There are fewer poses than key poses were asked for.
    #[error(
        "{groups} groups of {keyframes} key poses are {wanted}, but the trajectory that they are drawn from has {found}"
    )]
    FewPoses {
        /// Groups.
        groups: u32,
        /// Key poses of each.
        keyframes: u32,
        /// Their product.
        wanted: u64,
        /// Poses of the trajectory that they are drawn from.
        found: usize,
    },
    /// An orbit that its parameters, or the capture, do not determine.
    #[error("the orbit has no {what}: {because}")]
    Orbit {
        /// Which part of it.
        what: &'static str,
        /// Why.
        because: &'static str,
    },
    /// A key pose that looks nowhere.
    #[error("keyframe {keyframe} (from 0) looks along its own up direction, or at its own centre")]
    Facing {
        /// Which, from 0.
        keyframe: usize,
    },
    /// The flow cannot be measured.
    #[error("there is no optical flow at {share} of the path: {because}")]
    Flow {
        /// Where, as a share of the path's length.
        share: f64,
        /// Why.
        because: String,
    },
    /// Two poses are less than a microsecond apart.
    #[error(
        "poses {step} and {} are less than a microsecond apart: the law gives {value:e} there, as a multiple of the \
         frame rate",
        step + 1
    )]
    Stamps {
        /// The earlier pose.
        step: usize,
        /// The law's value.
        value: f64,
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
    /// Rotations that no Bezier curve can be fitted to.
    #[error(
        "the rotations spread too far around their mean for a Bezier curve; they follow the C2 rotation spline instead"
    )]
    Spread,
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
