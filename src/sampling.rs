//! When frames are rendered for the sensor, where a recipe asks for an error and not for a rate
//! (docs/design/numerics-sampling.md, "Frames for a tolerance").
//!
//! ```text
//! poses ─ path ─┬─ flow: how fast the picture moves ─ steps of equal way
//!               └─ pilot: errors of each method at a few steps ─ law ─ cheapest ─ check elsewhere ─ frames
//! ```
//! The error is that of brightness between frames, `k1 V`, in thresholds of the sensor: its root mean
//! square over the pixels in the middles of the intervals, held against what is rendered there. The poses,
//! stamps and pictures of a release stay those of the recipe's rate. The room has also which moments a
//! blurred frame is the mean of ([`exposure`]).

pub mod between;
pub mod choose;
pub mod exposure;
pub mod flow;
pub mod jitter;
pub mod law;
pub mod measure;
pub mod path;
pub mod scout;

use crate::sensor::voltmeter::Between;
use law::Law;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What a recipe asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tolerance {
    /// Root of the mean square of the error, thresholds.
    pub rms: f64,
    /// How brightness is taken between frames, where the recipe says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub between: Option<Between>,
}

/// A method of taking brightness between frames, as the pilot found it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Candidate {
    /// The method.
    pub between: Between,
    /// Its error, thresholds, by the way of the picture in a step, px.
    pub law: Law,
    /// The finest step that was tried, px.
    pub finest_px: f64,
    /// The error there, by the law.
    pub finest: f64,
    /// The share of the squared error that jumps of the renderer make, at the step it needs or else at the
    /// finest.
    pub jumps: f64,
    /// The step it needs, px; `None` where no step that was tried is enough.
    pub step_px: Option<f64>,
    /// Frames of that step.
    pub frames: Option<usize>,
}

impl Candidate {
    /// Of a picture that does not move.
    fn still(between: Between, step_px: f64, frames: usize) -> Self {
        let law = Law { c: 0.0, p: 1.0, jumps: 0.0 };
        let (finest_px, step_px, frames) = (step_px, Some(step_px), Some(frames));
        Self { between, law, finest_px, finest: 0.0, jumps: 0.0, step_px, frames }
    }
}

/// What was chosen for a tolerance, and what it was found to reach.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chosen {
    /// What was asked for, thresholds.
    pub tolerance: f64,
    /// How brightness is taken between frames.
    pub between: Between,
    /// How far the picture moves from frame to frame at most, px: 99 % of its pixels move no farther.
    pub step_px: f64,
    /// Frames.
    pub frames: usize,
    /// The error by the law of the pilot, thresholds.
    pub predicted: f64,
    /// The error on intervals that were held out, thresholds.
    pub achieved: f64,
    /// With 95 % confidence the error of all intervals is no larger, thresholds.
    pub bound_95: f64,
    /// Intervals that were held out.
    pub held_out: usize,
    /// How often the step was made finer because these failed.
    pub refinements: u32,
    /// Frames that were rendered to find out.
    pub pilot_frames: usize,
    /// The methods that were tried.
    pub candidates: Vec<Candidate>,
}

impl fmt::Display for Chosen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, pilot_frames, between, achieved, tolerance, .. } = self;
        let between = between.name();
        write!(
            f,
            "{frames} frames ({between}) and {pilot_frames} to choose them, error {achieved:.4} of {tolerance}"
        )
    }
}
