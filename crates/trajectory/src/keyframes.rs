//! Paths through given poses, in the given order.

use super::course::{CourseKind, PoseCourse};
use super::curve::CurveKind;
use super::knots::KnotSequence;
use super::metric::MixedMetric;
use super::refine::{TranslationScale, screen_views};
use super::travel::{PoseCount, TravelPlan};
use super::{NamedPose, TrajectoryError};
use glam::{DQuat, DVec3};
use gs2e_num::se3::{Se3, look_at};
use serde::Serialize;

/// Parameters of a path through given poses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeyframePath {
    /// The poses, at least one.
    pub poses: Vec<Keyframe>,
    /// Number of poses to make. A factor multiplies the number of key poses.
    pub count: PoseCount,
    /// The curve through them.
    pub curve: CurveKind,
    /// Weight of translation against rotation.
    pub scale: TranslationScale,
    /// True if the chord lengths are used unchanged.
    pub literal: bool,
}

/// A given pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Keyframe {
    /// The camera's centre, world, units.
    pub position: DVec3,
    /// The viewing direction.
    pub facing: CameraFacing,
}

/// The orientation of a given pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraFacing {
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
            CameraFacing::Rotation(rotation) => rotation,
            CameraFacing::Towards { target, up } => {
                let rotation = look_at(target - self.position, up);
                rotation.ok_or(TrajectoryError::Facing { keyframe: number })?
            }
        };
        Ok(Se3 { rotation, translation: self.position })
    }
}

impl KeyframePath {
    pub(super) fn travel(&self) -> TravelPlan {
        TravelPlan { count: self.count, literal: self.literal }
    }

    pub(super) fn course(&self) -> Result<PoseCourse, TrajectoryError> {
        // Errors name a view by its image. A key pose has none and gets its index.
        let names: Vec<String> = (0..self.poses.len()).map(|k| format!("keyframe {k}")).collect();
        let named = names.iter().zip(&self.poses).enumerate().map(|(k, (name, keyframe))| {
            keyframe.pose(k).map(|world_from_camera| NamedPose { name, world_from_camera })
        });
        let (origin, views, warnings) = screen_views(named.collect::<Result<_, _>>()?)?;
        let metric = MixedMetric::new(self.scale, &views)?;
        let knots = KnotSequence::new(&views, metric)?;
        let mut course = PoseCourse::through_knots(CourseKind::Keyframes, knots, self.curve, origin, metric)?;
        course.warnings.splice(..0, warnings);
        Ok(course)
    }
}
