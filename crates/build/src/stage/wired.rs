//! A stage with its inputs, its type erased, as the plan holds it.

use super::context::StageContext;
use super::error::StageError;
use super::target::StageInputs;
use super::{Stage, StageFacts, StepId};
use crate::artifact::ArtifactFiles;
use gs2e_store::description::{DescribedValue, describe_value};
use gs2e_store::{Digest, Key};
use std::collections::BTreeMap;

/// A stage with its inputs.
#[derive(Debug)]
pub struct WiredStage<S: Stage> {
    /// Parameters.
    pub stage: S,
    /// Sources of its inputs.
    pub inputs: S::Inputs,
}

/// A wired stage with its types erased.
pub trait AnyStep: std::fmt::Debug + Send + Sync {
    /// Name of the stage.
    fn stage(&self) -> &'static str;

    /// Role and step of each input.
    fn inputs(&self) -> Vec<(&'static str, StepId)>;

    /// The facts of the stage.
    fn facts(&self) -> &dyn StageFacts;

    /// The content of the key: the stage, its revision and class, its parameters, and the digests
    /// of its inputs by role.
    fn describe(&self, inputs: &[(String, Digest)]) -> DescribedValue;

    /// The name of its frames, by the files of its inputs, if they can be kept for other steps.
    fn kept_name(&self, inputs: &[ArtifactFiles]) -> Option<Digest>;

    /// Opens the inputs and does the work.
    ///
    /// # Errors
    /// An input cannot be opened, or the work fails.
    fn run(&self, inputs: &[ArtifactFiles], cx: &mut StageContext<'_>) -> Result<(), StageError>;
}

impl<S> AnyStep for WiredStage<S>
where
    S: Stage + std::fmt::Debug + Send + Sync,
    S::Inputs: std::fmt::Debug + Send + Sync,
{
    fn stage(&self) -> &'static str {
        S::NAME
    }

    fn inputs(&self) -> Vec<(&'static str, StepId)> {
        self.inputs.targets()
    }

    fn facts(&self) -> &dyn StageFacts {
        &self.stage
    }

    fn describe(&self, inputs: &[(String, Digest)]) -> DescribedValue {
        let inputs =
            inputs.iter().map(|(role, digest)| (role.clone(), DescribedValue::Digest(*digest))).collect();
        let mut fields = BTreeMap::from([
            ("stage".to_owned(), DescribedValue::Text(S::NAME.to_owned())),
            ("revision".to_owned(), DescribedValue::Unsigned(S::REVISION.into())),
            ("params".to_owned(), describe_value(&self.stage).with_implied(S::ADDED)),
            ("inputs".to_owned(), DescribedValue::Record(inputs)),
        ]);
        if let Some(class) = self.stage.class() {
            fields.insert("class".to_owned(), DescribedValue::Text(class));
        }
        DescribedValue::Record(fields)
    }

    fn kept_name(&self, inputs: &[ArtifactFiles]) -> Option<Digest> {
        // Only what the frames follow from: a step with another sensor finds the same frames.
        let shot = self.stage.kept_shot()?;
        let mut fields = BTreeMap::from([
            ("class".to_owned(), DescribedValue::Text(shot.backend.class())),
            ("shot".to_owned(), describe_value(shot)),
        ]);
        for (number, files) in inputs.iter().enumerate() {
            fields.insert(format!("input {number}"), DescribedValue::Digest(files.digest()));
        }
        Some(Key::of_description(&DescribedValue::Record(fields)).0)
    }

    fn run(&self, files: &[ArtifactFiles], cx: &mut StageContext<'_>) -> Result<(), StageError> {
        // The order of the files is that of `inputs`.
        let inputs = self.inputs.open(&mut files.iter())?;
        self.stage.run(inputs, cx)
    }
}
