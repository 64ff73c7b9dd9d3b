//! Stage `reconstruct`: obtains the Gaussians from a scene file, from the embedded scene, from a
//! training program, or by training.

mod builtin;
mod command;

pub use builtin::BuiltinStage;
pub use command::TrainingStage;

use super::capture::{CaptureStage, SolvedInputs, SolvingInputs};
use super::{SourceFile, Stage, StageContext, StageError, StepNeed, StepTarget, small_stage_memory};
use crate::artifact::{Artifact, ArtifactFiles};
use crate::files::is_there;
use crate::reconstruct::{self, TrainerCommand};
use crate::render::RenderChoice;
use crate::scene::ply::write_ply;
use crate::scene::procedural::{self, StillLife};
use crate::scene::{self, Gaussians};
use crate::source::{Capture, model};
use crate::training::TrainingSettings;
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Parameters: the origin of the Gaussians.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReconstructStage {
    /// The embedded scene, for any capture of it.
    Procedural {
        /// Number of Gaussians.
        gaussians: u32,
        /// Seed of the scene.
        seed: u64,
    },
    /// A scene file, whose content enters the key by its digest.
    Given {
        /// Its format, if only the file name states it.
        #[serde(skip_serializing_if = "Option::is_none")]
        form: Option<&'static str>,
        /// Its location.
        #[serde(skip)]
        file: SceneLocation,
    },
    /// A program that trains on the capture.
    Command(Box<TrainingStage>),
    /// Training on the capture.
    Builtin(Box<BuiltinStage>),
}

/// Location of a scene file.
#[derive(Debug)]
pub enum SceneLocation {
    /// This path.
    At(PathBuf),
    /// The newest scene of a 3DGS model folder.
    NewestOf(PathBuf),
}

impl SceneLocation {
    fn find(&self) -> Result<PathBuf, StageError> {
        match self {
            Self::At(file) => Ok(file.clone()),
            Self::NewestOf(model) if !is_there(model) => Err(StageError::Missing { path: model.clone() }),
            Self::NewestOf(model) => {
                model::newest_scene(model).map_err(StageError::work_failed("find the scene"))
            }
        }
    }
}

impl ReconstructStage {
    /// The Gaussians of an embedded scene.
    #[must_use]
    pub fn procedural(still_life: &StillLife) -> Self {
        let StillLife { gaussians, seed, .. } = *still_life;
        Self::Procedural { gaussians, seed }
    }

    /// A scene file. A `.splat` file has no magic number, so its name is part of its identity.
    #[must_use]
    pub fn from_file(file: &Path) -> Self {
        let is_splat = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat"));
        Self::Given { form: is_splat.then_some("splat"), file: SceneLocation::At(file.to_owned()) }
    }

    /// The newest scene of a 3DGS model folder.
    #[must_use]
    pub fn newest_of(model: &Path) -> Self {
        Self::Given { form: None, file: SceneLocation::NewestOf(model.to_owned()) }
    }

    /// The scene that is trained on the photos of a source.
    #[must_use]
    pub fn builtin(settings: TrainingSettings, source: CaptureStage) -> Self {
        Self::Builtin(Box::new(BuiltinStage::new(settings, source)))
    }

    /// Returns true if the scene is trained on the capture.
    #[must_use]
    pub fn is_trained(&self) -> bool {
        matches!(self, Self::Command(_) | Self::Builtin(_))
    }

    /// The scene that a program trains on the photos of a source.
    #[must_use]
    pub fn from_command(command: &TrainerCommand, source: CaptureStage, render: RenderChoice) -> Self {
        Self::Command(Box::new(TrainingStage::new(command, source, render)))
    }
}

impl Stage for ReconstructStage {
    const NAME: &'static str = "reconstruct";
    const REVISION: u32 = 1;
    /// The capture, if the scene is trained on it, and the steps that found its poses.
    type Inputs = (Option<StepTarget<Capture>>, SolvingInputs);
    type Output = Gaussians;

    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        Ok(match self {
            Self::Procedural { .. } => Vec::new(),
            Self::Given { file, .. } => vec![SourceFile { name: "scene".into(), path: file.find()? }],
            Self::Command(training) => training.sources()?,
            Self::Builtin(training) => training.sources()?,
        })
    }

    fn source_folders(&self) -> Vec<PathBuf> {
        match self {
            Self::Given { file: SceneLocation::NewestOf(path), .. } => model::scene_folders(path),
            Self::Command(training) => training.source_folders(),
            Self::Builtin(training) => training.source_folders(),
            Self::Given { .. } | Self::Procedural { .. } => Vec::new(),
        }
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        let capture = files.first().filter(|_| self.is_trained());
        match (self, capture.and_then(|files| Capture::open(files).ok())) {
            (Self::Builtin(training), Some(capture)) => training.need(&capture),
            // Trainings of programs use the GPU one after another.
            (_, Some(capture)) => {
                StepNeed { gpu: true, ..StepNeed::for_parts([reconstruct::photo_memory(&capture)]) }
            }
            (_, None) => StepNeed::for_parts([small_stage_memory(files)]),
        }
    }

    fn programs(&self) -> Vec<String> {
        match self {
            Self::Command(training) => training.programs(),
            Self::Given { .. } | Self::Procedural { .. } | Self::Builtin(_) => Vec::new(),
        }
    }

    fn run(
        &self,
        (capture, solved): (Option<Capture>, SolvedInputs),
        cx: &mut StageContext<'_>,
    ) -> Result<(), StageError> {
        let gaussians = match self {
            Self::Command(training) => {
                training.run(&capture.expect("a training is wired to the capture"), &solved, cx)?
            }
            Self::Builtin(training) => {
                training.run(&capture.expect("a training is wired to the capture"), &solved, cx)?
            }
            Self::Procedural { gaussians, seed } => {
                let still_life = StillLife { gaussians: *gaussians, seed: *seed, ..StillLife::default() };
                procedural::still_life(&still_life)
            }
            Self::Given { file, .. } => {
                scene::read_file(&file.find()?).map_err(StageError::work_failed("read the scene"))?
            }
        };
        let out = cx.out.join("scene.ply");
        File::create(&out).and_then(|file| write_ply(&gaussians, file)).map_err(StageError::io_error(&out))
    }
}
