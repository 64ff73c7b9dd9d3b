//! Findings, and the statements of other programs.

use super::{Artifact, ArtifactError, ArtifactFiles};
use gs2e_check::{Finding, Verdict};
use gs2e_source::foreign::ExternalReport;
use serde::{Deserialize, Serialize};

impl Artifact for ExternalReport {
    const KIND: &'static str = "foreign";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("foreign.json")
    }
}

/// The findings on a trajectory or on a scene: `verdicts.json`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerdictsRecord {
    /// One record per statement. Subjects contain only the name of a stream and the suffix of the
    /// statement.
    pub findings: Vec<Finding>,
    /// Largest number of events in one millisecond, per stream; empty for a scene.
    pub peaks_ev_per_ms: Vec<u64>,
}

impl VerdictsRecord {
    /// Returns true if the step of this name, without its scene, makes such a record.
    #[must_use]
    pub fn is_of(step: &str) -> bool {
        // The steps of both stages are named after them.
        step.rsplit('/').next() == Some(Self::KIND)
    }

    /// Numbers of findings that passed and that were not run, if all findings are of these.
    #[must_use]
    pub fn sound_counts(&self) -> Option<[usize; 2]> {
        let counts = [Verdict::Pass, Verdict::NotRun]
            .map(|verdict| self.findings.iter().filter(|found| found.verdict == verdict).count());
        (counts.iter().sum::<usize>() == self.findings.len()).then_some(counts)
    }

    /// The findings on a scene, with its id.
    #[must_use]
    pub fn findings_of_scene(self, scene: &str) -> Vec<Finding> {
        // Findings are stored without the scene's id, because it is not part of the step.
        findings_below(scene, self.findings)
    }

    /// The findings, with the trajectory as their subject.
    #[must_use]
    pub fn findings_of(self, scene: &str, trajectory: &str) -> Vec<Finding> {
        // The names of scene and trajectory are not part of the step either.
        findings_below(&format!("{scene}/{trajectory}"), self.findings)
    }
}

fn findings_below(place: &str, findings: Vec<Finding>) -> Vec<Finding> {
    findings.into_iter().map(|found| Finding { subject: found.subject.below(place), ..found }).collect()
}

impl Artifact for VerdictsRecord {
    const KIND: &'static str = "checks";

    fn open(files: &ArtifactFiles) -> Result<Self, ArtifactError> {
        files.json("verdicts.json")
    }
}
