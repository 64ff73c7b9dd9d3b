//! Choice of the frames for the sensor, where a recipe gives an error and not a frame rate.
//!
//! ```text
//! poses ─ path ─┬─ flow: speed of the picture ─ steps of equal motion
//!               └─ pilot: errors of each method at a few steps ─ law ─ choice ─ check ─ frames
//! ```
//! The error is that of brightness between frames, `k1 V`, in thresholds of the sensor. It is the
//! root mean square over the pixels at the middles of the intervals, compared with a rendering
//! there.
//! The poses, stamps and pictures of a release stay those of the recipe's rate. This module also
//! chooses the sub-frames of blurred frames ([`exposure`]).
//!
//! It renders a scene of `gs2e-scene` with `gs2e-render` along a trajectory of `gs2e-trajectory`, and
//! knows the interpolations of `gs2e-sensor`, which receives the frames. Colours and seeds come from
//! `gs2e-image` and `gs2e-num`, and `gs2e-files` removes kept frames. `gs2e-recipe` reads its settings
//! and `gs2e-build` runs it. `gs2e-release` and `gs2e-audit` use its rules of exposures, and `gs2e-lab`
//! measures its laws.
//!
//! # Examples
//!
//! ```
//! use gs2e_sampling::law::ErrorLaw;
//!
//! // Errors of second order, `2 h^2`, at three steps in px.
//! let points = [(1.0, 2.0), (0.5, 0.5), (0.25, 0.125)];
//! let law = ErrorLaw::fit_points(&points).ok_or("the points determine no law")?;
//! assert!((law.p - 2.0).abs() < 1e-4);
//! // An error of at most 0.08 thresholds needs a step of 0.2 px.
//! let step = law.step(0.08, [0.01, 1.0]).ok_or("no step is small enough")?;
//! assert!((step - 0.2).abs() < 1e-4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod between;
pub mod choose;
pub mod exposure;
pub mod flow;
pub mod jitter;
pub mod kept;
pub mod law;
pub mod measure;
pub mod rendered;
pub mod rolling;
pub mod scout;

use gs2e_sensor::voltmeter::BetweenFrames;
use law::ErrorLaw;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A tolerance as requested by a recipe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorTolerance {
    /// Root mean square of the error, thresholds.
    pub rms: f64,
    /// Interpolation of brightness between frames, if the recipe fixes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub between: Option<BetweenFrames>,
    /// The frames that are rendered for the choice. It enters the key.
    pub pilot: PilotMethod,
}

/// The frames of a pilot. A change of the choice is another method, so that keys of choices change, and no
/// others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PilotMethod {
    /// A sample of the tiles of each frame.
    #[default]
    Tiles,
}

/// A method of interpolation, as measured by the pilot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BetweenCandidate {
    /// The method.
    pub between: BetweenFrames,
    /// Its error in thresholds, as a function of the image motion per step, px.
    pub law: ErrorLaw,
    /// The finest step that was tried, px.
    pub finest_px: f64,
    /// The error at that step, by the fitted law.
    pub finest: f64,
    /// The share of the squared error that comes from jumps of the renderer, at the required step
    /// or else at the finest.
    pub jumps: f64,
    /// The required step, px; `None` if no step that was tried is sufficient.
    pub step_px: Option<f64>,
    /// Number of frames at that step.
    pub frames: Option<usize>,
}

impl BetweenCandidate {
    /// The candidate for a picture that does not move.
    fn without_motion(between: BetweenFrames, step_px: f64, frames: usize) -> Self {
        let law = ErrorLaw { c: 0.0, p: 1.0, jumps: 0.0 };
        let (finest_px, step_px, frames) = (step_px, Some(step_px), Some(frames));
        Self { between, law, finest_px, finest: 0.0, jumps: 0.0, step_px, frames }
    }
}

/// The choice for a tolerance, and its measured error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingChoice {
    /// The tolerance, thresholds.
    pub tolerance: f64,
    /// Interpolation of brightness between frames.
    pub between: BetweenFrames,
    /// Maximum image motion between frames, px: 99 % of the pixels move no farther.
    pub step_px: f64,
    /// Number of frames.
    pub frames: usize,
    /// The error predicted by the pilot, thresholds.
    pub predicted: f64,
    /// The error on held-out intervals, thresholds.
    pub achieved: f64,
    /// Upper bound, with 95 % confidence, of the error over all intervals, thresholds.
    pub bound_95: f64,
    /// Number of held-out intervals.
    pub held_out: usize,
    /// Number of times that the step was refined because held-out intervals failed.
    pub refinements: u32,
    /// Number of frames rendered for the choice.
    pub pilot_frames: usize,
    /// The mean share of their pixels that were rendered, 0..1.
    #[serde(default = "whole")]
    pub pilot_share: f64,
    /// The methods that were tried.
    pub candidates: Vec<BetweenCandidate>,
}

/// The share of records without one: they are of programs that rendered whole frames.
fn whole() -> f64 {
    1.0
}

impl fmt::Display for SamplingChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, between, achieved, tolerance, .. } = self;
        let between = match between {
            BetweenFrames::Linear => "linear interpolation",
            BetweenFrames::Catmull => "cubic interpolation",
            BetweenFrames::Hermite => "cubic interpolation with rates",
        };
        write!(f, "{frames} frames, {between}; error {achieved:.3} of a threshold (allowed {tolerance})")
    }
}
