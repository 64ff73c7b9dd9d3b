//! The error of the system with the file or folder that it concerns.

use std::io;
use std::path::PathBuf;

/// A file or folder that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct PathError {
    /// The file or folder.
    pub path: PathBuf,
    /// The error, without the path.
    pub source: io::Error,
}

impl PathError {
    /// Adds the path to an error.
    pub fn new(path: impl Into<PathBuf>, source: io::Error) -> Self {
        Self { path: path.into(), source }
    }
}
