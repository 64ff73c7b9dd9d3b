//! Errors of running a program.

use gs2e_files::PathError;
use gs2e_files::programs::ProgramFailure;
use std::io;
use std::path::{Path, PathBuf};

/// The reason why a program could not be run or gave no answer.
#[derive(Debug, thiserror::Error)]
pub enum ForeignError {
    /// The work was asked to stop.
    #[error("finish: it was interrupted")]
    Stopped,
    /// The program failed.
    #[error(transparent)]
    Failed(#[from] Box<ProgramFailure>),
    /// An input file cannot be used.
    #[error("use {0}")]
    Io(PathError),
    /// A built product cannot be read by this program.
    #[error("read {}: {cause}", path.display())]
    Product {
        /// The file.
        path: PathBuf,
        /// Cause.
        cause: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl ForeignError {
    /// Converts the error of a file operation.
    pub(super) fn io_error(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io(PathError::new(path, source))
    }

    /// Converts the error of reading a product of this program.
    pub(super) fn product_error<E: std::error::Error + Send + Sync + 'static>(
        path: &Path,
    ) -> impl FnOnce(E) -> Self {
        let path = path.to_owned();
        move |cause| Self::Product { path, cause: Box::new(cause) }
    }
}
