//! Scenes that a partial release holds back, with the reasons.

use gs2e_check::Finding;
use serde::{Deserialize, Serialize};

/// A scene that is not in the release, because a check failed or a step was not built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldBackScene {
    /// Scene id.
    pub id: String,
    /// The checks that failed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub checks: Vec<Finding>,
    /// Name of the first step that was not built.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unbuilt: Option<String>,
}

impl HeldBackScene {
    /// The reasons, one sentence each, without a full stop.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let failed = |f: &Finding| format!("{} failed: {}: {}", f.check, f.subject, f.because);
        let unbuilt = self.unbuilt.iter().map(|step| format!("the step {step} was not built"));
        self.checks.iter().map(failed).chain(unbuilt).collect()
    }
}
