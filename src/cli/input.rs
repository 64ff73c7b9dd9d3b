//! What is told where a file or a folder that the user named cannot be used.

use super::message::{MessageLevel, UserMessage};
use super::problem::{ExitKind, VerbError};
use crate::source::SourceError;
use std::io;
use std::path::Path;

/// It is not there: nothing ran.
pub(super) fn missing_file(what: &str, path: &Path) -> VerbError {
    VerbError::usage("input-missing", format!("the {what} {} is not there", path.display()))
}

/// It is there and cannot be read.
pub(super) fn unreadable_file(what: &str, error: &dyn std::error::Error) -> VerbError {
    let message =
        UserMessage::new(MessageLevel::Error, "input-unreadable", format!("failed to read the {what}"));
    VerbError::from_message(ExitKind::Failed, message.because(error.to_string()))
}

/// A source that is not there, is none, or cannot be read.
pub(super) fn no_source(what: &str, error: &SourceError, path: &Path) -> VerbError {
    match error {
        SourceError::Io { source, .. } if source.kind() == io::ErrorKind::NotFound => {
            missing_file(what, path)
        }
        SourceError::Absent { dir, because } => {
            let told = format!("the {what} is not known by its files");
            let message = UserMessage::new(MessageLevel::Error, "input-missing", told);
            VerbError::from_message(ExitKind::Usage, message.path(dir).because(because))
        }
        error => unreadable_file(what, error),
    }
}
