//! The paper's 3.5.1: smooth the captured poses, measure them, and sample them densely at a prescribed speed.

use super::curve::{Measured, PoseCurve};
use super::knots::{Knots, gaps, judge};
use super::metric::Metric;
use super::order::{arrange, by_name};
use super::report::{Asked, Report};
use super::sample::{Schedule, places_by_chord, places_by_length};
use super::smooth::smooth;
use super::{MOST_POSES, NamedPose, Trajectory, TrajectoryError, Warning};
use crate::se3::arc_length::ArcLength;
use crate::se3::rotation::{aligned, angle, canonical};
use crate::se3::{Screened, Se3, rotation_from_quaternion};
use crate::speed::{Law, Speed};
use crate::units::{Hertz, Ratio};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Largest coordinate, units: its square, and that square's sums, stay finite.
const FARTHEST: f64 = 1e100;
/// Frame rates, Hz: stamps of a microsecond must differ, and those of the longest path fit 64 bits.
const SLOWEST: f64 = 1e-3;
const FASTEST: f64 = 1e6;
/// Shortest step between knots, in mean steps: its inverse square, which the splines hold, must stay finite.
const LEAST_STEP: f64 = 1e-100;
/// Longest mean step in the metric: what the curve makes of it between the knots must stay finite.
const LONGEST: f64 = 1e150;
/// Speeds that differ by more than this factor are worth a warning.
const MILD_RANGE: f64 = 100.0;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// C2 cubic spline on centres, C2 rotation spline.
    Cubic,
}

impl Default for Refine {
    /// The paper's settings, and this program's where the paper is silent.
    fn default() -> Self {
        Self {
            window: 2,
            count: Count::Factor(Ratio::new(5, 1).expect("5 is positive")),
            order: Order::Name,
            rotation: RotationMean::Mean,
            ends: Ends::Truncated,
            scale: Scale::Scene,
            gaps: Gaps::Bridge,
            curve: Curve::Cubic,
            literal: false,
        }
    }
}

/// A refined trajectory, what it achieves, and what the user should know about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The poses and their stamps.
    pub trajectory: Trajectory,
    /// What was asked and what was achieved.
    pub report: Report,
    /// What deserves a look; the report repeats them as text.
    pub warnings: Vec<Warning>,
}

/// The dense trajectory through the views of a capture, given in any order.
///
/// # Errors
/// Where the views are none, not finite, no rotations or of one name; where neighbouring rotations have no mean or no
/// curve; where a parameter is out of range; and for gaps under [`Gaps::Refuse`].
pub fn refine(
    views: &[NamedPose<'_>],
    params: &Refine,
    speed: &Speed,
    rate: Hertz,
) -> Result<Refined, TrajectoryError> {
    let mut warnings = Vec::new();
    let (origin, mut views) = screen(by_name(views)?, &mut warnings)?;
    let metric = Metric::new(params.scale, &views)?;
    arrange(&mut views, params.order, metric);
    let gaps = gaps(&views, metric);
    warnings.extend(judge(&gaps, params.gaps)?);
    let knots = Knots::new(&smooth(&views, params)?, metric)?;
    warnings.extend(knots.half_turns());

    let count = params.count.poses(views.len(), rate, &mut warnings)?;
    let schedule = Schedule::left_sum(speed.as_law(), count)?;
    let path = Path::through(&knots, origin, metric)?;
    let (poses, arcs) = path.follow(&schedule, params.literal);
    if let Path::Still(_) = path {
        warnings.push(Warning::Still { views: views.len() });
    }
    warnings.extend(speed_warnings(speed.as_law(), &schedule, &poses));
    let asked = Asked { params, metric, rate, schedule, knots: &knots, gaps: &gaps, warnings: &warnings };
    let report = asked.report(&poses, &arcs);
    let stamps_us = (0..count as u64).map(|j| rate.stamp_us(j)).collect();
    Ok(Refined { trajectory: Trajectory { world_from_camera: poses, stamps_us }, report, warnings })
}

/// Checks every pose, makes centres relative to the first one (so that a large offset costs no digits later), and
/// turns every quaternion into the hemisphere of its predecessor.
fn screen<'a>(
    mut views: Vec<NamedPose<'a>>,
    warnings: &mut Vec<Warning>,
) -> Result<(DVec3, Vec<NamedPose<'a>>), TrajectoryError> {
    let origin = views.first().ok_or(TrajectoryError::NoViews)?.world_from_camera.translation;
    let mut before = DQuat::IDENTITY;
    for view in &mut views {
        let name = view.name.to_owned();
        let centre = view.world_from_camera.translation - origin;
        if !centre.abs().cmple(DVec3::splat(FARTHEST)).all() {
            return Err(TrajectoryError::Centre { name });
        }
        let screened = rotation_from_quaternion(view.world_from_camera.rotation);
        let Screened { rotation, projected, deviation } =
            screened.map_err(|source| TrajectoryError::Rotation { name: name.clone(), source })?;
        before = aligned(rotation, before);
        view.world_from_camera = Se3 { rotation: before, translation: centre };
        warnings.extend(projected.then_some(Warning::Projected { name, deviation }));
    }
    Ok((origin, views))
}

impl Count {
    /// Number of poses for so many views.
    fn poses(self, views: usize, rate: Hertz, warnings: &mut Vec<Warning>) -> Result<usize, TrajectoryError> {
        if !(SLOWEST..=FASTEST).contains(&rate.to_f64()) {
            return Err(TrajectoryError::Parameter {
                field: "sampling.rate",
                found: rate.0.to_string(),
                wanted: "a rate from 1/1000 to 1000000",
            });
        }
        let count = match self {
            Self::Factor(gamma) => {
                let sparse = gamma.numerator() <= gamma.denominator();
                warnings.extend(sparse.then(|| Warning::Sparse { factor: gamma.to_string() }));
                gamma.ceil_times(views as u64).unwrap_or(u64::MAX)
            }
            Self::Frames(frames) => frames,
            Self::Duration(seconds) => {
                // Numerators and denominators are at most 1e18, so that neither product leaves 128 bits.
                let frames = u128::from(seconds.numerator()) * u128::from(rate.0.numerator());
                let each = u128::from(seconds.denominator()) * u128::from(rate.0.denominator());
                u64::try_from(frames.div_ceil(each)).unwrap_or(u64::MAX).saturating_add(1)
            }
        };
        match usize::try_from(count) {
            Ok(0) => Err(TrajectoryError::Parameter {
                field: "frames",
                found: "0".to_owned(),
                wanted: "a whole number from 1",
            }),
            Ok(count) if count as u64 <= MOST_POSES => Ok(count),
            _ => Err(TrajectoryError::TooMany { count }),
        }
    }

    /// Poses per view, where that sets their number.
    pub(super) fn gamma(self) -> Option<Ratio> {
        match self {
            Self::Factor(gamma) => Some(gamma),
            Self::Frames(_) | Self::Duration(_) => None,
        }
    }
}

/// The path that poses are taken from.
enum Path {
    /// One pose: a single view, or views that all coincide.
    Still(Se3),
    /// A curve.
    Curve(PoseCurve, Metric),
}

impl Path {
    fn through(knots: &Knots<'_>, origin: DVec3, metric: Metric) -> Result<Self, TrajectoryError> {
        let poses: Vec<Se3> = knots.poses.iter().map(|k| k.world_from_camera).collect();
        if let [Se3 { rotation, translation }] = poses[..] {
            return Ok(Self::Still(Se3 { rotation: canonical(rotation), translation: origin + translation }));
        }
        let unit = knots.length() / knots.steps.len() as f64;
        let smallest = knots.steps.iter().copied().fold(f64::INFINITY, f64::min);
        if !(unit < LONGEST && smallest > unit * LEAST_STEP) {
            return Err(TrajectoryError::Uneven { smallest, length: knots.length() });
        }
        let steps = knots.steps.iter().map(|step| step / unit).collect();
        let curve = PoseCurve::cubic(steps, &poses, origin).map_err(|source| TrajectoryError::Curve {
            first: knots.poses[0].name.to_owned(),
            last: knots.poses[poses.len() - 1].name.to_owned(),
            source,
        })?;
        Ok(Self::Curve(curve, metric))
    }

    /// The poses of a schedule, and the length of the curve from each to the next (none on a still path).
    fn follow(&self, schedule: &Schedule, literal: bool) -> (Vec<Se3>, Vec<f64>) {
        let (curve, metric) = match self {
            Self::Still(pose) => return (vec![*pose; schedule.shares.len()], Vec::new()),
            Self::Curve(curve, metric) => (curve, *metric),
        };
        let arc = ArcLength::measure(curve.steps(), Measured { curve, metric });
        let places = if literal {
            places_by_chord(curve, &schedule.shares)
        } else {
            places_by_length(&arc, &schedule.shares)
        };
        let poses = places.iter().map(|at| curve.pose(*at)).collect();
        (poses, places.windows(2).map(|w| arc.between(w[0], w[1])).collect())
    }
}

fn speed_warnings(law: &dyn Law, schedule: &Schedule, poses: &[Se3]) -> Vec<Warning> {
    let slowest = schedule.speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let ratio = schedule.speeds.iter().copied().fold(0.0, f64::max) / slowest;
    let degrees =
        || poses.windows(2).map(|w| angle(w[0].rotation, w[1].rotation)).fold(0.0, f64::max).to_degrees();
    let mut warnings: Vec<Warning> =
        law.roughness().map(|because| Warning::Rough { because }).into_iter().collect();
    if ratio > MILD_RANGE {
        warnings.push(Warning::SpeedRange { ratio, degrees: degrees() });
    }
    warnings
}
