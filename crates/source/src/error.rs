//! The reasons why a source cannot be read, with the place.

use gs2e_files::PathError;
use std::fmt;
use std::path::{Path, PathBuf};

/// Error of reading a source.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// An operation on a file or folder failed.
    #[error(transparent)]
    Io(#[from] PathError),
    /// The source does not exist.
    #[error("{}: {because}", dir.display())]
    Absent {
        /// Folder.
        dir: PathBuf,
        /// Description of the search.
        because: String,
    },
    /// The content of a file cannot be used.
    #[error("{}: {place}: {because}", path.display())]
    Content {
        /// File.
        path: PathBuf,
        /// Place in the file.
        place: SourcePlace,
        /// The found and the wanted content.
        because: String,
    },
}

/// A place in a file of a source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourcePlace {
    /// In a binary file.
    Byte {
        /// The record, in words.
        record: String,
        /// Offset from the file's start.
        offset: usize,
    },
    /// Line of a text file, from 1.
    Line(usize),
    /// Field of a structured file.
    Field(String),
}

impl fmt::Display for SourcePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Byte { record, offset } => write!(f, "{record} at byte {offset}"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Field(field) => write!(f, "`{field}`"),
        }
    }
}

impl SourceError {
    pub(super) fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| PathError::new(path, source).into()
    }
}
