//! Paths through given poses, in the given order.

use super::course::{Course, Kind};
use super::curve::Curve;
use super::knots::Knots;
use super::metric::Metric;
use super::refine::{Scale, screen_views};
use super::travel::{Count, Travel};
use super::{NamedPose, TrajectoryError};
use crate::se3::{Se3, look_at};
use glam::{DQuat, DVec3};
use serde::Serialize;

/// Parameters of a path through given poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Keyframes {
    /// The poses, at least one.
    pub poses: Vec<Keyframe>,
    /// Number of poses to make. A factor multiplies the number of key poses.
    pub count: Count,
    /// The curve through them.
    pub curve: Curve,
    /// Weight of translation against rotation.
    pub scale: Scale,
    /// Whether the chord lengths are used unchanged.
    pub literal: bool,
}

/// A given pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Keyframe {
    /// The camera's centre, world, units.
    pub position: DVec3,
    /// The viewing direction.
    pub facing: Facing,
}

/// The orientation of a given pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Facing {
    /// Camera to world (OpenCV axes), a unit quaternion x, y, z, w.
    Rotation(DQuat),
    /// Towards a point, with the top of the image towards `up`.
    Towards {
        /// The point, world.
        target: DVec3,
        /// A direction in the world, of any length.
        up: DVec3,
    },
}

impl Keyframe {
    /// The pose, camera to world. Invalid rotations are refused when the poses are screened.
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
        let (origin, views, warnings) = screen_views(named.collect::<Result<_, _>>()?)?;
        let metric = Metric::new(self.scale, &views)?;
        let knots = Knots::new(&views, metric)?;
        let mut course = Course::through_knots(Kind::Keyframes, knots, self.curve, origin, metric)?;
        course.warnings.splice(..0, warnings);
        Ok(course)
    }
}
