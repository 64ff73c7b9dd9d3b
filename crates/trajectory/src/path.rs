//! The path of a trajectory, as chosen by a recipe.

use super::course::PoseCourse;
use super::curve::CurveKind;
use super::flow::FlowMeter;
use super::keyframes::KeyframePath;
use super::novel::{BaseTrajectory, GroupCurve, NovelGroup};
use super::orbit::OrbitPath;
use super::refine::RefinePath;
use super::travel::{PoseCount, TravelPlan};
use super::{NamedPose, PoseTiming, TrajectoryBuild, TrajectoryError};
use gs2e_num::units::Hertz;
use gs2e_scene::camera::Camera;
use gs2e_scene::survey::SceneSurvey;
use serde::Serialize;

/// A path, by its kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraPath {
    /// Along the captured poses (the paper's 3.5.1).
    Refine(RefinePath),
    /// Between key poses drawn from another trajectory (3.5.2).
    Novel(NovelGroup),
    /// A circle about a point.
    Orbit(OrbitPath),
    /// Between given poses.
    Keyframes(KeyframePath),
}

impl CameraPath {
    /// Returns true if the direction of the path may jump at a knot.
    #[must_use]
    pub fn has_corners(&self) -> bool {
        match self {
            Self::Refine(path) => path.curve == CurveKind::SlerpLerp,
            Self::Keyframes(path) => path.curve == CurveKind::SlerpLerp,
            Self::Novel(group) => group.curve == GroupCurve::Fixed(CurveKind::SlerpLerp),
            Self::Orbit(_) => false,
        }
    }
}

/// The inputs of all kinds of paths; each kind uses some of them.
#[derive(Debug, Clone, Copy)]
pub struct PathInputs<'a> {
    /// The views of the capture, in any order; empty without a capture.
    pub views: &'a [NamedPose<'a>],
    /// The trajectory from which [`CameraPath::Novel`] draws its key poses.
    pub base: Option<BaseTrajectory<'a>>,
    /// The scene without a capture, for [`CameraPath::Orbit`].
    pub scene: Option<SceneFraming>,
}

/// A scene, and the camera that sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneFraming {
    /// The scene.
    pub survey: SceneSurvey,
    /// The camera.
    pub camera: Camera,
}

impl CameraPath {
    /// The trajectory along this path. `meter` is used if the speed is a flow.
    ///
    /// # Errors
    /// The path cannot be made from the inputs, a parameter is out of range, or the flow cannot be
    /// measured.
    ///
    /// # Panics
    /// [`CameraPath::Novel`] has no base.
    pub fn make(
        &self,
        ground: PathInputs<'_>,
        timing: PoseTiming<'_>,
        meter: Option<&mut dyn FlowMeter>,
    ) -> Result<TrajectoryBuild, TrajectoryError> {
        self.travel().along(self.course(ground)?, timing, meter)
    }

    /// Returns true if the path is made from the views of a capture, or without a capture from the
    /// scene. The base of a novel path may need views even if this is false.
    #[must_use]
    pub fn needs_views(&self) -> bool {
        match self {
            Self::Refine(_) => true,
            Self::Orbit(orbit) => orbit.centre.is_none() || orbit.from.is_none() || orbit.up.is_none(),
            Self::Novel(_) | Self::Keyframes(_) => false,
        }
    }

    /// The number of poses, if the path states it. Otherwise the views or the speed decide.
    #[must_use]
    pub fn stated_poses(&self, rate: Hertz) -> Option<f64> {
        match self.travel().count {
            PoseCount::Frames(frames) => Some(frames as f64),
            PoseCount::Duration(seconds) => Some(1.0 + (seconds.to_f64() * rate.to_f64()).ceil()),
            PoseCount::Factor(_) | PoseCount::Flow => None,
        }
    }

    fn course(&self, ground: PathInputs<'_>) -> Result<PoseCourse, TrajectoryError> {
        match self {
            Self::Refine(refine) => refine.course(ground.views),
            Self::Novel(novel) => novel.course(ground.base.expect("a novel path is drawn from another")),
            Self::Orbit(orbit) => orbit.course(ground.views, ground.scene),
            Self::Keyframes(keyframes) => keyframes.course(),
        }
    }

    fn travel(&self) -> TravelPlan {
        match self {
            Self::Refine(refine) => refine.travel(),
            Self::Novel(novel) => novel.travel(),
            Self::Orbit(orbit) => orbit.travel(),
            Self::Keyframes(keyframes) => keyframes.travel(),
        }
    }
}
