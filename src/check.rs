//! Validation passes: each judges values that it is handed, fetches nothing and repairs nothing.
//!
//! A pass is one file: what it measures, where the formula is from, its default limits, and whether it is a gate (a
//! fault stops a release) or a warning. A limit that the recipe sets is a gate in every pass: who states a limit
//! means it.

pub mod batching;
pub mod duplicates;
pub mod event_frame;
pub mod event_rate;
pub mod limits;
pub mod polarity;
pub mod pose_continuity;
pub mod sampling;
pub mod speed;

pub use limits::{Limits, Waiver};

use serde::{Deserialize, Serialize};

/// What a pass found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Within limits.
    Pass,
    /// Outside a limit that does not stop a release.
    Warn,
    /// Outside a limit that does.
    Fail,
    /// Failed, and accepted by the recipe with a reason.
    Waived,
    /// Could not be run; `because` says why.
    NotRun,
}

/// The check record of every report and of `checks.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// Name of the pass, see [`NAMES`].
    pub check: String,
    /// What was judged: `scene/trajectory`, with a suffix where a pass makes several statements.
    pub subject: String,
    /// The judgement.
    pub verdict: Verdict,
    /// The number that was judged, in `unit`; `None` where nothing could be measured.
    pub measured: Option<f64>,
    /// The limit it was held against.
    pub limit: Option<f64>,
    /// Unit of both, `1` for pure numbers.
    pub unit: String,
    /// One sentence for people: what was measured, and against what.
    pub because: String,
}

/// The names that a recipe's `checks:` and the records use.
pub const NAMES: [&str; 22] = [
    "schema",
    "stamps",
    "duplicates",
    "event_rate",
    "polarity",
    "refractory",
    "batching",
    "hot_pixels",
    "structure",
    "event_frame",
    "motion",
    "time_offset",
    "noise_floor",
    "sampling",
    "drift_identity",
    "readback",
    "pose_continuity",
    "pose_colmap",
    "pose_opencv",
    "speed",
    "recon_psnr",
    "capture",
];
