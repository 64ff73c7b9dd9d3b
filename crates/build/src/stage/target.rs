//! Inputs of stages: typed references to the outputs of other steps.

use super::StepId;
use crate::artifact::{Artifact, ArtifactError, ArtifactFiles};
use std::marker::PhantomData;

/// A typed reference to the product of a step: wiring the wrong kind does not compile.
#[derive(Debug)]
pub struct StepTarget<A> {
    /// The step.
    pub step: StepId,
    // A function type keeps the target `Send` and `Sync` for every artifact.
    kind: PhantomData<fn() -> A>,
}

impl<A> StepTarget<A> {
    /// The product of a step that makes `A`, as guaranteed by [`crate::plan::SceneWiring::add`].
    pub(crate) fn new(step: StepId) -> Self {
        Self { step, kind: PhantomData }
    }
}

// A derived implementation would require `A: Clone`.
impl<A> Clone for StepTarget<A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<A> Copy for StepTarget<A> {}

/// The inputs of a stage: nothing, targets, or optional targets.
pub trait StageInputs {
    /// The opened artifacts.
    type Opened;

    /// Role and step of each present input.
    fn targets(&self) -> Vec<(&'static str, StepId)>;

    /// Opens the inputs. `files` are those of [`StageInputs::targets`], in order.
    ///
    /// # Errors
    /// An artifact cannot be opened.
    fn open(&self, files: &mut dyn Iterator<Item = &ArtifactFiles>) -> Result<Self::Opened, ArtifactError>;
}

impl StageInputs for () {
    type Opened = ();

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        Vec::new()
    }

    fn open(&self, _: &mut dyn Iterator<Item = &ArtifactFiles>) -> Result<(), ArtifactError> {
        Ok(())
    }
}

impl<A: Artifact> StageInputs for StepTarget<A> {
    type Opened = A;

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        vec![(A::KIND, self.step)]
    }

    fn open(&self, files: &mut dyn Iterator<Item = &ArtifactFiles>) -> Result<A, ArtifactError> {
        A::open(files.next().expect("one set of files for each target"))
    }
}

impl<I: StageInputs> StageInputs for Option<I> {
    type Opened = Option<I::Opened>;

    fn targets(&self) -> Vec<(&'static str, StepId)> {
        self.as_ref().map(I::targets).unwrap_or_default()
    }

    fn open(&self, files: &mut dyn Iterator<Item = &ArtifactFiles>) -> Result<Self::Opened, ArtifactError> {
        // An absent input takes no files, because `targets` lists none for it.
        self.as_ref().map(|inputs| inputs.open(files)).transpose()
    }
}

macro_rules! tuple_inputs {
    ($($name:ident $index:tt),+) => {
        impl<$($name: StageInputs),+> StageInputs for ($($name,)+) {
            type Opened = ($($name::Opened,)+);

            fn targets(&self) -> Vec<(&'static str, StepId)> {
                [$(self.$index.targets()),+].concat()
            }

            fn open(&self, files: &mut dyn Iterator<Item = &ArtifactFiles>) -> Result<Self::Opened, ArtifactError> {
                Ok(($(self.$index.open(files)?,)+))
            }
        }
    };
}
tuple_inputs!(A 0, B 1);
tuple_inputs!(A 0, B 1, C 2);
tuple_inputs!(A 0, B 1, C 2, D 3);
