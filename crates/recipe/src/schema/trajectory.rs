//! Trajectories as written: a name, one path, and a speed.
//!
//! ```yaml
//! trajectories:
//!   - name: base                        # along the capture, at the paper's speed by default
//!     refine: { window: 2, factor: 5, curve: { bezier: { degree: 9 } } }
//!     speed: { list: { multipliers: [1, 0.5, 2], blend: 0.1, meaning: speed } }
//!   - name: mini                        # three trajectories: mini-0, mini-1, mini-2
//!     novel: { base: base, groups: 3, keyframes: 5, frames: 150, curve: any }
//!   - name: round                       # centre, from and up default to the capture or the scene
//!     orbit: { centre: [0, 0, 0], from: [0, 0.5, 4], up: [0, 1, 0], arc: 360 }
//!     speed: { flow: { px_s: 400, function: "1 + t" } }   # sets the number of poses
//!   - name: by-hand
//!     keyframes:
//!       poses:
//!         - { position: [0, 0, -4], rotation: [0, 0, 0, 1] }
//!         - { position: [1, 0, -4], look_at: [0, 0, 0], up: [0, 1, 0] }
//!       duration: 0.5
//! ```

use super::super::field::{Field, NumberLiteral};
use gs2e_trajectory::refine::{EndRule, GapRule, RotationMean, ViewOrder};
use gs2e_trajectory::speed::SpeedMeaning;
use serde::Deserialize;

/// A trajectory has a name, one of the four paths, and a speed. [trajectories.md](trajectories.md)
/// describes them.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct TrajectorySection {
    /// Name, which is also the folder in the release: letters, digits, `.`, `_` and `-`. Range: at
    /// most 100 bytes. Required.
    pub name: Field<String>,
    /// Path along the captured poses, smoothed and densified. Default: none.
    pub refine: Field<RefineSection>,
    /// Short paths between key poses drawn at random from another trajectory. Default: none.
    pub novel: Field<NovelSection>,
    /// Circle about a point. Default: none.
    pub orbit: Field<OrbitSection>,
    /// Path through poses that the recipe lists. Default: none.
    pub keyframes: Field<KeyframesSection>,
    /// Speed along the path. Default: `function: "0.25*sin(t) + 1.1"` for `refine`, constant for
    /// the others.
    pub speed: Field<SpeedSection>,
}

/// At most one of `factor`, `frames` and `duration` sets the number of poses; with a speed in px/s
/// none may be given.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RefineSection {
    /// Half-width of the smoothing window; 0 turns smoothing off. Unit: poses. Default: `2`.
    pub window: Field<u64>,
    /// Number of poses per view. Default: `5`.
    pub factor: Field<NumberLiteral>,
    /// Number of poses. Default: from `factor`.
    pub frames: Field<u64>,
    /// Duration of the path. Unit: s. Default: from `factor`.
    pub duration: Field<NumberLiteral>,
    /// Order of the views along the path. Default: `name`.
    pub order: Field<ViewOrder>,
    /// Average of the rotations in a window. Default: `mean`.
    pub rotation: Field<RotationMean>,
    /// Smoothing at the ends of the path. Default: `truncated`.
    pub ends: Field<EndRule>,
    /// Metric of the path length. Default: `{}`.
    pub metric: Field<MetricSection>,
    /// Treatment of gaps in the capture. Default: `bridge`.
    pub gaps: Field<GapRule>,
    /// Curve along the smoothed poses. Default: `cubic`.
    pub curve: Field<CurveSection>,
    /// True if the paper's chord lengths are used, without normalisation by the arc length of the
    /// curve. Ablation. Default: `false`.
    pub literal: Field<bool>,
}

/// The path length mixes rotation, in radians, and translation over this scale.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct MetricSection {
    /// Divisor of translation: `scene` for the median distance of the cameras to the point nearest
    /// to all optical axes, `none` for 1, or a number. Unit: scene units. Default: `scene`.
    pub scale: Field<NumberLiteral>,
}

/// Kind of the curve.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CurveSection {
    /// Cubic splines, C2 through every pose.
    Cubic,
    /// A cumulative cubic B-spline, C2, near the poses. Ablation.
    Cumulative,
    /// Straight lines and slerp from pose to pose, which has corners. Ablation.
    SlerpLerp,
    /// One Bezier curve near all poses. Ablation.
    Bezier(Field<BezierSection>),
}

/// Parameters of a Bezier curve: `bezier: { degree: 3 }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct BezierSection {
    /// Degree of the curve. Required.
    pub degree: Field<u64>,
}

/// Makes `groups` trajectories, called `<name>-0` and so on.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct NovelSection {
    /// Trajectory from which the key poses are drawn; it must not be novel. Default: the first that
    /// is not novel.
    pub base: Field<String>,
    /// Number of groups. Default: `3`.
    pub groups: Field<u64>,
    /// Number of key poses per group; no pose is drawn twice. Default: `5`.
    pub keyframes: Field<u64>,
    /// Number of poses per group. Default: `150`.
    pub frames: Field<u64>,
    /// Duration of the path, instead of `frames`. Unit: s. Default: from `frames`.
    pub duration: Field<NumberLiteral>,
    /// Curve along the key poses. Default: `any`.
    pub curve: Field<NovelCurveSection>,
    /// True if chord lengths are used, without normalisation by the arc length of the curve. Ablation.
    /// Default: `false`.
    pub literal: Field<bool>,
}

/// Kind of the curve, as for a refined path, or drawn at random.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum NovelCurveSection {
    /// A fair draw between `cubic` and `bezier`, whose degree is drawn from 2 to 5.
    Any,
    /// Cubic splines, C2 through every key pose.
    Cubic,
    /// A cumulative cubic B-spline, C2, near the poses. Ablation.
    Cumulative,
    /// Straight lines and slerp from pose to pose, which has corners. Ablation.
    SlerpLerp,
    /// One Bezier curve near all key poses.
    Bezier(Field<BezierSection>),
}

/// Points and directions are world coordinates. Missing ones are taken from the capture. Without a
/// capture they are guessed from the scene, as `gs2e info` shows it; without a scene all are
/// required.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct OrbitSection {
    /// Point that the camera looks at. Unit: scene units. Default: from the capture or the scene.
    pub centre: Field<[Field<f64>; 3]>,
    /// First position of the camera. Unit: scene units. Default: from the capture or the scene.
    pub from: Field<[Field<f64>; 3]>,
    /// Direction of the axis, of any length but 0. Default: from the capture or the scene.
    pub up: Field<[Field<f64>; 3]>,
    /// Angle of the arc, right-handed about `up`; not 0. Unit: degrees. Default: `360`.
    pub arc: Field<f64>,
    /// Number of poses. Default: `150`.
    pub frames: Field<u64>,
    /// Duration of the path, instead of `frames`. Unit: s. Default: from `frames`.
    pub duration: Field<NumberLiteral>,
}

/// At most one of `factor`, `frames` and `duration` sets the number of poses.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct KeyframesSection {
    /// Key poses in order of time, at least one. Required.
    pub poses: Field<Vec<Field<PoseSection>>>,
    /// Number of poses per key pose. Default: from `frames`.
    pub factor: Field<NumberLiteral>,
    /// Number of poses. Default: `150`.
    pub frames: Field<u64>,
    /// Duration of the path. Unit: s. Default: from `frames`.
    pub duration: Field<NumberLiteral>,
    /// Metric of the path length. Default: `{}`.
    pub metric: Field<MetricSection>,
    /// Curve along the key poses. Default: `cubic`.
    pub curve: Field<CurveSection>,
    /// True if chord lengths are used, without normalisation by the arc length of the curve. Ablation.
    /// Default: `false`.
    pub literal: Field<bool>,
}

/// A position, and either `rotation` or both `look_at` and `up`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PoseSection {
    /// Centre of the camera, world coordinates. Unit: scene units. Required.
    pub position: Field<[Field<f64>; 3]>,
    /// Rotation from camera to world, OpenCV axes: `[qx, qy, qz, qw]`. Range: of length 1. Default:
    /// from `look_at` and `up`.
    pub rotation: Field<[Field<f64>; 4]>,
    /// Point that the camera looks at, world coordinates. Unit: scene units. Default: none.
    pub look_at: Field<[Field<f64>; 3]>,
    /// Direction in the world that points to the top of the image, of any length but 0. Default:
    /// none.
    pub up: Field<[Field<f64>; 3]>,
}

/// Form of the speed.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SpeedSection {
    /// Relative speed as an expression in `t`, which runs from 0 to 1; proved positive before
    /// anything runs. It may use `+ - * / ^`, `pi`, `e`, `sin cos tan exp log sqrt abs min max`.
    Function(Field<String>),
    /// Levels of relative speed over equal parts of the time.
    List(Field<ListSection>),
    /// Speed of the picture, as the median optical flow; needs the scene, and sets the number of
    /// poses.
    Flow(Field<FlowSection>),
}

/// Levels of the speed: `list: { multipliers: [1, 0.5, 2], blend: 0.1 }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ListSection {
    /// Levels of relative speed, at least one. Required.
    pub multipliers: Field<Vec<Field<f64>>>,
    /// Half-width of the blend between two levels, as a share of a part; the speed is then twice
    /// differentiable. Default: `0.1`.
    pub blend: Field<f64>,
    /// Meaning of a level. Default: `speed`.
    pub meaning: Field<SpeedMeaning>,
}

/// Speed of the picture: `flow: { px_s: 400 }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct FlowSection {
    /// Median optical flow of a frame, averaged over the trajectory. Unit: px/s. Required.
    pub px_s: Field<f64>,
    /// Shape of the speed over time, an expression in `t`. Default: `"1"`.
    pub function: Field<String>,
}
