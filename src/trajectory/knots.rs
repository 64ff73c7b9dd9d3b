//! The knots of a path: smoothed poses, measured, the coinciding ones merged, gaps between them found.

use super::metric::{Metric, median};
use super::refine::Gaps;
use super::smooth::{mean_centre, mean_rotation};
use super::{NamedPose, TrajectoryError, Warning};
use crate::se3::Se3;
use crate::se3::rotation::aligned;
use crate::se3::rotation_spline::turn;
use crate::se3::sum::Sum;
use serde::{Deserialize, Serialize};

/// Neighbours closer than this share of the median step are one knot: equal knots make the fit singular.
const COINCIDE: f64 = 1e-6;
/// A few tens of roundings: what the means of a window leave between equal poses.
const ROUNDING: f64 = 1e-14;
/// Neighbours further apart than this many median steps have a gap between them: frames that did not register.
pub const GAP: f64 = 8.0;

/// Views that coincide after smoothing and make one knot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Merged {
    /// Image of the first of them.
    pub first: String,
    /// Image of the last of them.
    pub last: String,
    /// How many they are.
    pub count: usize,
}

/// A gap in the capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// Image of the view before it.
    pub after: String,
    /// Image of the view after it.
    pub before: String,
    /// Its length over the median step.
    pub times_median: f64,
}

/// Knots and the steps between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Knots<'a> {
    /// One pose a knot, under the name of its first view; no two neighbours coincide, and neighbouring quaternions
    /// lie in one hemisphere.
    pub(super) poses: Vec<NamedPose<'a>>,
    /// Distance from each knot to the next, positive.
    pub(super) steps: Vec<f64>,
    /// Where views were merged.
    pub(super) merged: Vec<Merged>,
    /// Gaps, by knot order.
    pub(super) gaps: Vec<Gap>,
}

impl<'a> Knots<'a> {
    /// Measures smoothed poses and merges neighbours that coincide. Where none moves, one knot is left.
    ///
    /// # Errors
    /// Where the rotations of a long run of coinciding views have no mean.
    pub(super) fn new(views: &[NamedPose<'a>], metric: Metric) -> Result<Self, TrajectoryError> {
        let apart = distances(views, metric);
        let still = rounding(views, metric);
        let limit = still.max(COINCIDE * median(apart.iter().copied().filter(|d| *d > still).collect()));
        let mut knots = Self { poses: Vec::new(), steps: Vec::new(), merged: Vec::new(), gaps: Vec::new() };
        let mut start = 0;
        for end in 1..=views.len() {
            if end == views.len() || apart[end - 1] > limit {
                knots.push(&views[start..end])?;
                start = end;
            }
        }
        knots.steps = distances(&knots.poses, metric);
        knots.gaps = gaps(&knots.poses, &knots.steps);
        Ok(knots)
    }

    fn push(&mut self, run: &[NamedPose<'a>]) -> Result<(), TrajectoryError> {
        let mut knot = run[0];
        if let [first, .., last] = run {
            knot.world_from_camera = Se3 { rotation: mean_rotation(run)?, translation: mean_centre(run) };
            let (first, last) = (first.name.to_owned(), last.name.to_owned());
            self.merged.push(Merged { first, last, count: run.len() });
        }
        if let Some(before) = self.poses.last() {
            let rotation = &mut knot.world_from_camera.rotation;
            *rotation = aligned(*rotation, before.world_from_camera.rotation);
        }
        self.poses.push(knot);
        Ok(())
    }

    /// Length of the path through the knots.
    pub(super) fn length(&self) -> f64 {
        Sum::of(self.steps.iter().copied())
    }

    /// What is worth a warning, or the error for a gap that must not be bridged.
    pub(super) fn judge(&self, gaps: Gaps, warnings: &mut Vec<Warning>) -> Result<(), TrajectoryError> {
        for Gap { after, before, times_median } in self.gaps.clone() {
            match gaps {
                Gaps::Bridge => warnings.push(Warning::Gap { after, before, times_median }),
                Gaps::Refuse => return Err(TrajectoryError::Gap { after, before, times_median, limit: GAP }),
            }
        }
        for w in self.poses.windows(2) {
            if turn(w[0].world_from_camera.rotation, w[1].world_from_camera.rotation).1 {
                let (after, before) = (w[0].name.to_owned(), w[1].name.to_owned());
                warnings.push(Warning::HalfTurn { after, before });
            }
        }
        Ok(())
    }
}

fn distances(poses: &[NamedPose<'_>], metric: Metric) -> Vec<f64> {
    poses.windows(2).map(|w| metric.distance(&w[0].world_from_camera, &w[1].world_from_camera)).collect()
}

/// Distances that rounding alone makes between equal poses, after smoothing: 1e-14 rad, and as much of the largest
/// centre.
fn rounding(poses: &[NamedPose<'_>], metric: Metric) -> f64 {
    let farthest = poses.iter().map(|p| p.world_from_camera.translation.length()).fold(0.0, f64::max);
    metric.mix(ROUNDING, ROUNDING * farthest)
}

fn gaps(poses: &[NamedPose<'_>], steps: &[f64]) -> Vec<Gap> {
    let median = median(steps.to_vec());
    let gap = |(i, step): (usize, &f64)| Gap {
        after: poses[i].name.to_owned(),
        before: poses[i + 1].name.to_owned(),
        times_median: step / median,
    };
    steps.iter().enumerate().filter(|(_, step)| **step > GAP * median).map(gap).collect()
}
