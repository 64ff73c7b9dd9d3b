//! Travel along a course: number, times and places of poses, so that the speed is the requested
//! one.

use super::course::{CourseGeometry, CurveWithLength, PoseCourse};
use super::flow::{FlowLength, FlowMeter};
use super::report::{FlowReport, ReportInputs, SpeedReport};
use super::sample::{PoseSchedule, SummationRule, places_by_chord};
use super::{Trajectory, TrajectoryError, TrajectoryWarning};
use crate::speed::SpeedChoice;
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_num::units::{Hertz, Ratio};
use serde::Serialize;

/// Maximum number of poses: 2.3 hours at 2400 Hz.
pub const MAX_POSES: u64 = 20_000_000;
/// Minimum frame rate, Hz. Stamps in microseconds must differ, and those of the longest path must fit
/// 64 bits.
pub const MIN_RATE_HZ: f64 = 1e-3;
/// Maximum frame rate, Hz.
pub const MAX_RATE_HZ: f64 = 1e6;
/// Ratio of the largest to the smallest speed above which there is a warning.
const MILD_RANGE: f64 = 100.0;

/// The number of poses of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseCount {
    /// `ceil(factor * views)`.
    Factor(Ratio),
    /// Exactly this many.
    Frames(u64),
    /// `1 + ceil(seconds * rate)`.
    Duration(Ratio),
    /// The duration at the requested flow, times the rate. [`SpeedChoice::Flow`] allows no other.
    Flow,
}

/// Speed and timing of the travel along a course.
#[derive(Debug, Clone, Copy)]
pub struct PoseTiming<'a> {
    /// The speed law.
    pub speed: &'a SpeedChoice,
    /// Poses per second.
    pub rate: Hertz,
    /// Summation of the law.
    pub law: SummationRule,
}

/// A trajectory, its report, and its warnings.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryBuild {
    /// The poses and their stamps.
    pub trajectory: Trajectory,
    /// Asked and achieved speed.
    pub report: SpeedReport,
    /// Warnings. The report repeats them as text.
    pub warnings: Vec<TrajectoryWarning>,
}

/// Travel along a course with `count` poses, by the paper's literal chords or by arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TravelPlan {
    pub(super) count: PoseCount,
    pub(super) literal: bool,
}

impl TravelPlan {
    /// The trajectory along a course. `meter` is used for [`SpeedChoice::Flow`] only.
    ///
    /// # Errors
    /// A number is out of range, the law fails, or the flow cannot be measured.
    pub(super) fn along(
        self,
        mut course: PoseCourse,
        timing: PoseTiming<'_>,
        meter: Option<&mut dyn FlowMeter>,
    ) -> Result<TrajectoryBuild, TrajectoryError> {
        let mut warnings = std::mem::take(&mut course.warnings);
        screen_rate(timing.rate)?;
        let measured = course.line.measured(course.metric);
        let flow = match (timing.speed, self.count) {
            (SpeedChoice::Flow(_), PoseCount::Flow) if self.literal => return Err(no_chords()),
            (SpeedChoice::Flow(asked), PoseCount::Flow) => {
                Some((asked.px_s, course.flow_length(measured.as_ref(), meter)?))
            }
            (SpeedChoice::Flow(_), _) | (_, PoseCount::Flow) => return Err(no_count(timing.speed)),
            _ => None,
        };
        let count = match &flow {
            Some((px_s, length)) => {
                frames_of(length.as_ref().map_or(0.0, FlowLength::total) / px_s, timing.rate)?
            }
            None => self.count.poses(course.views, timing.rate, &mut warnings)?,
        };
        let mut schedule = PoseSchedule::new(timing.speed, count, timing.law)?;
        let stamps_us = schedule.stamps_us(timing.rate)?;
        let flow = flow.map(|(px_s, length)| FlowReport { px_s, px: apply_flow(length, &mut schedule) });
        let (poses, arcs) = course.follow(measured.as_ref(), &schedule, self.literal);
        warnings.extend(speed_warnings(timing.speed, &schedule, &poses));
        let asked =
            ReportInputs { course: &course, travel: self, timing, schedule, flow, warnings: &warnings };
        let report = asked.report(&poses, &arcs);
        Ok(TrajectoryBuild {
            trajectory: Trajectory { world_from_camera: poses, stamps_us },
            report,
            warnings,
        })
    }
}

/// Converts shares of a path in pixels into shares of its mixed length. Also returns the length of
/// the path in pixels.
fn apply_flow(length: Option<FlowLength>, schedule: &mut PoseSchedule) -> f64 {
    let Some(length) = length else { return 0.0 };
    let mixed = length.mixed_lengths(&schedule.shares);
    // Divided by the last value, not by the total: the spline's length rounds, and the last share
    // must be exactly 1.
    let whole = mixed[mixed.len() - 1];
    if mixed.len() > 1 {
        schedule.shares = mixed.iter().map(|length| (length / whole).min(1.0)).collect();
    }
    length.total()
}

fn no_count(speed: &SpeedChoice) -> TrajectoryError {
    let (found, wanted) = match speed {
        SpeedChoice::Flow(_) => {
            ("given together with a speed in px/s", "none of factor, frames and duration")
        }
        _ => ("left to the optical flow", "a speed in px/s"),
    };
    TrajectoryError::Parameter { field: "frames", found: found.to_owned(), wanted }
}

fn no_chords() -> TrajectoryError {
    let wanted = "false with a speed in px/s, which does not divide chords";
    TrajectoryError::Parameter { field: "literal", found: "true".to_owned(), wanted }
}

fn screen_rate(rate: Hertz) -> Result<(), TrajectoryError> {
    if (MIN_RATE_HZ..=MAX_RATE_HZ).contains(&rate.to_f64()) {
        return Ok(());
    }
    Err(TrajectoryError::Parameter {
        field: "sampling.rate",
        found: rate.0.to_string(),
        wanted: "a rate from 1/1000 to 1000000",
    })
}

/// `1 + ceil(seconds * rate)` poses.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "positive; casts saturate, and what is too many is refused"
)]
fn frames_of(seconds: f64, rate: Hertz) -> Result<usize, TrajectoryError> {
    // The cast saturates. The limit keeps the sum from overflowing.
    within_limit(1 + ((seconds * rate.to_f64()).ceil() as u64).min(u64::MAX - 1))
}

fn within_limit(count: u64) -> Result<usize, TrajectoryError> {
    match usize::try_from(count) {
        Ok(0) => Err(TrajectoryError::Parameter {
            field: "frames",
            found: "0".to_owned(),
            wanted: "a whole number from 1",
        }),
        Ok(count) if count as u64 <= MAX_POSES => Ok(count),
        _ => Err(TrajectoryError::TooMany { count }),
    }
}

impl PoseCount {
    /// Number of poses for this many views.
    fn poses(
        self,
        views: usize,
        rate: Hertz,
        warnings: &mut Vec<TrajectoryWarning>,
    ) -> Result<usize, TrajectoryError> {
        within_limit(match self {
            Self::Factor(gamma) => {
                let sparse = gamma.numerator() <= gamma.denominator();
                warnings.extend(sparse.then(|| TrajectoryWarning::Sparse { factor: gamma.to_string() }));
                gamma.ceil_times(views as u64).unwrap_or(u64::MAX)
            }
            Self::Frames(frames) => frames,
            Self::Duration(seconds) => {
                // Numerators and denominators are at most 1e18, so neither product exceeds 128
                // bits.
                let frames = u128::from(seconds.numerator()) * u128::from(rate.0.numerator());
                let each = u128::from(seconds.denominator()) * u128::from(rate.0.denominator());
                u64::try_from(frames.div_ceil(each)).unwrap_or(u64::MAX).saturating_add(1)
            }
            Self::Flow => unreachable!("a flow says itself how many"),
        })
    }

    /// Poses per view, if that determines their number.
    pub(super) fn gamma(self) -> Option<Ratio> {
        match self {
            Self::Factor(gamma) => Some(gamma),
            Self::Frames(_) | Self::Duration(_) | Self::Flow => None,
        }
    }
}

impl PoseCourse {
    /// The poses of a schedule, and the length of the curve from each pose to the next (empty on a
    /// still path).
    fn follow(
        &self,
        measured: Option<&CurveWithLength<'_>>,
        schedule: &PoseSchedule,
        literal: bool,
    ) -> (Vec<Se3>, Vec<f64>) {
        let still = match &self.line {
            CourseGeometry::Still(pose) => self.placed(*pose),
            CourseGeometry::Curve(_) => Se3::IDENTITY,
        };
        let Some((curve, arc)) = measured else {
            return (vec![still; schedule.shares.len()], Vec::new());
        };
        let mut poses = Vec::with_capacity(schedule.shares.len());
        let mut arcs = Vec::with_capacity(schedule.speeds.len());
        let mut before = None;
        if literal {
            for at in places_by_chord(*curve, &schedule.shares) {
                arcs.extend(before.map(|before| arc.between(before, at)));
                poses.push(self.placed(curve.pose(at)));
                before = Some(at);
            }
            return (poses, arcs);
        }
        // A walk is fast only forwards, and the shares never fall.
        let mut walk = arc.walk();
        for share in &schedule.shares {
            let at = walk.to(share * arc.total());
            arcs.extend(before.map(|before| walk.since(before, at)));
            poses.push(self.placed(curve.pose(at)));
            before = Some(at);
        }
        (poses, arcs)
    }

    /// Length in pixels; `None` if nothing moves.
    fn flow_length(
        &self,
        measured: Option<&CurveWithLength<'_>>,
        meter: Option<&mut dyn FlowMeter>,
    ) -> Result<Option<FlowLength>, TrajectoryError> {
        let no_scene = || TrajectoryError::Flow { share: 0.0, because: "there is no scene".to_owned() };
        let Some((curve, arc)) = measured else { return Ok(None) };
        let meter = meter.ok_or_else(no_scene)?;
        FlowLength::measure_flow(arc, *curve, |pose| self.placed(pose), meter).map(Some)
    }
}

fn speed_warnings(speed: &SpeedChoice, schedule: &PoseSchedule, poses: &[Se3]) -> Vec<TrajectoryWarning> {
    let slowest = schedule.speeds.iter().copied().fold(f64::INFINITY, f64::min);
    let ratio = schedule.speeds.iter().copied().fold(0.0, f64::max) / slowest;
    let degrees = || {
        poses
            .windows(2)
            .map(|w| relative_angle(w[0].rotation, w[1].rotation))
            .fold(0.0, f64::max)
            .to_degrees()
    };
    let rough = speed.as_law().roughness().map(|because| TrajectoryWarning::Rough { because });
    let wide = (ratio > MILD_RANGE).then(|| TrajectoryWarning::SpeedRange { ratio, degrees: degrees() });
    rough.into_iter().chain(wide).collect()
}
