//! Stages: the kinds of steps. A stage holds its parameters, names its inputs, and calls the module
//! that does the work.
//!
//! The fields of a stage are its parameters: nothing else of a recipe can enter its key. Fields
//! that must not enter it (paths, a back end that the class already names) are skipped in the
//! serialisation. A stage contains no arithmetic.

pub mod blur;
pub mod capture;
pub mod checks;
mod context;
pub mod disparity;
mod error;
pub mod events;
pub mod fidelity;
pub mod foreign;
pub mod frames;
pub mod geometry;
pub mod imu;
pub mod mount;
mod near;
mod need;
pub mod objects;
pub mod pass;
pub mod poses;
pub mod reconstruct;
pub mod scene_checks;
pub mod segmentation;
pub mod sharp;
pub mod shot;
mod size;
mod target;
pub mod trajectory;
mod wired;

pub use need::StepNeed;
use need::{rendering_need, small_stage_memory};
pub use size::{ExpectedSize, PathLength};

pub use wired::{AnyStep, WiredStage};

pub use error::StageError;

use context::known_program;
pub use context::{StageContext, StepProgress};

pub use target::{StageInputs, StepTarget};

use crate::artifact::{Artifact, ArtifactFiles};
use gs2e_scene::camera;
use gs2e_scene::camera::{Camera, CameraChoice};
use gs2e_source::Capture;
use pass::PassRole;
use shot::ShotParameters;
use std::path::PathBuf;

/// Index of a step in its plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct StepId(pub usize);

/// A file outside the store that a stage reads.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    /// Name within the source; it enters the key.
    pub name: String,
    /// Path; it does not enter the key.
    pub path: PathBuf,
}

/// The properties of a stage that a plan needs, for all types of inputs and products.
pub trait StageFacts {
    /// The numerical class, for stages whose bytes depend on the machine that computes them.
    fn class(&self) -> Option<String> {
        None
    }

    /// The files outside the store that the stage reads, in a stable order.
    ///
    /// # Errors
    /// A source cannot be listed.
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        Ok(Vec::new())
    }

    /// The existing folders whose content decides which files [`StageFacts::sources`] returns.
    fn source_folders(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Resources needed, by the sizes of the inputs. `files` are those of the present inputs, in
    /// order.
    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        StepNeed::for_memory([small_stage_memory(files)])
    }

    /// The length of the path that the stage makes, if its parameters state it.
    fn path_length(&self) -> Option<PathLength> {
        None
    }

    /// The expected size of the product along a path, if the parameters state it.
    fn expected_size(&self, _: PathLength) -> Option<ExpectedSize> {
        None
    }

    /// The programs that the stage would run, one command per line, as typed in a shell.
    fn programs(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns true if the stage runs programs that need no permission, because no recipe names
    /// them. Their output is kept too.
    fn runs_known_programs(&self) -> bool {
        false
    }

    /// Returns true if the stage trains a scene, which may take hours.
    fn is_training(&self) -> bool {
        false
    }

    /// A program whose version the class lacks. The program was not asked, so the key is not known.
    fn unasked(&self) -> Option<&'static str> {
        None
    }

    /// The part of the stage in a pass over rendered poses, which several steps can share.
    fn role(&self) -> Option<PassRole<'_>> {
        None
    }

    /// Camera and rendering of frames that other parameters leave as they are, so that they can be kept.
    fn kept_shot(&self) -> Option<&ShotParameters> {
        None
    }
}

/// A stage: parameters, inputs, and the making of its product.
pub trait Stage: StageFacts + serde::Serialize {
    /// Its name.
    const NAME: &'static str;

    /// Revision. Raise it when the same parameters and inputs give other bytes.
    const REVISION: u32;

    /// Parameters that were added after the first revision: their place among the parameters, and
    /// the text of the value that they had implicitly until then. A parameter with this value stays
    /// out of the key, so adding one changes no key, and a later change of the default changes only
    /// the keys that rely on it. Entries never change.
    const ADDED: &'static [(&'static str, &'static str)] = &[];

    /// Inputs from other steps.
    type Inputs: StageInputs;

    /// The product.
    type Output: Artifact;

    /// Writes the product's files into `cx.out`.
    ///
    /// # Errors
    /// The work fails, or was cancelled.
    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError>;
}

/// The opened inputs of a stage.
pub type OpenedInputs<S> = <<S as Stage>::Inputs as StageInputs>::Opened;

/// The camera of a trajectory: the recipe's choice, otherwise the source's own, with a warning if
/// views disagree.
fn choose_camera(choice: Option<CameraChoice>, capture: &Capture, cx: &mut StageContext<'_>) -> Camera {
    let (own, warning) = capture.camera().unzip();
    cx.warnings.extend(warning.flatten().map(|w| w.to_string()));
    camera::choose_camera(choice, own.as_ref()).expect("recipes without views write a whole camera")
}
