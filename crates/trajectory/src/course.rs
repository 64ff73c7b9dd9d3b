//! A course: the geometry of a path, before speed and time.

use super::curve::{CurveKind, MAX_DEGREE, MeasuredCurve, PoseCurve};
use super::knots::{CaptureGap, KnotSequence, MergedViews};
use super::metric::MixedMetric;
use super::{TrajectoryError, TrajectoryWarning};
use glam::DVec3;
use gs2e_num::se3::Se3;
use gs2e_num::se3::arc_length::ArcLength;
use gs2e_num::se3::rotation::canonical_sign;
use serde::{Deserialize, Serialize};

/// Shortest step between knots, in mean steps. The splines hold its inverse square, which must stay
/// finite.
const MIN_STEP: f64 = 1e-100;
/// Longest mean step in the metric. The curve's values between the knots must stay finite.
const MAX_LENGTH: f64 = 1e150;

/// The kind of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CourseKind {
    /// Along the captured poses.
    Refine,
    /// Between key poses drawn from another trajectory.
    Novel,
    /// A circle about a point.
    Orbit,
    /// Between given poses.
    Keyframes,
    /// That of a camera on a body that follows another path.
    Mounted,
}

/// A path of poses, with its properties.
#[derive(Debug)]
pub(super) struct PoseCourse {
    pub(super) kind: CourseKind,
    /// Origin of the line's coordinates, in world coordinates.
    pub(super) origin: DVec3,
    pub(super) line: CourseGeometry,
    pub(super) metric: MixedMetric,
    /// Length of the chords between the knots; for a path without knots, its own length.
    pub(super) length: f64,
    /// Number of views that a factor multiplies.
    pub(super) views: usize,
    /// The knots, relative to the origin. A circle has none.
    pub(super) knots: Vec<Se3>,
    /// Name of the curve; `None` for a circle.
    pub(super) curve: Option<CurveKind>,
    /// Degree drawn for a Bezier curve, before it was reduced to what the knots determine.
    pub(super) degree_drawn: Option<u32>,
    /// Indices of the key poses in the other trajectory.
    pub(super) keyframes: Vec<usize>,
    pub(super) merged: Vec<MergedViews>,
    pub(super) gaps: Vec<CaptureGap>,
    pub(super) warnings: Vec<TrajectoryWarning>,
}

/// The geometry of a course.
#[derive(Debug)]
pub(super) enum CourseGeometry {
    /// One pose: a single view, or several that coincide.
    Still(Se3),
    /// A curve.
    Curve(Box<dyn PoseCurve>),
}

/// A curve and its length.
pub(super) type CurveWithLength<'a> = (&'a dyn PoseCurve, ArcLength<MeasuredCurve<'a>>);

impl PoseCourse {
    /// The course of `curve` through knots. Other properties are empty.
    ///
    /// # Errors
    /// The degree of the curve is out of range, no curve holds the steps, or rotations turn too
    /// unevenly for it.
    pub(super) fn through_knots(
        kind: CourseKind,
        knots: KnotSequence<'_>,
        curve: CurveKind,
        origin: DVec3,
        metric: MixedMetric,
    ) -> Result<Self, TrajectoryError> {
        screen_degree(curve)?;
        let (line, length) = (CourseGeometry::through_knots(&knots, curve)?, knots.length());
        let views = knots.views();
        let mut warnings: Vec<TrajectoryWarning> = knots.half_turns().collect();
        warnings.extend(line.curve().and_then(PoseCurve::warning));
        if let CourseGeometry::Still(_) = line {
            warnings.push(TrajectoryWarning::Still { views });
        }
        Ok(Self {
            kind,
            origin,
            line,
            metric,
            length,
            views,
            knots: knots.poses.iter().map(|k| k.world_from_camera).collect(),
            curve: Some(curve),
            degree_drawn: None,
            keyframes: Vec::new(),
            merged: knots.merged,
            gaps: Vec::new(),
            warnings,
        })
    }

    /// The degree of its Bezier curve, if it is one.
    pub(super) fn degree_used(&self) -> Option<u32> {
        self.line.curve().and_then(PoseCurve::degree)
    }

    /// A pose as written to files: in world coordinates, with a quaternion of `w >= 0`.
    pub(super) fn placed(&self, pose: Se3) -> Se3 {
        Se3 { rotation: canonical_sign(pose.rotation), translation: self.origin + pose.translation }
    }
}

fn screen_degree(curve: CurveKind) -> Result<(), TrajectoryError> {
    match curve {
        CurveKind::Bezier { degree } if !(1..=MAX_DEGREE).contains(&degree) => {
            Err(TrajectoryError::Parameter {
                field: "bezier.degree",
                found: degree.to_string(),
                wanted: "a whole number from 1 to 20",
            })
        }
        _ => Ok(()),
    }
}

impl CourseGeometry {
    fn through_knots(knots: &KnotSequence<'_>, curve: CurveKind) -> Result<Self, TrajectoryError> {
        let poses: Vec<Se3> = knots.poses.iter().map(|k| k.world_from_camera).collect();
        if let [pose] = poses[..] {
            return Ok(Self::Still(pose));
        }
        // The parameter is in units of the mean chord, so no capture's scale can overflow or
        // underflow it.
        let unit = knots.length() / knots.steps.len() as f64;
        let smallest = knots.steps.iter().copied().fold(f64::INFINITY, f64::min);
        // Negated, so that a length that is not finite is refused too.
        if !(unit < MAX_LENGTH && smallest > unit * MIN_STEP) {
            return Err(TrajectoryError::Uneven { smallest, length: knots.length() });
        }
        let steps = knots.steps.iter().map(|step| step / unit).collect();
        let curve = curve.through(steps, &poses).map_err(|source| TrajectoryError::Curve {
            first: knots.poses[0].name.to_owned(),
            last: knots.poses[poses.len() - 1].name.to_owned(),
            source,
        })?;
        Ok(Self::Curve(curve))
    }

    /// The curve; `None` if nothing moves.
    pub(super) fn curve(&self) -> Option<&dyn PoseCurve> {
        match self {
            Self::Still(_) => None,
            Self::Curve(curve) => Some(curve.as_ref()),
        }
    }

    /// The curve with its length in the metric; `None` if nothing moves.
    pub(super) fn measured(&self, metric: MixedMetric) -> Option<CurveWithLength<'_>> {
        let curve = self.curve()?;
        Some((curve, ArcLength::measure_curve(curve.steps(), MeasuredCurve { curve, metric })))
    }
}
