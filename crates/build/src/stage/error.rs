//! Failures of stages.

use crate::artifact::ArtifactError;
use gs2e_files::programs::ProgramFailure;
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
    #[error("use {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
}

impl StageError {
    /// A failure of the work, shown as `doing: cause`.
    pub fn work_failed<E>(doing: &str) -> impl FnOnce(E) -> Self
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        let doing = doing.to_owned();
        move |e| Self::Work { doing, cause: Box::new(e) }
    }

    /// A failure to use a file.
    pub fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}
