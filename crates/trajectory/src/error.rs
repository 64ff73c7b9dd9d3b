//! Errors and warnings of trajectories.

use super::travel::MAX_POSES;
use gs2e_num::se3::RotationError;
use gs2e_num::se3::rotation::MeanError;
use gs2e_num::se3::rotation_spline::SplineDiverged;

/// The reason why there is no trajectory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// The capture is empty.
    #[error("the capture has no views; at least 1 is needed")]
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
    /// A rotation is not valid.
    #[error("view `{name}`: {source}")]
    Rotation {
        /// Image of the view.
        name: String,
        /// The defect of the rotation.
        source: RotationError,
    },
    /// Neighbouring rotations have no mean.
    #[error("views {}: {source}", quote_names(names))]
    Mean {
        /// Images of the window.
        names: Vec<String>,
        /// The reason.
        source: MeanError,
    },
    /// A parameter is out of range.
    #[error("`{field}` is {found}, wanted {wanted}")]
    Parameter {
        /// The recipe's key.
        field: &'static str,
        /// Its value.
        found: String,
        /// Its range.
        wanted: &'static str,
    },
    /// The path's length overflows, or some steps vanish against it.
    #[error("steps of {smallest:e} are too small for a path of length {length:e}")]
    Uneven {
        /// Smallest step, in the metric.
        smallest: f64,
        /// Length of the path, in the metric.
        length: f64,
    },
    /// A gap in the capture, where the recipe refuses gaps.
    #[error(
        "there is a gap between `{after}` and `{before}`: found {times_median:.1} times the median step, wanted at most {limit}"
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
        /// The reason.
        source: SplineDiverged,
    },
    /// The requested number of poses is too large.
    #[error("{count} poses, wanted at most {MAX_POSES}")]
    TooMany {
        /// The number, or a lower bound of it.
        count: u64,
    },
    /// The requested number of key poses exceeds that of poses.
    #[error(
        "{groups} groups of {keyframes} key poses need {wanted} poses, but the trajectory that they are drawn from has {found}"
    )]
    FewPoses {
        /// Number of groups.
        groups: u32,
        /// Key poses per group.
        keyframes: u32,
        /// Their product.
        wanted: u64,
        /// Number of poses of the base trajectory.
        found: usize,
    },
    /// Neither the parameters nor the capture determine the orbit.
    #[error("the orbit has no {what}: {because}")]
    Orbit {
        /// The missing part.
        what: &'static str,
        /// The reason.
        because: &'static str,
    },
    /// A key pose without a viewing direction.
    #[error("keyframe {keyframe} (from 0) looks along its own up direction, or at its own centre")]
    Facing {
        /// Index of the pose, from 0.
        keyframe: usize,
    },
    /// The flow cannot be measured.
    #[error("no optical flow can be measured at {share} of the path: {because}")]
    Flow {
        /// The place, as a share of the path's length.
        share: f64,
        /// The reason.
        because: String,
    },
    /// Two poses are less than a microsecond apart.
    #[error(
        "poses {step} and {} are less than a microsecond apart: the speed law gives {value:e} times the \
         frame rate",
        step + 1
    )]
    Stamps {
        /// The earlier pose.
        step: usize,
        /// The law's value.
        value: f64,
    },
    /// A value of the speed law is not positive and finite.
    #[error("the speed law gives {value:e} at t = {t}, wanted a positive finite number")]
    Speed {
        /// The place.
        t: f64,
        /// The value there.
        value: f64,
    },
}

/// A remark on a trajectory that was made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryWarning {
    /// A matrix was replaced by the nearest rotation.
    #[error(
        "the matrix of view `{name}` deviates by {deviation:.1e} from a rotation; the nearest rotation is used"
    )]
    Projected {
        /// Image of the view.
        name: String,
        /// Deviation of the matrix.
        deviation: f64,
    },
    /// There are fewer poses than views.
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
        "there is a gap between `{after}` and `{before}`, {times_median:.1} times the median step; the path bridges it"
    )]
    Gap {
        /// The view before the gap.
        after: String,
        /// The view after the gap.
        before: String,
        /// Its length in median steps.
        times_median: f64,
    },
    /// Neighbouring views face opposite ways.
    #[error(
        "views `{after}` and `{before}` are half a turn apart, so the axis between them is ambiguous; its sign was chosen"
    )]
    HalfTurn {
        /// The earlier view.
        after: String,
        /// The later view.
        before: String,
    },
    /// No Bezier curve can be fitted to the rotations.
    #[error(
        "the rotations spread too far around their mean for a Bezier curve; they follow the C2 rotation spline instead"
    )]
    Spread,
    /// The speed varies by a large factor.
    #[error("the fastest step is {ratio:.0} times the slowest; the largest turn is {degrees:.2} degrees")]
    SpeedRange {
        /// Largest speed divided by the smallest.
        ratio: f64,
        /// Largest turn between neighbouring poses.
        degrees: f64,
    },
    /// The law is not smooth.
    #[error("the speed may not be twice differentiable: {because}")]
    Rough {
        /// The parts of the law with corners.
        because: String,
    },
}

fn quote_names(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}
