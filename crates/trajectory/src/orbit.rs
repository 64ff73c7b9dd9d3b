//! Orbits: a camera on a circle about an axis, looking at a point on the axis.
//!
//! With a capture, defaults come from it: the point nearest all optical axes, the mean of the
//! cameras' up directions, and the centre of the first view. Without a capture, they come from a
//! survey of the scene ([`gs2e_scene::survey`]).

use super::course::{CourseGeometry, CourseKind, PoseCourse};
use super::curve::CirclePath;
use super::metric::{MixedMetric, common_focus};
use super::order::by_name;
use super::path::SceneFraming;
use super::refine::screen_views;
use super::travel::{PoseCount, TravelPlan};
use super::{NamedPose, TrajectoryError};
use glam::DVec3;
use gs2e_num::se3::{Se3, look_at};
use serde::Serialize;

/// Parameters of an orbit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrbitPath {
    /// The point on the axis at which the camera looks, world, units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub centre: Option<DVec3>,
    /// The start of the camera, world, units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<DVec3>,
    /// Direction of the axis, of any length. The top of the image is towards it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<DVec3>,
    /// Angle of the turn about the axis, degrees, right-handed.
    pub arc: f64,
    /// Number of poses to make.
    pub count: PoseCount,
}

impl OrbitPath {
    pub(super) fn travel(&self) -> TravelPlan {
        TravelPlan { count: self.count, literal: false }
    }

    /// The course about a point, relative to that point.
    pub(super) fn course(
        &self,
        views: &[NamedPose<'_>],
        scene: Option<SceneFraming>,
    ) -> Result<PoseCourse, TrajectoryError> {
        let missing = |what| move || TrajectoryError::Orbit { what, because: NO_CAPTURE };
        let (found, warnings) = match scene.filter(|_| views.is_empty()) {
            Some(framing) => (self.about_scene(framing), Vec::new()),
            None => CaptureOrbit::from_views(views)?,
        };
        let from = self.from.or(found.from).ok_or_else(missing("from"))?;
        let up = self.up.or(found.up).ok_or_else(missing("up"))?;
        let centre = match (self.centre, found.centre) {
            (Some(centre), _) => centre,
            (None, Some(centre)) => centre,
            (None, None) if views.is_empty() => return Err(missing("centre")()),
            (None, None) => return Err(TrajectoryError::Orbit { what: "centre", because: NO_FOCUS }),
        };
        let axis = up.try_normalize().ok_or(TrajectoryError::Orbit { what: "up", because: NO_DIRECTION })?;
        let arm = from - centre;
        let rotation =
            look_at(-arm, up).ok_or(TrajectoryError::Orbit { what: "circle", because: ON_AXIS })?;
        let start = Se3 { rotation, translation: arm };
        // The turn vector is in radians about the unit axis.
        let turn = axis * self.arc.to_radians();
        // The metric of a camera that looks at one point: its scale is the distance to that point.
        let metric = MixedMetric { scale: arm.length() };
        let length = metric.mix(turn.length(), turn.cross(arm).length());
        Ok(PoseCourse {
            kind: CourseKind::Orbit,
            origin: centre,
            // The course is relative to `origin`, so the centre of the circle is zero.
            line: CourseGeometry::Curve(Box::new(CirclePath::new(DVec3::ZERO, turn, start))),
            metric,
            length,
            views: views.len(),
            knots: Vec::new(),
            curve: None,
            degree_drawn: None,
            keyframes: Vec::new(),
            merged: Vec::new(),
            gaps: Vec::new(),
            warnings,
        })
    }
}

impl OrbitPath {
    /// Defaults from a scene: the start depends on the centre and the axis, which may be given.
    fn about_scene(&self, SceneFraming { mut survey, camera }: SceneFraming) -> CaptureOrbit {
        survey.centre = self.centre.unwrap_or(survey.centre);
        let axis = self.up.and_then(DVec3::try_normalize);
        survey.up.direction = axis.unwrap_or(survey.up.direction);
        let orbit = survey.orbit(&camera);
        CaptureOrbit { centre: Some(orbit.centre), from: Some(orbit.from), up: Some(orbit.up) }
    }
}

const NO_CAPTURE: &str = "it is not given, and there is no capture to take it from";
const NO_FOCUS: &str = "it is not given, and the capture's optical axes meet nowhere in front of its cameras";
const NO_DIRECTION: &str = "it is zero, or not finite";
const ON_AXIS: &str = "the camera starts on the axis, or at its centre";

/// Defaults of an orbit from a capture, or from a scene.
#[derive(Default)]
struct CaptureOrbit {
    centre: Option<DVec3>,
    from: Option<DVec3>,
    up: Option<DVec3>,
}

impl CaptureOrbit {
    fn from_views(views: &[NamedPose<'_>]) -> Result<(Self, Vec<super::TrajectoryWarning>), TrajectoryError> {
        if views.is_empty() {
            return Ok((Self::default(), Vec::new()));
        }
        let (origin, views, warnings) = screen_views(by_name(views)?)?;
        let poses = views.iter().map(|v| v.world_from_camera);
        let rays: Vec<(DVec3, DVec3)> =
            poses.clone().map(|p| (p.translation, p.rotation * DVec3::Z)).collect();
        // The screened centres are relative to the first one. The results are in world coordinates
        // again.
        let found = Self {
            centre: common_focus(&rays).map(|focus| origin + focus),
            from: Some(origin + views[0].world_from_camera.translation),
            // Cameras have OpenCV axes: up in the image is `-y`.
            up: poses.map(|p| p.rotation * DVec3::NEG_Y).sum::<DVec3>().try_normalize(),
        };
        Ok((found, warnings))
    }
}
