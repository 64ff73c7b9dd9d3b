//! The action of each step, its reason, and failures of planning.

use super::{DescriptionChange, SourceFiles, changed_lines};
use crate::stage::StageError;
use gs2e_recipe::RecipePosition;
use gs2e_store::description::{DescribedValue, ExplanationLine};
use gs2e_store::record::StoredOutput;
use gs2e_store::{Key, StoreError};
use serde::Serialize;

/// The action for a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepAction {
    /// It must run: its key has no sound record.
    Run,
    /// An input will run, or a program must be asked for its version. If both are as before, the
    /// step stays.
    MayRun,
    /// Up to date.
    Keep,
}

/// The reason for an action.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "code", rename_all = "kebab-case")]
pub enum StepReason {
    /// Recorded, with all outputs present.
    UpToDate,
    /// An input runs first.
    InputMayChange {
        /// The step that makes the input.
        step: String,
    },
    /// Its key contains the version of a program, which is not asked before the step may run.
    NotAsked {
        /// Name of the program.
        program: String,
    },
    /// Never made.
    NoRecord,
    /// An input has changed.
    InputChanged {
        /// Role of the input.
        name: String,
        /// Previous digest; empty if there was none.
        old: String,
        /// Present digest; empty if it is absent.
        new: String,
    },
    /// A parameter has changed.
    ParamChanged {
        /// Path in the description.
        name: String,
        /// Previous value; empty if there was none.
        old: String,
        /// Present value; empty if it is absent.
        new: String,
    },
    /// The revision of the stage has changed.
    Revision {
        /// Previous revision.
        old: String,
        /// Present revision.
        new: String,
    },
    /// The numerical class has changed.
    Class {
        /// Previous class.
        old: String,
        /// Present class.
        new: String,
    },
    /// Recorded, but an output is missing.
    BlobMissing {
        /// Its digest.
        digest: String,
    },
    /// Recorded, but an output was altered.
    BlobAltered {
        /// Its digest.
        digest: String,
    },
}

/// A step compared with the store.
#[derive(Debug, Clone)]
pub struct StepAssessment {
    /// The action.
    pub action: StepAction,
    /// The reason for the action.
    pub reason: StepReason,
    /// Its key; `None` while an input or the version of a program may change.
    pub key: Option<Key>,
    /// The description of the key, without inputs that are not known yet.
    pub description: DescribedValue,
    /// The files outside the store that it reads.
    pub sources: SourceFiles,
    /// Its outputs, if it is up to date.
    pub outputs: Option<Vec<StoredOutput>>,
}

impl StepAssessment {
    /// The difference from the last time the step was made, with `last` as the description on
    /// record. An input that is not known yet is not a difference.
    #[must_use]
    pub fn changes(&self, last: &[ExplanationLine]) -> Vec<DescriptionChange> {
        let mut changes = changed_lines(last, &self.description.lines());
        let is_unknown =
            |c: &DescriptionChange| c.path == "inputs" || c.path.starts_with("inputs.") && c.new.is_empty();
        // Without a key, an absent input is one that is not known yet, and no difference.
        changes.retain(|c| self.key.is_some() || !is_unknown(c));
        changes
    }
}

/// The reason why a plan cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// A source file does not exist.
    #[error("{scene}: the source does not exist: {}{}", path.display(), named_place(named_at.as_ref()))]
    Missing {
        /// Scene id.
        scene: String,
        /// Name of the step that reads it.
        step: String,
        /// The missing path.
        path: std::path::PathBuf,
        /// Its place in the recipe.
        named_at: Option<RecipePosition>,
    },
    /// A source cannot be listed or read.
    #[error("{scene}/{step}: failed to {cause}")]
    Source {
        /// Scene id.
        scene: String,
        /// Step name.
        step: String,
        /// Cause.
        cause: StageError,
    },
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
}

fn named_place(at: Option<&RecipePosition>) -> String {
    at.map(|at| format!(", named at {at}")).unwrap_or_default()
}
