//! The knots of a path: smoothed poses are measured, coinciding ones merged, and gaps between them
//! found.

use super::metric::MixedMetric;
use super::refine::GapRule;
use super::smooth::{mean_centre, mean_rotation};
use super::{NamedPose, TrajectoryError, TrajectoryWarning};
use gs2e_num::se3::Se3;
use gs2e_num::se3::rotation::same_hemisphere;
use gs2e_num::se3::rotation_spline::turn_between;
use gs2e_num::se3::sum::NeumaierSum;
use gs2e_num::stats::mean_median;
use serde::{Deserialize, Serialize};

/// Neighbours closer than this share of the median step become one knot, because equal knots make
/// the fit singular.
const COINCIDE: f64 = 1e-6;
/// Some tens of roundings: the difference that the means of a window leave between equal poses.
const ROUNDING: f64 = 1e-14;
/// Distance between neighbours, in median steps, that counts as a gap: frames that did not
/// register.
pub const GAP: f64 = 8.0;

/// A run of views that coincide after smoothing and become one knot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MergedViews {
    /// Image of the first view.
    pub first: String,
    /// Image of the last view.
    pub last: String,
    /// Number of views.
    pub count: usize,
}

/// A gap in the capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptureGap {
    /// Image of the view before the gap.
    pub after: String,
    /// Image of the view after the gap.
    pub before: String,
    /// Its length divided by the median step.
    pub times_median: f64,
}

/// Knots and the steps between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct KnotSequence<'a> {
    /// One pose per knot, under the name of its first view. No two neighbours coincide, and
    /// neighbouring quaternions lie in one hemisphere.
    pub(super) poses: Vec<NamedPose<'a>>,
    /// Distance from each knot to the next, positive.
    pub(super) steps: Vec<f64>,
    /// Runs of merged views.
    pub(super) merged: Vec<MergedViews>,
    /// Number of views.
    views: usize,
}

impl<'a> KnotSequence<'a> {
    /// Measures smoothed poses, and merges neighbours that coincide. If nothing moves, one knot
    /// remains.
    ///
    /// # Errors
    /// The rotations of a long run of coinciding views have no mean.
    pub(super) fn new(views: &[NamedPose<'a>], metric: MixedMetric) -> Result<Self, TrajectoryError> {
        let apart = knot_distances(views, metric);
        let still = rounding_distance(views, metric);
        // Steps that are only rounding stay out of the median, which a camera at rest would
        // otherwise bring down to rounding.
        let limit = still.max(
            COINCIDE * mean_median(apart.iter().copied().filter(|d| *d > still).collect()).unwrap_or(0.0),
        );
        let mut knots = Self { poses: Vec::new(), steps: Vec::new(), merged: Vec::new(), views: views.len() };
        let mut start = 0;
        for end in 1..=views.len() {
            if end == views.len() || apart[end - 1] > limit {
                knots.push(&views[start..end])?;
                start = end;
            }
        }
        // A merged knot is the mean of its run, so the steps must be measured again.
        knots.steps = knot_distances(&knots.poses, metric);
        Ok(knots)
    }

    fn push(&mut self, run: &[NamedPose<'a>]) -> Result<(), TrajectoryError> {
        let mut knot = run[0];
        if let [first, .., last] = run {
            knot.world_from_camera = Se3 { rotation: mean_rotation(run)?, translation: mean_centre(run) };
            let (first, last) = (first.name.to_owned(), last.name.to_owned());
            self.merged.push(MergedViews { first, last, count: run.len() });
        }
        if let Some(before) = self.poses.last() {
            // A mean of rotations may come out with either sign of its quaternion.
            let rotation = &mut knot.world_from_camera.rotation;
            *rotation = same_hemisphere(*rotation, before.world_from_camera.rotation);
        }
        self.poses.push(knot);
        Ok(())
    }

    /// Number of views before merging.
    pub(super) fn views(&self) -> usize {
        self.views
    }

    /// Length of the path through the knots.
    pub(super) fn length(&self) -> f64 {
        NeumaierSum::sum_of(self.steps.iter().copied())
    }

    /// Neighbours that are half a turn apart.
    pub(super) fn half_turns(&self) -> impl Iterator<Item = TrajectoryWarning> {
        let half = |w: &&[NamedPose<'_>]| {
            turn_between(w[0].world_from_camera.rotation, w[1].world_from_camera.rotation).1
        };
        self.poses.windows(2).filter(half).map(|w| TrajectoryWarning::HalfTurn {
            after: w[0].name.to_owned(),
            before: w[1].name.to_owned(),
        })
    }
}

/// The gaps in a capture, in path order. They are looked for before smoothing, which spreads a gap
/// over its window. A gap of 12 median steps in a hand-held capture is under 8 of them everywhere
/// after smoothing with half-width 2.
pub(super) fn find_gaps(views: &[NamedPose<'_>], metric: MixedMetric) -> Vec<CaptureGap> {
    let apart = knot_distances(views, metric);
    let still = rounding_distance(views, metric);
    let median = mean_median(apart.iter().copied().filter(|d| *d > still).collect()).unwrap_or(0.0);
    let gap = |(i, step): (usize, &f64)| CaptureGap {
        after: views[i].name.to_owned(),
        before: views[i + 1].name.to_owned(),
        times_median: step / median,
    };
    // The second condition counts where all views coincide: the median is 0 then, and every
    // rounding error exceeds 8 times that.
    apart.iter().enumerate().filter(|(_, step)| **step > GAP * median && **step > still).map(gap).collect()
}

/// Warnings for gaps that are bridged, or an error for the first gap if gaps are refused.
pub(super) fn judge_gaps(
    gaps: &[CaptureGap],
    policy: GapRule,
) -> Result<Vec<TrajectoryWarning>, TrajectoryError> {
    match (policy, gaps.first().cloned()) {
        (GapRule::Refuse, Some(CaptureGap { after, before, times_median })) => {
            Err(TrajectoryError::Gap { after, before, times_median, limit: GAP })
        }
        _ => Ok(gaps
            .iter()
            .cloned()
            .map(|CaptureGap { after, before, times_median }| TrajectoryWarning::Gap {
                after,
                before,
                times_median,
            })
            .collect()),
    }
}

pub(super) fn knot_distances(poses: &[NamedPose<'_>], metric: MixedMetric) -> Vec<f64> {
    poses.windows(2).map(|w| metric.distance(&w[0].world_from_camera, &w[1].world_from_camera)).collect()
}

/// Distances that rounding alone makes between equal poses, after smoothing: 1e-14 rad, and 1e-14
/// times the largest distance of a centre from the origin.
pub(super) fn rounding_distance(poses: &[NamedPose<'_>], metric: MixedMetric) -> f64 {
    let farthest = poses.iter().map(|p| p.world_from_camera.translation.length()).fold(0.0, f64::max);
    metric.mix(ROUNDING, ROUNDING * farthest)
}
