//! Reasons why there is no export.

use super::ledger::{ExportLoss, UnmetNeed};
use gs2e_files::PathError;
use gs2e_tree::TreeError;
use std::io;
use std::path::{Path, PathBuf};

/// The reason why an export cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The folder is not a readable release, or a file of it is damaged.
    #[error("{0}")]
    Source(String),
    /// A scene, trajectory, sensor or interval that the release does not have.
    #[error("{0}")]
    Selection(String),
    /// The loader requires something that the release lacks.
    #[error("the release does not meet the needs of {format}")]
    Unmet {
        /// Name of the format.
        format: &'static str,
        /// The needs, each with its remedy.
        unmet: Vec<UnmetNeed>,
    },
    /// The layout holds some properties approximately only.
    #[error("{format} cannot hold all of the release exactly")]
    Lossy {
        /// Name of the format.
        format: &'static str,
        /// All losses.
        losses: Vec<ExportLoss>,
    },
    /// Something exists at the output path.
    #[error("{}: {because}", path.display())]
    Exists {
        /// The output path.
        path: PathBuf,
        /// What was found.
        because: &'static str,
    },
    /// The data do not fit the loader.
    #[error("{0}")]
    Data(String),
    /// The export was interrupted.
    #[error("interrupted: nothing was written")]
    Interrupted,
    /// A file cannot be written.
    #[error("failed to write {0}")]
    Write(#[source] PathError),
}

impl From<TreeError> for ExportError {
    fn from(error: TreeError) -> Self {
        Self::Source(error.to_string())
    }
}

impl ExportError {
    /// A file that cannot be written.
    pub(super) fn unwritten(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write(PathError::new(path, source))
    }
}
