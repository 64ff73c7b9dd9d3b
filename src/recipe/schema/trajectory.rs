//! Trajectories as recipes write them: one path each, and how fast it is followed.
//!
//! ```yaml
//! trajectories:
//!   - name: base                        # along the capture; the speed is the paper's where none is written
//!     refine: { window: 2, factor: 5, curve: { bezier: { degree: 9 } } }
//!     speed: { list: { multipliers: [1, 0.5, 2], blend: 0.1, meaning: speed } }
//!   - name: mini                        # three trajectories: mini-0, mini-1, mini-2
//!     novel: { base: base, groups: 3, keyframes: 5, frames: 150, curve: any }
//!   - name: round                       # without a capture centre, from and up are written
//!     orbit: { centre: [0, 0, 0], from: [0, 0.5, 4], up: [0, 1, 0], arc: 360 }
//!     speed: { flow: { px_s: 400, function: "1 + t" } }   # says itself how many poses there are
//!   - name: by-hand
//!     keyframes:
//!       poses:
//!         - { position: [0, 0, -4], rotation: [0, 0, 0, 1] }
//!         - { position: [1, 0, -4], look_at: [0, 0, 0], up: [0, 1, 0] }
//!       duration: 0.5
//! ```

use super::super::field::{Field, Literal};
use serde::Deserialize;

/// A trajectory: a name, one path, and a speed.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Trajectory {
    /// Required.
    pub name: Field<String>,
    /// Along the captured poses.
    pub refine: Field<Refine>,
    /// Mini-trajectories between key poses drawn from another one.
    pub novel: Field<Novel>,
    /// A circle about a point.
    pub orbit: Field<Orbit>,
    /// Between poses given by hand.
    pub keyframes: Field<Keyframes>,
    /// Default: the paper's law for `refine`, a constant one for all others.
    pub speed: Field<Speed>,
}

/// One of `factor`, `frames` and `duration` says how many poses there are; a speed in px/s says it itself.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Refine {
    pub window: Field<u64>,
    /// Poses a view; default 5.
    pub factor: Field<Literal>,
    pub frames: Field<u64>,
    /// Seconds.
    pub duration: Field<Literal>,
    pub order: Field<Order>,
    pub rotation: Field<Rotation>,
    pub ends: Field<Ends>,
    pub metric: Field<Metric>,
    pub gaps: Field<Gaps>,
    pub curve: Field<Curve>,
    /// Without renormalisation by arc length.
    pub literal: Field<bool>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Order {
    Name,
    Nearest,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Rotation {
    Mean,
    SlerpMidpoint,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Ends {
    Truncated,
    Pinned,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Metric {
    /// `scene`, `none`, or scene units.
    pub scale: Field<Literal>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Gaps {
    Bridge,
    Refuse,
}

/// The curve through the poses.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Curve {
    Cubic,
    Cumulative,
    SlerpLerp,
    Bezier(Field<Bezier>),
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Bezier {
    /// Required.
    pub degree: Field<u64>,
}

/// `groups` trajectories, called `<name>-0` and so on.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Novel {
    /// The trajectory that key poses are drawn from; default: the first that is not novel.
    pub base: Field<String>,
    /// Default 3.
    pub groups: Field<u64>,
    /// Key poses of a group; default 5.
    pub keyframes: Field<u64>,
    /// Poses of a group; default 150.
    pub frames: Field<u64>,
    /// Seconds, in place of `frames`.
    pub duration: Field<Literal>,
    /// Default `any`.
    pub curve: Field<NovelCurve>,
    /// Without renormalisation by arc length.
    pub literal: Field<bool>,
}

/// The curve of a group: drawn, or one of [`Curve`].
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum NovelCurve {
    Any,
    Cubic,
    Cumulative,
    SlerpLerp,
    Bezier(Field<Bezier>),
}

/// Points and directions are in the world, in scene units; what is left out is taken from the capture.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Orbit {
    /// The point looked at.
    pub centre: Field<[Field<f64>; 3]>,
    /// Where the camera starts.
    pub from: Field<[Field<f64>; 3]>,
    /// Along the axis, of any length.
    pub up: Field<[Field<f64>; 3]>,
    /// Degrees, right-handed about `up`; default 360.
    pub arc: Field<f64>,
    /// Default 150.
    pub frames: Field<u64>,
    /// Seconds, in place of `frames`.
    pub duration: Field<Literal>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Keyframes {
    /// At least one, in the order of time; required.
    pub poses: Field<Vec<Field<Pose>>>,
    /// Poses a key pose.
    pub factor: Field<Literal>,
    /// Default 150.
    pub frames: Field<u64>,
    /// Seconds.
    pub duration: Field<Literal>,
    pub metric: Field<Metric>,
    pub curve: Field<Curve>,
    /// Without renormalisation by arc length.
    pub literal: Field<bool>,
}

/// A pose: its centre, and either `rotation` or `look_at` and `up`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Pose {
    /// Required.
    pub position: Field<[Field<f64>; 3]>,
    /// Camera to world, OpenCV axes: qx, qy, qz, qw.
    pub rotation: Field<[Field<f64>; 4]>,
    /// A point in the world.
    pub look_at: Field<[Field<f64>; 3]>,
    /// A direction in the world that the image's top is towards, of any length.
    pub up: Field<[Field<f64>; 3]>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Speed {
    /// An expression in `t`.
    Function(Field<String>),
    /// Levels over equal parts of the time.
    List(Field<List>),
    /// How fast the picture moves.
    Flow(Field<Flow>),
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct List {
    /// At least one; required.
    pub multipliers: Field<Vec<Field<f64>>>,
    /// Half-width of the blend between two levels, in parts; default 0.1.
    pub blend: Field<f64>,
    /// Default `speed`.
    pub meaning: Field<Meaning>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Meaning {
    Speed,
    FrameRate,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Flow {
    /// Median optical flow of a frame, its mean over the trajectory; required.
    pub px_s: Field<f64>,
    /// Its shape over time, an expression in `t`; default 1.
    pub function: Field<String>,
}
