//! Failures of stages.

use crate::artifact::ArtifactError;
use gs2e_files::PathError;
use gs2e_files::programs::ProgramFailure;
use gs2e_sampling::exposure::ExposeError;
use gs2e_source::foreign::ForeignError;
use gs2e_source::foreign::photos::PoseError;
use gs2e_source::foreign::video::FrameError;
use gs2e_source::reconstruct::{LayoutError, TrainError};
use gs2e_train::TrainingError;
use std::path::{Path, PathBuf};

/// The reason why a step failed. The texts complete the phrase "failed to ".
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// The step was cancelled.
    #[error("finish: it was interrupted")]
    Cancelled,
    /// A source does not exist.
    #[error("find {}", path.display())]
    Missing {
        /// Its path.
        path: PathBuf,
    },
    /// An input cannot be opened.
    #[error(transparent)]
    Artifact(#[from] ArtifactError),
    /// The step would run programs without permission.
    #[error("run a program that the recipe names: not allowed")]
    Refused {
        /// The commands, one per line.
        programs: Vec<String>,
    },
    /// A program failed.
    #[error(transparent)]
    Program(Box<ProgramFailure>),
    /// The work failed.
    #[error("{doing}: {cause}")]
    Work {
        /// The operation.
        doing: String,
        /// The reason.
        #[source]
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A file cannot be read or written.
    #[error("use {0}")]
    Io(#[from] PathError),
}

impl From<ForeignError> for StageError {
    fn from(error: ForeignError) -> Self {
        match error {
            // Every kind of interruption becomes this one: the executor then reports an interrupted run, not
            // a failed step.
            ForeignError::Stopped => Self::Cancelled,
            ForeignError::Failed(failed) => Self::Program(failed),
            ForeignError::Io(error) => Self::Io(error),
            error @ ForeignError::Product { .. } => {
                Self::work_failed("compare it with other programs")(error)
            }
        }
    }
}

impl From<PoseError> for StageError {
    fn from(error: PoseError) -> Self {
        match error {
            PoseError::Program(error) => error.into(),
            error => Self::work_failed("find the poses of the photos")(error),
        }
    }
}

impl From<FrameError> for StageError {
    fn from(error: FrameError) -> Self {
        match error {
            FrameError::Program(error) => error.into(),
            error => Self::work_failed("take frames from the video")(error),
        }
    }
}

impl From<TrainError> for StageError {
    fn from(error: TrainError) -> Self {
        match error {
            TrainError::Stopped | TrainError::Layout(LayoutError::Stopped) => Self::Cancelled,
            TrainError::Failed(failed) => Self::Program(failed),
            TrainError::Io(error) => Self::Io(error),
            TrainError::Layout(error) => Self::work_failed("write the capture for the program")(error),
        }
    }
}

impl From<TrainingError> for StageError {
    fn from(error: TrainingError) -> Self {
        match error {
            TrainingError::Stopped => Self::Cancelled,
            error => Self::work_failed("train the scene")(error),
        }
    }
}

impl From<ExposeError> for StageError {
    fn from(error: ExposeError) -> Self {
        match error {
            ExposeError::Interrupted => Self::Cancelled,
            error @ ExposeError::Render(_) => Self::work_failed("render")(error),
        }
    }
}

impl StageError {
    /// A failure of the work, shown as `doing: cause`.
    pub(crate) fn work_failed<E>(doing: &str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let doing = doing.to_owned();
        move |e| Self::Work { doing, cause: Box::new(e) }
    }

    /// A failure to use a file.
    pub fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io(PathError::new(path, source))
    }
}
