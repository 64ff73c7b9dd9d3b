//! Paths between poses given by hand, in the order given.

use super::course::{Course, Kind};
use super::curve::Curve;
use super::knots::Knots;
use super::metric::Metric;
use super::refine::{Scale, screen};
use super::travel::{Count, Travel};
use super::{NamedPose, TrajectoryError};
use crate::se3::{Se3, look_at};
use glam::{DQuat, DVec3};
use serde::Serialize;

/// Parameters of a path between given poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Keyframes {
    /// The poses, at least one.
    pub poses: Vec<Keyframe>,
    /// How many poses to make; a factor multiplies the number of key poses.
    pub count: Count,
    /// The curve through them.
    pub curve: Curve,
    /// Weight of translation against rotation.
    pub scale: Scale,
    /// Take the chord lengths as they are.
    pub literal: bool,
}

/// A pose by hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Keyframe {
    /// The camera's centre, world, units.
    pub position: DVec3,
    /// Where it looks.
    pub facing: Facing,
}

/// Where a camera looks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Facing {
    /// Camera to world (OpenCV axes), a unit quaternion x, y, z, w.
    Rotation(DQuat),
    /// At a point, with the image's top towards `up`.
    Towards {
        /// The point, world.
        target: DVec3,
        /// A direction in the world, of any length.
        up: DVec3,
    },
}

impl Keyframe {
    /// Camera to world; what is no rotation is found out by whoever screens it.
    fn pose(&self, number: usize) -> Result<Se3, TrajectoryError> {
        let rotation = match self.facing {
            Facing::Rotation(rotation) => rotation,
            Facing::Towards { target, up } => {
                let rotation = look_at(target - self.position, up);
                rotation.ok_or(TrajectoryError::Facing { keyframe: number })?
            }
        };
        Ok(Se3 { rotation, translation: self.position })
    }
}

impl Keyframes {
    pub(super) fn travel(&self) -> Travel {
        Travel { count: self.count, literal: self.literal }
    }

    pub(super) fn course(&self) -> Result<Course, TrajectoryError> {
        let names: Vec<String> = (0..self.poses.len()).map(|k| format!("keyframe {k}")).collect();
        let named = names.iter().zip(&self.poses).enumerate().map(|(k, (name, keyframe))| {
            keyframe.pose(k).map(|world_from_camera| NamedPose { name, world_from_camera })
        });
        let (origin, views, warnings) = screen(named.collect::<Result<_, _>>()?)?;
        let metric = Metric::new(self.scale, &views)?;
        let knots = Knots::new(&views, metric)?;
        let mut course = Course::through(Kind::Keyframes, knots, self.curve, origin, metric)?;
        course.warnings.splice(..0, warnings);
        Ok(course)
    }
}
