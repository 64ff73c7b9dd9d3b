//! Stage `reconstruct`: obtains the Gaussians from a scene file, from the embedded scene, from a
//! training program, or by training.

mod builtin;
mod command;

pub use builtin::BuiltinStage;
pub use command::TrainingStage;

use super::capture::{CaptureStage, SolvingInputs};
use super::{
    OpenedInputs, SourceFile, Stage, StageContext, StageError, StageFacts, StepNeed, StepTarget,
    small_stage_memory,
};
use crate::artifact::{Artifact, ArtifactFiles, SCENE_TIME, write_json};
use gs2e_demo as procedural;
use gs2e_demo::{Fountain, StillLife};
use gs2e_files::is_there;
use gs2e_render::RenderChoice;
use gs2e_scene as scene;
use gs2e_scene::Gaussians;
use gs2e_scene::dynamic::SceneTime;
use gs2e_scene::dynamic::file::{frame_files, read_dynamic, scene_files};
use gs2e_source::reconstruct::TrainerCommand;
use gs2e_source::{Capture, model, reconstruct};
use gs2e_train::TrainingSettings;
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
        /// Its fountain.
        #[serde(skip_serializing_if = "Option::is_none")]
        fountain: Option<Fountain>,
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
    /// A scene that changes with time, whose files enter the key by their digests.
    Changing {
        /// Its time.
        time: SceneTime,
        /// The file, or the folder of the sequence.
        #[serde(skip)]
        path: PathBuf,
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
    pub(crate) fn procedural(still_life: &StillLife) -> Self {
        let StillLife { gaussians, seed, fountain, .. } = *still_life;
        Self::Procedural { gaussians, seed, fountain }
    }

    /// A scene file. A `.splat` file has no magic number, so its name is part of its identity.
    #[must_use]
    pub(crate) fn from_file(file: &Path) -> Self {
        let is_splat = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("splat"));
        Self::Given { form: is_splat.then_some("splat"), file: SceneLocation::At(file.to_owned()) }
    }

    /// A scene that changes with time.
    #[must_use]
    pub(crate) fn changing(path: &Path, time: SceneTime) -> Self {
        Self::Changing { time, path: path.to_owned() }
    }

    /// The newest scene of a 3DGS model folder.
    #[must_use]
    pub(crate) fn newest_of(model: &Path) -> Self {
        Self::Given { form: None, file: SceneLocation::NewestOf(model.to_owned()) }
    }

    /// The scene that is trained on the photos of a source.
    #[must_use]
    pub(crate) fn builtin(settings: TrainingSettings, source: CaptureStage) -> Self {
        Self::Builtin(Box::new(BuiltinStage::new(settings, source)))
    }

    /// Returns true if the scene is trained on the capture.
    #[must_use]
    pub(crate) fn is_trained(&self) -> bool {
        matches!(self, Self::Command(_) | Self::Builtin(_))
    }

    /// The scene that a program trains on the photos of a source.
    #[must_use]
    pub(crate) fn from_command(command: &TrainerCommand, source: CaptureStage, render: RenderChoice) -> Self {
        Self::Command(Box::new(TrainingStage::new(command, source, render)))
    }
}

impl StageFacts for ReconstructStage {
    fn sources(&self) -> Result<Vec<SourceFile>, StageError> {
        Ok(match self {
            Self::Procedural { .. } => Vec::new(),
            Self::Changing { path, time } => changing_sources(path, *time)?,
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
            Self::Changing { path, time } if time.is_sequence() => vec![path.clone()],
            Self::Given { .. } | Self::Changing { .. } | Self::Procedural { .. } => Vec::new(),
        }
    }

    fn need(&self, files: &[ArtifactFiles]) -> StepNeed {
        // A capture that cannot be opened needs little memory: the step fails when it runs, with a better
        // message.
        let capture = files.first().filter(|_| self.is_trained());
        match (self, capture.and_then(|files| Capture::open(files).ok())) {
            (Self::Builtin(training), Some(capture)) => training.need(&capture),
            // Trainings of programs use the GPU one after another.
            (_, Some(capture)) => {
                StepNeed { gpu: true, ..StepNeed::for_memory([reconstruct::photo_memory(&capture)]) }
            }
            (_, None) => StepNeed::for_memory([small_stage_memory(files)]),
        }
    }

    fn is_training(&self) -> bool {
        self.is_trained()
    }

    fn programs(&self) -> Vec<String> {
        match self {
            Self::Command(training) => training.programs(),
            Self::Given { .. } | Self::Changing { .. } | Self::Procedural { .. } | Self::Builtin(_) => {
                Vec::new()
            }
        }
    }
}

impl Stage for ReconstructStage {
    const NAME: &'static str = "reconstruct";
    const REVISION: u32 = 1;
    /// The capture, if the scene is trained on it, and the steps that found its poses.
    type Inputs = (Option<StepTarget<Capture>>, SolvingInputs);
    type Output = Gaussians;

    fn run(&self, inputs: OpenedInputs<Self>, cx: &mut StageContext<'_>) -> Result<(), StageError> {
        let (capture, solved) = inputs;
        let gaussians = match self {
            Self::Command(training) => {
                training.run(&capture.expect("a training is wired to the capture"), &solved, cx)?
            }
            Self::Builtin(training) => {
                training.run(&capture.expect("a training is wired to the capture"), &solved, cx)?
            }
            Self::Procedural { gaussians, seed, fountain } => {
                let (gaussians, seed, fountain) = (*gaussians, *seed, *fountain);
                procedural::still_life(&StillLife { gaussians, seed, fountain, ..StillLife::default() })
            }
            Self::Changing { path, time } => {
                read_dynamic(path, *time).map_err(StageError::work_failed("read the scene"))?
            }
            Self::Given { file, .. } => {
                // The newest scene may be another one by now. The run then ends with an error, because its
                // sources have moved.
                scene::read_file(&file.find()?).map_err(StageError::work_failed("read the scene"))?
            }
        };
        write_scene(&gaussians, cx.out)
    }
}

/// Writes a scene, and its change if it changes.
fn write_scene(gaussians: &Gaussians, folder: &Path) -> Result<(), StageError> {
    for (name, part) in scene_files(gaussians) {
        let out = folder.join(name);
        File::create(&out).and_then(|file| part.write(file)).map_err(StageError::io_error(&out))?;
    }
    let Some(dynamics) = gaussians.dynamics() else { return Ok(()) };
    let out = folder.join(SCENE_TIME);
    write_json(&out, &dynamics.record()).map_err(StageError::io_error(&out))
}

/// The files of a scene that changes with time.
fn changing_sources(path: &Path, time: SceneTime) -> Result<Vec<SourceFile>, StageError> {
    if !time.is_sequence() {
        return Ok(vec![SourceFile { name: "scene".into(), path: path.to_owned() }]);
    }
    if !is_there(path) {
        return Err(StageError::Missing { path: path.to_owned() });
    }
    let listed = frame_files(path).map_err(StageError::io_error(path))?;
    let named = |(number, path)| SourceFile { name: format!("frame {number}"), path };
    Ok(listed.into_iter().enumerate().map(named).collect())
}
