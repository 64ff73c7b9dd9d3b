//! Asked and achieved speed of a trajectory: `speed.json` of a release.

use super::TrajectoryWarning;
use super::course::{CourseKind, PoseCourse};
use super::curve::CurveKind;
use super::knots::{CaptureGap, MergedViews};
use super::metric::{ALPHA, BETA, MixedMetric};
use super::sample::{PoseSchedule, SummationRule, step_seconds};
use super::travel::{PoseTiming, TravelPlan};
use crate::speed::SpeedMeaning;
use gs2e_num::se3::rotation::relative_angle;
use gs2e_num::se3::spline::CurvePlace;
use gs2e_num::se3::sum::NeumaierSum;
use gs2e_num::se3::{Se3, Twist};
use gs2e_num::units::Hertz;
use serde::{Deserialize, Serialize};

/// Share of the path below which a step is left out of ratios. The positions of its ends are sums
/// near 1, rounded to 1e-4 of this share.
const MIN_SHARE: f64 = 1e-12;
/// Share of the path below which a part of the motion is rounding, so that it has no ratios.
const MIN_MOTION: f64 = 1e-9;

/// Achieved share of the path divided by the asked share, over all steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FollowError {
    /// Smallest ratio.
    pub min: f64,
    /// Largest ratio.
    pub max: f64,
    /// Root of the mean squared deviation of the ratios from 1.
    pub rms: f64,
    /// The deviation from 1 that 95 % of the ratios do not exceed.
    pub p95: f64,
}

/// Poses against the speeds that were asked of them, measured as chords between neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChordFollow {
    /// Sum of the chords, in the metric.
    pub length: f64,
    /// The mixed metric; `None` if the camera does not move.
    pub mixed: Option<FollowError>,
    /// Distances between centres; `None` if they do not move.
    pub linear: Option<FollowError>,
    /// Angles between poses; `None` if they do not turn.
    pub angular: Option<FollowError>,
}

/// Jumps at the knots, where two pieces of a curve meet: the largest of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnotJumps {
    /// Jump of the pose, divided by the mean distance between knots.
    pub c0: f64,
    /// Jump of the rates, divided by the mean rate.
    pub c1: f64,
    /// Jump of the accelerations, divided by the mean rate per mean distance between knots.
    pub c2: f64,
}

/// A speed in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlowReport {
    /// Asked median flow of a frame, px/s, as its mean over time.
    pub px_s: f64,
    /// Length of the path in median flow, px.
    pub px: f64,
}

/// The content of `speed.json`, in the order of its keys. Every number is finite; a missing value
/// is `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedReport {
    /// Kind of the path.
    pub kind: CourseKind,
    /// Name of the curve through the knots. A circle has none.
    pub curve: Option<CurveKind>,
    /// Degree that was drawn for a Bezier curve.
    pub degree_drawn: Option<u32>,
    /// Degree that was used for a Bezier curve.
    pub degree_used: Option<u32>,
    /// Indices of the key poses in the base trajectory, from 0.
    pub keyframes: Vec<usize>,
    /// Summation of the speed law.
    pub law: SummationRule,
    /// True if the paper's chord lengths are used unchanged.
    pub literal: bool,
    /// Meaning of large values of the speed law.
    pub meaning: SpeedMeaning,
    /// Weight of rotation in the metric, per radian.
    pub alpha: f64,
    /// Weight of translation in the metric, per scale distance.
    pub beta: f64,
    /// The scale distance D, units.
    pub scale_distance: f64,
    /// Poses per view as `a/b`, if that determined their number.
    pub gamma: Option<String>,
    /// Frame rate as `p/q`, per second.
    pub rate: String,
    /// Number of poses.
    #[serde(rename = "M")]
    pub poses: usize,
    /// Length of the chords between knots in the metric.
    #[serde(rename = "S")]
    pub length: f64,
    /// Length of the fitted curve divided by that of the chords.
    pub length_ratio: Option<f64>,
    /// Largest distance of a knot from the curve's pose for it, divided by the mean distance
    /// between knots.
    pub knot_distance: Option<f64>,
    /// Smoothness of the curve where its pieces meet; `None` for a single piece.
    pub knot_jumps: Option<KnotJumps>,
    /// The speed in pixels, if the recipe asks for one.
    pub flow: Option<FlowReport>,
    /// Runs of views that coincide after smoothing.
    pub merged: Vec<MergedViews>,
    /// Gaps in the capture.
    pub gaps: Vec<CaptureGap>,
    /// Asked speed of each step.
    pub u: Vec<f64>,
    /// Asked length of the path before each pose, in the metric: 0 to S.
    pub s: Vec<f64>,
    /// Mixed metric, measured as arc length along the curve.
    pub mixed_ratio: Option<FollowError>,
    /// Mixed metric, measured as chords between neighbouring poses.
    pub mixed_chord_ratio: Option<FollowError>,
    /// Distance between neighbouring centres.
    pub linear_ratio: Option<FollowError>,
    /// Angle between neighbouring poses.
    pub angular_ratio: Option<FollowError>,
    /// Linear speed of each step, units per second.
    pub linear_unit_s: Vec<f64>,
    /// Angular speed of each step, radians per second.
    pub angular_rad_s: Vec<f64>,
    /// Largest turn between neighbouring poses, degrees.
    pub max_step_deg: f64,
    /// Largest change between neighbouring steps in the metric, over the mean step.
    pub max_step_change: f64,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
}

impl SpeedReport {
    /// Duration of each step, in intervals of the frame rate.
    pub fn durations(&self) -> impl Iterator<Item = f64> {
        self.u.iter().map(|u| match self.meaning {
            SpeedMeaning::Speed => 1.0,
            SpeedMeaning::FrameRate => 1.0 / u,
        })
    }

    /// The report with everything measured again that the poses determine: their number, the speeds
    /// of the steps, the largest turn and the largest change. With a `schedule`, the law, the asked
    /// speeds and the asked lengths come from it. `None` if the rate is not valid or the number of
    /// steps does not fit.
    #[must_use]
    pub fn remeasured(&self, poses: &[Se3], schedule: Option<&PoseSchedule>) -> Option<Self> {
        let rate = Hertz(self.rate.parse().ok()?);
        let steps = StepLengths::between_poses(poses, MixedMetric { scale: self.scale_distance });
        let (u, s) = match schedule {
            Some(of) => (of.speeds.clone(), of.shares.iter().map(|share| share * self.length).collect()),
            None => (self.u.clone(), self.s.clone()),
        };
        let count = steps.linear.len();
        // The report may come from a file, with lists of any length. Steps index `u`.
        let lists = [u.len() + 1, s.len(), self.linear_unit_s.len() + 1, self.angular_rad_s.len() + 1];
        if lists != [count + 1; 4] {
            return None;
        }
        let seconds = |j: usize| step_seconds(self.meaning, rate, &u, j);
        Some(Self {
            u: u.clone(),
            s,
            law: schedule.map_or(self.law, |of| of.law),
            poses: poses.len(),
            linear_unit_s: per_second(&steps.linear, seconds),
            angular_rad_s: per_second(&steps.angular, seconds),
            max_step_deg: steps.largest_turn_deg(),
            max_step_change: steps.largest_change(),
            ..self.clone()
        })
    }

    /// The path of these poses, measured as chords, against the speeds that were asked. `None` if
    /// the number of steps does not fit.
    #[must_use]
    pub fn measure_chords(&self, poses: &[Se3]) -> Option<ChordFollow> {
        let metric = MixedMetric { scale: self.scale_distance };
        let steps = StepLengths::between_poses(poses, metric);
        if self.s.len() != poses.len() {
            return None;
        }
        let shares: Vec<f64> = self.asked_shares().collect();
        let follow = |lengths: &[f64], weight| follow_shares(lengths, weight, &shares, self.length);
        Some(ChordFollow {
            length: NeumaierSum::sum_of(steps.mixed.iter().copied()),
            mixed: follow(&steps.mixed, 1.0),
            linear: follow(&steps.linear, metric.mix(0.0, 1.0)),
            angular: follow(&steps.angular, metric.mix(1.0, 0.0)),
        })
    }

    /// Share of the path, in the metric, that was asked of each step.
    pub fn asked_shares(&self) -> impl Iterator<Item = f64> {
        self.s.windows(2).map(|w| (w[1] - w[0]) / self.length)
    }
}

/// Inputs of a report, in addition to the poses.
pub(super) struct ReportInputs<'a> {
    pub(super) course: &'a PoseCourse,
    pub(super) travel: TravelPlan,
    pub(super) timing: PoseTiming<'a>,
    pub(super) schedule: PoseSchedule,
    pub(super) flow: Option<FlowReport>,
    pub(super) warnings: &'a [TrajectoryWarning],
}

impl ReportInputs<'_> {
    /// The report on `poses`. `arcs` are the lengths of the steps along the fitted curve; empty if
    /// the camera stands still.
    pub(super) fn report(self, poses: &[Se3], arcs: &[f64]) -> SpeedReport {
        let PoseCourse { metric, length, .. } = *self.course;
        let steps = StepLengths::between_poses(poses, metric);
        let follow = |lengths: &[f64], weight: f64| self.follow(lengths, weight);
        let seconds = |j: usize| self.schedule.seconds(self.timing.rate, j);
        let fit = KnotFit::for_course(self.course);
        SpeedReport {
            kind: self.course.kind,
            curve: self.course.curve,
            degree_drawn: self.course.degree_drawn,
            degree_used: self.course.degree_used(),
            keyframes: self.course.keyframes.clone(),
            law: self.schedule.law,
            literal: self.travel.literal,
            meaning: self.timing.speed.meaning(),
            alpha: ALPHA,
            beta: BETA,
            scale_distance: metric.scale,
            gamma: self.travel.count.gamma().map(|g| g.to_string()),
            rate: self.timing.rate.0.to_string(),
            poses: poses.len(),
            length,
            length_ratio: (!arcs.is_empty()).then(|| NeumaierSum::sum_of(arcs.iter().copied()) / length),
            knot_distance: fit.as_ref().map(|fit| fit.distance),
            knot_jumps: fit.and_then(|fit| fit.jumps),
            flow: self.flow,
            merged: self.course.merged.clone(),
            gaps: self.course.gaps.clone(),
            s: self.schedule.shares.iter().map(|share| share * length).collect(),
            mixed_ratio: follow(arcs, 1.0),
            mixed_chord_ratio: follow(&steps.mixed, 1.0),
            linear_ratio: follow(&steps.linear, metric.mix(0.0, 1.0)),
            angular_ratio: follow(&steps.angular, metric.mix(1.0, 0.0)),
            linear_unit_s: per_second(&steps.linear, seconds),
            angular_rad_s: per_second(&steps.angular, seconds),
            max_step_deg: steps.largest_turn_deg(),
            max_step_change: steps.largest_change(),
            warnings: self.warnings.iter().map(TrajectoryWarning::to_string).collect(),
            u: self.schedule.speeds,
        }
    }

    /// Ratios of `lengths`, one per step, to the asked shares. `weight` converts lengths into the
    /// metric.
    fn follow(&self, lengths: &[f64], weight: f64) -> Option<FollowError> {
        let asked: Vec<f64> = self.schedule.shares.windows(2).map(|w| w[1] - w[0]).collect();
        follow_shares(lengths, weight, &asked, self.course.length)
    }
}

/// Ratios of `lengths` to the asked shares of a path of `length`; `None` if nothing moves.
fn follow_shares(lengths: &[f64], weight: f64, asked: &[f64], length: f64) -> Option<FollowError> {
    let total = NeumaierSum::sum_of(lengths.iter().copied());
    let moves = total * weight > MIN_MOTION * length;
    let ratios = lengths.iter().zip(asked).filter(|(_, asked)| **asked >= MIN_SHARE);
    let ratios: Vec<f64> = ratios.map(|(length, asked)| length / total / asked).collect();
    (moves && !ratios.is_empty()).then(|| FollowError::from_ratios(ratios))
}

impl FollowError {
    /// Statistics of at least one ratio.
    fn from_ratios(ratios: Vec<f64>) -> Self {
        let count = ratios.len();
        let (min, max) = (
            ratios.iter().copied().fold(f64::INFINITY, f64::min),
            ratios.iter().copied().fold(0.0, f64::max),
        );
        let mut away: Vec<f64> = ratios.into_iter().map(|r| (r - 1.0).abs()).collect();
        let rms = (NeumaierSum::sum_of(away.iter().map(|a| a * a)) / count as f64).sqrt();
        // The nearest rank: the smallest deviation that at least 95 % of the ratios do not exceed.
        let rank = (count * 95).div_ceil(100).max(1) - 1;
        let p95 = *away.select_nth_unstable_by(rank, f64::total_cmp).1;
        Self { min, max, rms, p95 }
    }
}

/// Deviation of a curve from its knots.
struct KnotFit {
    distance: f64,
    jumps: Option<KnotJumps>,
}

impl KnotFit {
    /// `None` without a curve through knots.
    fn for_course(course: &PoseCourse) -> Option<Self> {
        let curve = course.line.curve().filter(|_| !course.knots.is_empty())?;
        let metric = course.metric;
        let between = course.length / (course.knots.len() - 1) as f64;
        let away = |(k, knot): (usize, &Se3)| metric.distance(&curve.pose(curve.knot(k)), knot);
        let distance = course.knots.iter().enumerate().map(away).fold(0.0, f64::max) / between;
        // In the curve's own parameter, the mean rate is the distance of the knots divided by their
        // distance in the parameter.
        let whole = NeumaierSum::sum_of(curve.steps().iter().copied());
        let rate = course.length / whole;
        let apart =
            |a: Twist, b: Twist| metric.mix((a.angular - b.angular).length(), (a.linear - b.linear).length());
        let jump = |(k, step): (usize, &f64)| {
            let (left, right) = (CurvePlace { segment: k, x: *step }, CurvePlace { segment: k + 1, x: 0.0 });
            KnotJumps {
                c0: metric.distance(&curve.pose(left), &curve.pose(right)) / between,
                c1: apart(curve.twist(left), curve.twist(right)) / rate,
                c2: apart(curve.acceleration(left), curve.acceleration(right)) / (rate * rate / between),
            }
        };
        // The end of the last segment is no joint.
        let inner = &curve.steps()[..curve.steps().len() - 1];
        let largest = |a: KnotJumps, b: KnotJumps| KnotJumps {
            c0: a.c0.max(b.c0),
            c1: a.c1.max(b.c1),
            c2: a.c2.max(b.c2),
        };
        Some(Self { distance, jumps: inner.iter().enumerate().map(jump).reduce(largest) })
    }
}

/// Lengths of steps over their durations, s.
fn per_second(lengths: &[f64], seconds: impl Fn(usize) -> f64) -> Vec<f64> {
    lengths.iter().enumerate().map(|(j, length)| length / seconds(j)).collect()
}

/// Lengths of the steps between neighbouring poses.
struct StepLengths {
    linear: Vec<f64>,
    angular: Vec<f64>,
    mixed: Vec<f64>,
}

impl StepLengths {
    fn between_poses(poses: &[Se3], metric: MixedMetric) -> Self {
        let pairs = || poses.windows(2);
        let linear: Vec<f64> = pairs().map(|w| (w[1].translation - w[0].translation).length()).collect();
        let angular: Vec<f64> = pairs().map(|w| relative_angle(w[0].rotation, w[1].rotation)).collect();
        let mixed = angular.iter().zip(&linear).map(|(a, l)| metric.mix(*a, *l)).collect();
        Self { linear, angular, mixed }
    }

    /// Largest turn of a step, degrees.
    fn largest_turn_deg(&self) -> f64 {
        self.angular.iter().copied().fold(0.0, f64::max).to_degrees()
    }

    /// Largest change between neighbouring steps over the mean step; 0 where nothing moves.
    fn largest_change(&self) -> f64 {
        let mean = NeumaierSum::sum_of(self.mixed.iter().copied()) / self.mixed.len().max(1) as f64;
        let largest = self.mixed.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        if mean > 0.0 { largest / mean } else { 0.0 }
    }
}
