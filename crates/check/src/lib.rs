//! Validation passes. Each judges the values that it is given. It reads nothing itself, and repairs
//! nothing.
//!
//! Each pass is one file that states what it measures, the source of the formula, its default
//! limits, and whether a fault stops a release (a gate) or not (a warning). A limit set by the
//! recipe is a gate in every pass, because it is intended. What a pass cannot measure, it reports
//! as [`Verdict::NotRun`] with the reason.
//!
//! The values are events of `gs2e-event`, the laws of `gs2e-sensor`, poses of `gs2e-trajectory`, cameras
//! of `gs2e-scene`, images of `gs2e-image`, captures and the reports of other programs of `gs2e-source`,
//! and the held-out views of `gs2e-train`; rates come from `gs2e-num`. `gs2e-recipe` reads the limits.
//! `gs2e-build` judges its products, `gs2e-dataset` the data of others, and `gs2e-audit` and
//! `gs2e-publish` the files of a release. `gs2e-release` lists the findings.
//!
//! # Examples
//!
//! ```
//! use gs2e_check::{Finding, Limits, Verdict, join_findings};
//!
//! let limits: Limits = serde_json::from_str(r#"{"event_rate": {"max": 50}}"#)?;
//! assert_eq!(limits.event_rate.and_then(|rate| rate.max), Some(50.0));
//!
//! // The worse verdict counts if a build and the files of its release were both judged.
//! let built: Finding = serde_json::from_str(r#"{"check": "event_rate", "subject": "table/base",
//!     "verdict": "pass", "measured": 40, "limit": 50, "unit": "ev/(px s)", "because": "40 of 50"}"#)?;
//! let files = Finding { verdict: Verdict::Fail, measured: Some(60.0), ..built.clone() };
//! assert_eq!(join_findings(vec![built], vec![files.clone()]), [files]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod advice;
pub mod affine;
mod ahead;
pub mod alignment;
pub mod batching;
pub mod capture;
pub mod completeness;
pub mod coverage;
pub mod depth_consistency;
pub mod drift;
pub mod drift_identity;
pub mod duplicates;
pub mod event_frame;
pub mod event_rate;
pub mod event_times;
mod finding_subject;
pub mod flash;
pub mod flow_projection;
pub mod geometry;
pub mod hot_pixels;
mod joined;
pub mod limits;
pub mod motion;
pub mod noise_floor;
pub mod photometric;
pub mod polarity;
pub mod pose_colmap;
pub mod pose_continuity;
pub mod pose_opencv;
pub mod readback;
pub mod recon_psnr;
pub mod records;
pub mod refractory;
pub mod sampling;
mod scene_subject;
pub mod schema;
pub mod speed;
pub mod stamps;
pub mod structure;
pub mod subject;
mod table;
pub mod tally;
pub mod time_offset;

pub use advice::advice;
pub use finding_subject::FindingSubject;
pub use joined::join_findings;
pub use limits::{CheckWaiver, Limits, REASON};
pub use scene_subject::{CapturePhotos, SceneSubject};
pub use subject::{Judgement, JudgementResult, TrajectorySubject};
pub use tally::StreamTally;

use serde::{Deserialize, Serialize};
use subject::{Statements, findings_of};
use table::check_table;

/// The verdict of a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Within the limit.
    Pass,
    /// Outside a limit that does not stop a release.
    Warn,
    /// Outside a limit that stops a release.
    Fail,
    /// Failed, but accepted by the recipe with a reason.
    Waived,
    /// Not run; `because` gives the reason.
    NotRun,
}

impl Verdict {
    /// The name in records.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Warn => "warn",
            Self::Fail => "fail",
            Self::Waived => "waived",
            Self::NotRun => "not-run",
        }
    }
}

/// The check record of every report and of `checks.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// Name of the pass, see [`NAMES`].
    pub check: String,
    /// The subject: the trajectory, and the statement if a pass makes several.
    pub subject: FindingSubject,
    /// The verdict.
    pub verdict: Verdict,
    /// The measured value, in `unit`; `None` if nothing could be measured.
    pub measured: Option<f64>,
    /// The limit.
    pub limit: Option<f64>,
    /// Unit of both values; `1` for pure numbers.
    pub unit: String,
    /// One sentence for people with the measured value and the limit.
    pub because: String,
    /// The smallest fault that this pass would have found in this subject, if it states one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detects: Option<DetectableFault>,
}

/// The power of a pass: a fault of this size is found with a probability of at least 95 %.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectableFault {
    /// Size of the fault.
    pub size: f64,
    /// Its unit, which may differ from that of the measured value.
    pub unit: String,
}

impl DetectableFault {
    /// A fault of `size` in `unit`.
    #[must_use]
    pub fn new(size: f64, unit: &str) -> Self {
        Self { size, unit: unit.to_owned() }
    }
}

macro_rules! names_of {
    ($($name:ident ($($limits:tt)*) ($(scene $scene:ident)? $(tree $tree:ident)? $(pass $pass:path)?)
        $advice:literal;)+) => {
        /// The names in a recipe's `checks:` and in the records.
        pub const NAMES: [&str; [$(stringify!($name)),+].len()] = [$(stringify!($name)),+];

        /// The passes over trajectories with their names, in the order of reports.
        const PASSES: &[(&str, &dyn ValidationPass)] = &[$($((stringify!($name), &$pass),)?)+];

        /// The checks of the files of a release, which no recipe can waive.
        const TREE: &[&str] = &[$($(stringify!($tree),)?)+];

        /// The checks of a whole scene, in the order of reports.
        const SCENE: &[&str] = &[$($(stringify!($scene),)?)+];
    };
}

check_table!(names_of);

/// Returns true if a recipe can waive the check of this name.
#[must_use]
pub fn is_waivable(check: &str) -> bool {
    NAMES.contains(&check) && !TREE.contains(&check)
}

/// A validation pass. An error is the reason why it cannot make any statement.
trait ValidationPass: Sync {
    /// The statements on a trajectory, independent of sensors.
    fn of_trajectory(&self, _: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(Vec::new())
    }

    /// The statements on the stream of one sensor. Together, the two methods must make at least one.
    fn of_stream(&self, _: &TrajectorySubject<'_>) -> Result<Statements, String> {
        Ok(Vec::new())
    }
}

/// Runs every pass over a trajectory and its streams. Faults that the recipe accepts become
/// [`Verdict::Waived`]. Without a stream, the passes over streams get a subject without events.
#[must_use]
pub fn judge_trajectory(
    trajectory: &TrajectorySubject<'_>,
    streams: &[TrajectorySubject<'_>],
) -> Vec<Finding> {
    // Without a stream, each pass over streams still reports that it was not run.
    let streams = if streams.is_empty() { std::slice::from_ref(trajectory) } else { streams };
    let run = |(check, pass): &(&str, &dyn ValidationPass)| {
        let of_stream =
            |stream: &TrajectorySubject<'_>| findings_of(stream.name, check, pass.of_stream(stream));
        let mut findings = findings_of(trajectory.name, check, pass.of_trajectory(trajectory));
        findings.extend(streams.iter().flat_map(of_stream));
        findings
    };
    let mut findings: Vec<Finding> = PASSES.iter().flat_map(run).collect();
    for finding in &mut findings {
        apply_waivers(finding, &trajectory.limits.waive);
    }
    findings
}

/// Runs the passes over a scene, as [`judge_trajectory`] does for a trajectory.
#[must_use]
pub fn judge_scene(scene: &SceneSubject<'_>) -> Vec<Finding> {
    let statements =
        [("capture", capture::judge_capture(scene)), ("recon_psnr", recon_psnr::judge_photos(scene))];
    let findings = |(check, made)| findings_of(scene.name, check, Ok(made));
    let mut findings: Vec<Finding> = statements.into_iter().flat_map(findings).collect();
    for finding in &mut findings {
        apply_waivers(finding, &scene.limits.waive);
    }
    findings
}

fn apply_waivers(finding: &mut Finding, waivers: &[CheckWaiver]) {
    let waiver = waivers.iter().find(|waiver| waiver.check == finding.check);
    // A warning stops nothing, so there is nothing to accept.
    if let (Verdict::Fail, Some(waiver)) = (finding.verdict, waiver) {
        finding.verdict = Verdict::Waived;
        finding.because = format!("{}; accepted: {}", finding.because, waiver.because);
    }
}

#[cfg(test)]
mod planted;
#[cfg(test)]
mod tests;
