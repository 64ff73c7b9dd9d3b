//! A stage with its inputs, its type erased, as the plan holds it.

use super::context::StageContext;
use super::error::StageError;
use super::pass::PassRole;
use super::target::StageInputs;
use super::{ExpectedSize, PathLength, SourceFile, Stage, StepId, StepNeed};
use crate::artifact::ArtifactFiles;
use gs2e_store::description::{DescribedValue, describe_value};
use gs2e_store::{Digest, Key};
use std::collections::BTreeMap;
use std::path::PathBuf;

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

    /// The numerical class, for stages whose bytes depend on the machine that computes them.
    fn class(&self) -> Option<String>;

    /// Files outside the store that the stage reads.
    ///
    /// # Errors
    /// A source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError>;

    /// Folders whose content decides which files those are.
    fn source_folders(&self) -> Vec<PathBuf>;

    /// The content of the key: the stage, its revision and class, its parameters, and the digests
    /// of its inputs by role.
    fn describe(&self, inputs: &[(String, Digest)]) -> DescribedValue;

    /// Resources needed, by the sizes of the inputs.
    fn need(&self, inputs: &[ArtifactFiles]) -> StepNeed;

    /// The length of the path that the stage makes, if its parameters state it.
    fn path_length(&self) -> Option<PathLength>;

    /// The expected size of the product along a path, if the parameters state it.
    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize>;

    /// The programs that the stage would run, one command per line.
    fn programs(&self) -> Vec<String>;

    /// Returns true if the stage runs programs that need no permission.
    fn runs_known_programs(&self) -> bool;

    /// See [`Stage::is_training`].
    fn is_training(&self) -> bool;

    /// A program that must be asked for its version before the key is known.
    fn unasked(&self) -> Option<&'static str>;

    /// The part of the stage in a pass over rendered poses.
    fn role(&self) -> Option<PassRole<'_>>;

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

    fn class(&self) -> Option<String> {
        self.stage.class()
    }

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        self.stage.sources()
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        self.stage.source_folders()
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

    fn need(&self, inputs: &[ArtifactFiles]) -> StepNeed {
        self.stage.need(inputs)
    }

    fn path_length(&self) -> Option<PathLength> {
        self.stage.path_length()
    }

    fn expected_size(&self, path: PathLength) -> Option<ExpectedSize> {
        self.stage.expected_size(path)
    }

    fn programs(&self) -> Vec<String> {
        self.stage.programs()
    }

    fn runs_known_programs(&self) -> bool {
        self.stage.runs_known_programs()
    }

    fn is_training(&self) -> bool {
        self.stage.is_training()
    }

    fn unasked(&self) -> Option<&'static str> {
        self.stage.unasked()
    }

    fn role(&self) -> Option<PassRole<'_>> {
        self.stage.role()
    }

    fn kept_name(&self, inputs: &[ArtifactFiles]) -> Option<Digest> {
        let shot = self.stage.kept_shot()?;
        let mut fields = BTreeMap::from([
            ("class".to_owned(), DescribedValue::Text(shot.backend.class())),
            ("shot".to_owned(), describe_value(&shot)),
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
