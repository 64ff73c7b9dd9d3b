//! The paper's 3.5.1: smooth the captured poses, measure them, and sample them densely at a prescribed speed.

use crate::units::Ratio;
use serde::Serialize;

/// Parameters of a refined trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refine {
    /// Half-width of the smoothing window, in poses; 0 means none.
    pub window: u32,
    /// How many poses to make.
    pub count: Count,
    /// Order of the views.
    pub order: Order,
    /// How rotations are smoothed.
    pub rotation: RotationMean,
    /// What smoothing does at the ends.
    pub ends: Ends,
    /// Weight of translation against rotation.
    pub scale: Scale,
    /// What to do about gaps in the capture.
    pub gaps: Gaps,
    /// The curve through the poses.
    pub curve: Curve,
    /// Take the paper's chord lengths as they are, without renormalising by the fitted curve's arc length.
    pub literal: bool,
}

/// How many poses a trajectory has.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Count {
    /// `ceil(factor * views)`.
    Factor(Ratio),
    /// So many.
    Frames(u64),
    /// `1 + ceil(seconds * rate)`.
    Duration(Ratio),
}

/// Order of the views along the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// Natural order of the image file names.
    Name,
    /// Greedy nearest neighbour from the first name.
    Nearest,
}

/// How a window's rotations are averaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RotationMean {
    /// Karcher mean.
    Mean,
    /// The literal reading of equation 8.
    SlerpMidpoint,
}

/// What smoothing does at the ends of the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ends {
    /// Windows are cut off, which pulls the ends in (the paper's definition).
    Truncated,
    /// Windows shrink, which keeps both end poses.
    Pinned,
}

/// The distance that translation is divided by in the mixed metric.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Median distance of the centres to the point nearest all optical axes.
    Scene,
    /// 1: translation counts in scene units.
    None,
    /// This many scene units.
    Fixed(f64),
}

/// What to do where the capture has a gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Gaps {
    /// Bridge it and record it.
    Bridge,
    /// Refuse the capture.
    Refuse,
}

/// The curve through the smoothed poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// C2 cubic spline on centres, C2 rotation spline.
    Cubic,
}
