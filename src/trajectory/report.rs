//! What a trajectory was asked to do and what it does: `speed.json` of a release.

use super::Warning;
use super::knots::{Gap, Knots, Merged};
use super::metric::{ALPHA, BETA, Metric};
use super::refine::{Curve, Refine};
use super::sample::Schedule;
use crate::se3::Se3;
use crate::se3::rotation::angle;
use crate::se3::sum::Sum;
use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// Steps asked to be shorter than this share of the path are left out of ratios: the positions of their ends, sums
/// near 1, are rounded to 1e-4 of them.
const LEAST_SHARE: f64 = 1e-12;
/// A part of the motion that makes less than this share of the path is rounding, and follows nothing.
const LEAST_PART: f64 = 1e-9;

/// Achieved share of the path over the asked share, over all steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Follow {
    /// Smallest ratio.
    pub min: f64,
    /// Largest ratio.
    pub max: f64,
    /// Root of the mean squared deviation of the ratios from 1.
    pub rms: f64,
}

/// How the speed law was summed over a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Summation {
    /// The paper's left sum over the poses.
    Sum,
}

/// What large values of a speed law mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Meaning {
    /// Large steps.
    Speed,
}

/// The content of `speed.json`, in the order of its keys. Every number is finite; what has no value is `null`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// The curve through the knots.
    pub curve: Curve,
    /// Degree that was drawn for a Bezier curve.
    pub degree_drawn: Option<u32>,
    /// Degree that was used for a Bezier curve.
    pub degree_used: Option<u32>,
    /// How the speed law was summed.
    pub law: Summation,
    /// Whether the paper's chord lengths were taken as they are.
    pub literal: bool,
    /// What the speed law means.
    pub meaning: Meaning,
    /// Weight of rotation in the metric, per radian.
    pub alpha: f64,
    /// Weight of translation in the metric, per scale distance.
    pub beta: f64,
    /// The scale distance D, units.
    pub scale_distance: f64,
    /// Poses per view as `a/b`, where that set their number.
    pub gamma: Option<String>,
    /// Frame rate as `p/q`, per second.
    pub rate: String,
    /// Number of poses.
    #[serde(rename = "M")]
    pub poses: usize,
    /// Length of the chords between knots in the metric.
    #[serde(rename = "S")]
    pub length: f64,
    /// Length of the fitted curve over that of the chords.
    pub length_ratio: Option<f64>,
    /// Runs of views that coincide after smoothing.
    pub merged: Vec<Merged>,
    /// Gaps in the capture.
    pub gaps: Vec<Gap>,
    /// Asked speed of each step.
    pub u: Vec<f64>,
    /// Asked length of the path before each pose, in the metric: 0 to S.
    pub s: Vec<f64>,
    /// Mixed metric, measured as arc length along the curve.
    pub mixed_ratio: Option<Follow>,
    /// Mixed metric, measured as chords between neighbouring poses.
    pub mixed_chord_ratio: Option<Follow>,
    /// Distance between neighbouring centres.
    pub linear_ratio: Option<Follow>,
    /// Angle between neighbouring poses.
    pub angular_ratio: Option<Follow>,
    /// Linear speed of each step, units per second.
    pub linear_unit_s: Vec<f64>,
    /// Angular speed of each step, radians per second.
    pub angular_rad_s: Vec<f64>,
    /// Largest turn between neighbouring poses, degrees.
    pub max_step_deg: f64,
    /// Largest change between neighbouring steps in the metric, over the mean step.
    pub max_step_change: f64,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// What a report is made from, beside the poses.
pub(super) struct Asked<'a> {
    pub(super) params: &'a Refine,
    pub(super) metric: Metric,
    pub(super) rate: Hertz,
    pub(super) schedule: Schedule,
    pub(super) knots: &'a Knots<'a>,
    pub(super) gaps: &'a [Gap],
    pub(super) warnings: &'a [Warning],
}

impl Asked<'_> {
    /// The report over `poses`. `arcs` are the lengths of the steps along the fitted curve, none where the camera
    /// stands still.
    pub(super) fn report(self, poses: &[Se3], arcs: &[f64]) -> Report {
        let length = self.knots.length();
        let steps = Steps::of(poses, self.metric);
        let follow = |lengths: &[f64], weight: f64| self.follow(lengths, weight);
        let per_second = |lengths: &[f64]| lengths.iter().map(|l| l * self.rate.to_f64()).collect();
        Report {
            curve: self.params.curve,
            degree_drawn: None,
            degree_used: None,
            law: Summation::Sum,
            literal: self.params.literal,
            meaning: Meaning::Speed,
            alpha: ALPHA,
            beta: BETA,
            scale_distance: self.metric.scale,
            gamma: self.params.count.gamma().map(|g| g.to_string()),
            rate: self.rate.0.to_string(),
            poses: poses.len(),
            length,
            length_ratio: (!arcs.is_empty()).then(|| Sum::of(arcs.iter().copied()) / length),
            merged: self.knots.merged.clone(),
            gaps: self.gaps.to_vec(),
            s: self.schedule.shares.iter().map(|share| share * length).collect(),
            mixed_ratio: follow(arcs, 1.0),
            mixed_chord_ratio: follow(&steps.mixed, 1.0),
            linear_ratio: follow(&steps.linear, self.metric.mix(0.0, 1.0)),
            angular_ratio: follow(&steps.angular, self.metric.mix(1.0, 0.0)),
            linear_unit_s: per_second(&steps.linear),
            angular_rad_s: per_second(&steps.angular),
            max_step_deg: steps.angular.iter().copied().fold(0.0, f64::max).to_degrees(),
            max_step_change: steps.largest_change(),
            warnings: self.warnings.iter().map(Warning::to_string).collect(),
            u: self.schedule.speeds,
        }
    }

    /// How `lengths`, one a step, follow the asked shares; `weight` turns them into the metric.
    fn follow(&self, lengths: &[f64], weight: f64) -> Option<Follow> {
        let total = Sum::of(lengths.iter().copied());
        let moves = total * weight > LEAST_PART * self.knots.length();
        let asked = self.schedule.shares.windows(2).map(|w| w[1] - w[0]);
        let ratios = lengths.iter().zip(asked).filter(|(_, asked)| *asked >= LEAST_SHARE);
        let ratios: Vec<f64> = ratios.map(|(length, asked)| length / total / asked).collect();
        (moves && !ratios.is_empty()).then(|| Follow {
            min: ratios.iter().copied().fold(f64::INFINITY, f64::min),
            max: ratios.iter().copied().fold(0.0, f64::max),
            rms: (Sum::of(ratios.iter().map(|r| (r - 1.0) * (r - 1.0))) / ratios.len() as f64).sqrt(),
        })
    }
}

/// Lengths of the steps between neighbouring poses.
struct Steps {
    linear: Vec<f64>,
    angular: Vec<f64>,
    mixed: Vec<f64>,
}

impl Steps {
    fn of(poses: &[Se3], metric: Metric) -> Self {
        let pairs = || poses.windows(2);
        let linear: Vec<f64> = pairs().map(|w| (w[1].translation - w[0].translation).length()).collect();
        let angular: Vec<f64> = pairs().map(|w| angle(w[0].rotation, w[1].rotation)).collect();
        let mixed = angular.iter().zip(&linear).map(|(a, l)| metric.mix(*a, *l)).collect();
        Self { linear, angular, mixed }
    }

    /// Largest change between neighbouring steps over the mean step; 0 where nothing moves.
    fn largest_change(&self) -> f64 {
        let mean = Sum::of(self.mixed.iter().copied()) / self.mixed.len().max(1) as f64;
        let largest = self.mixed.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        if mean > 0.0 { largest / mean } else { 0.0 }
    }
}
