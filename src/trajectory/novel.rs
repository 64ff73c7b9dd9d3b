//! The paper's 3.5.2: mini-trajectories between key poses drawn from a dense one.

use super::TrajectoryError;
use super::course::Course;
use super::curve::Curve;
use super::travel::{Count, Travel};
use crate::se3::Se3;
use crate::seed::Seed;
use serde::Serialize;

/// One group of key poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Novel {
    /// Which group, from 0.
    pub group: u32,
    /// How many groups share the draw.
    pub groups: u32,
    /// Key poses of a group, at least 2.
    pub keyframes: u32,
    /// How many poses to make.
    pub count: Count,
    /// The curve through the key poses.
    pub curve: NovelCurve,
    /// Take the chord lengths as they are.
    pub literal: bool,
    /// Seed of the draw of key poses, one for all groups.
    pub keyframes_seed: Seed,
    /// Seed of the draw of curves, one for all groups.
    pub curve_seed: Seed,
}

/// The curve of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum NovelCurve {
    /// A fair coin picks `cubic` or `bezier`, whose degree is then drawn from 2 to 5.
    Any,
    /// This one.
    Fixed(Curve),
}

/// The trajectory that key poses are drawn from.
#[derive(Debug, Clone, Copy)]
pub struct Base<'a> {
    /// Its poses, camera to world.
    pub poses: &'a [Se3],
    /// Its scale distance D, units.
    pub scale: f64,
}

impl Novel {
    pub(super) fn travel(&self) -> Travel {
        Travel { count: self.count, literal: self.literal }
    }

    pub(super) fn course(&self, _base: Base<'_>) -> Result<Course, TrajectoryError> {
        unimplemented!()
    }
}
