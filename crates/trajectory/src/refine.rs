//! Refined trajectories, as in the paper's 3.5.1: the captured poses are smoothed, measured, and
//! sampled densely at a prescribed speed.

use super::course::{CourseKind, PoseCourse};
use super::curve::CurveKind;
use super::knots::{KnotSequence, find_gaps, judge_gaps};
use super::metric::MixedMetric;
use super::order::{arrange_views, by_name};
use super::smooth::smooth_views;
use super::travel::{PoseCount, TravelPlan};
use super::{NamedPose, PoseTiming, TrajectoryBuild, TrajectoryError, TrajectoryWarning};
use glam::{DQuat, DVec3};
use gs2e_num::se3::rotation::same_hemisphere;
use gs2e_num::se3::{ScreenedRotation, Se3, rotation_from_quaternion};
use gs2e_num::units::Ratio;
use serde::{Deserialize, Serialize};

/// Largest coordinate, units. Its square, and sums of these squares, stay finite.
const FARTHEST: f64 = 1e100;
/// Parameters of a refined trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RefinePath {
    /// Half-width of the smoothing window, in poses; 0 means none.
    pub window: u32,
    /// Number of poses to make.
    pub count: PoseCount,
    /// Order of the views.
    pub order: ViewOrder,
    /// Mean of rotations for smoothing.
    pub rotation: RotationMean,
    /// Treatment of the ends in smoothing.
    pub ends: EndRule,
    /// Weight of translation against rotation.
    pub scale: TranslationScale,
    /// Treatment of gaps in the capture.
    pub gaps: GapRule,
    /// The curve through the poses.
    pub curve: CurveKind,
    /// True if the paper's chord lengths are used unchanged, without correction by the fitted
    /// curve's arc length.
    pub literal: bool,
}

/// Order of the views along the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewOrder {
    /// Natural order of the image names.
    Name,
    /// Greedy nearest neighbour, from the first name.
    Nearest,
}

/// The mean of a window's rotations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RotationMean {
    /// Karcher mean.
    Mean,
    /// The literal reading of the paper's equation 8. Ablation.
    SlerpMidpoint,
}

/// Treatment of the path's ends in smoothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndRule {
    /// Windows are cut off, which pulls the ends in; the paper's definition.
    Truncated,
    /// Windows shrink, which keeps both end poses.
    Pinned,
}

/// The distance by which translation is divided in the mixed metric.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TranslationScale {
    /// Median distance of the centres to the point nearest all optical axes.
    Scene,
    /// 1: translation counts in scene units.
    None,
    /// This many scene units.
    Fixed(f64),
}

/// Treatment of gaps in the capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GapRule {
    /// Cross them, with a warning.
    Bridge,
    /// Fail.
    Refuse,
}

impl Default for RefinePath {
    /// The paper's settings, and this program's choices where the paper gives none.
    fn default() -> Self {
        Self {
            window: 2,
            count: PoseCount::Factor(Ratio::new(5, 1).expect("5 is positive")),
            order: ViewOrder::Name,
            rotation: RotationMean::Mean,
            ends: EndRule::Truncated,
            scale: TranslationScale::Scene,
            gaps: GapRule::Bridge,
            curve: CurveKind::Cubic,
            literal: false,
        }
    }
}

/// The dense trajectory through the views of a capture, given in any order, as by
/// `CameraPath::Refine`.
///
/// # Errors
/// There are no views; they have values that are not finite, invalid rotations or equal names;
/// neighbouring rotations have no mean or no curve; a parameter is out of range; or there is a gap
/// under [`GapRule::Refuse`].
pub fn refine_views(
    views: &[NamedPose<'_>],
    params: &RefinePath,
    timing: PoseTiming<'_>,
) -> Result<TrajectoryBuild, TrajectoryError> {
    params.travel().along(params.course(views)?, timing, None)
}

impl RefinePath {
    pub(super) fn travel(&self) -> TravelPlan {
        TravelPlan { count: self.count, literal: self.literal }
    }

    /// The course along the views of a capture.
    pub(super) fn course(&self, views: &[NamedPose<'_>]) -> Result<PoseCourse, TrajectoryError> {
        let (origin, mut views, mut warnings) = screen_views(by_name(views)?)?;
        let metric = MixedMetric::new(self.scale, &views)?;
        arrange_views(&mut views, self.order, metric);
        // Before smoothing, which spreads a gap over its window.
        let gaps = find_gaps(&views, metric);
        warnings.extend(judge_gaps(&gaps, self.gaps)?);
        let knots = KnotSequence::new(&smooth_views(&views, self)?, metric)?;
        let mut course = PoseCourse::through_knots(CourseKind::Refine, knots, self.curve, origin, metric)?;
        course.gaps = gaps;
        // Screening came first, and so do its warnings.
        course.warnings.splice(..0, warnings);
        Ok(course)
    }
}

/// Checks every pose, makes centres relative to the first one (so that a large offset costs no
/// digits later), and moves every quaternion into the hemisphere of its predecessor. Returns the
/// origin, the views and the warnings.
pub(super) fn screen_views(
    mut views: Vec<NamedPose<'_>>,
) -> Result<(DVec3, Vec<NamedPose<'_>>, Vec<TrajectoryWarning>), TrajectoryError> {
    let mut warnings = Vec::new();
    let origin = views.first().ok_or(TrajectoryError::NoViews)?.world_from_camera.translation;
    // Next to the identity, the first quaternion gets `w >= 0`.
    let mut before = DQuat::IDENTITY;
    for view in &mut views {
        let name = view.name.to_owned();
        let centre = view.world_from_camera.translation - origin;
        // Negated, so that NaN is refused too.
        if !centre.abs().cmple(DVec3::splat(FARTHEST)).all() {
            return Err(TrajectoryError::Centre { name });
        }
        let screened = rotation_from_quaternion(view.world_from_camera.rotation);
        let ScreenedRotation { rotation, projected, deviation } =
            screened.map_err(|source| TrajectoryError::Rotation { name: name.clone(), source })?;
        before = same_hemisphere(rotation, before);
        view.world_from_camera = Se3 { rotation: before, translation: centre };
        warnings.extend(projected.then_some(TrajectoryWarning::Projected { name, deviation }));
    }
    Ok((origin, views, warnings))
}
