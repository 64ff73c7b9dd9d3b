//! Why a program could not be asked.

use crate::programs::Failed;
use std::io;
use std::path::{Path, PathBuf};

/// Why a program could not be asked, or did not answer.
#[derive(Debug, thiserror::Error)]
pub enum ForeignError {
    /// It was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// The program failed.
    #[error(transparent)]
    Failed(#[from] Box<Failed>),
    /// A file that is handed over cannot be used.
    #[error("use {}: {cause}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Cause.
        cause: io::Error,
    },
    /// What was built cannot be read here.
    #[error("read {}: {cause}", path.display())]
    Own {
        /// Which file.
        path: PathBuf,
        /// Cause.
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl ForeignError {
    /// A file that cannot be used.
    pub(super) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |cause| Self::Io { path, cause }
    }

    /// A product of ours that cannot be read.
    pub(super) fn own<E: std::error::Error + Send + Sync + 'static>(path: &Path) -> impl FnOnce(E) -> Self {
        let path = path.to_owned();
        move |cause| Self::Own { path, cause: Box::new(cause) }
    }
}
