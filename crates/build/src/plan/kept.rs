//! Frames that steps of a plan keep in the store.

use super::Plan;
use super::assess::StepAssessment;
use crate::artifact::ArtifactFiles;
use gs2e_store::{Digest, Store};

/// The name of the frames of each step; `None` for a step that keeps none, or whose inputs are not made yet.
#[must_use]
pub fn kept_names(plan: &Plan, assessed: &[StepAssessment], store: &Store) -> Vec<Option<Digest>> {
    let files = |input: usize| Some(ArtifactFiles::from_outputs(assessed[input].outputs.as_deref()?, store));
    let name = |step: &super::PlannedStep| {
        let inputs: Option<Vec<_>> = step.step.inputs().iter().map(|(_, input)| files(input.0)).collect();
        step.step.kept_name(&inputs?)
    };
    plan.steps().iter().map(name).collect()
}
