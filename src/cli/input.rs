//! What is told where a file or a folder that the user named cannot be used.

use super::message::{Level, Message};
use super::problem::{Exit, Problem};
use crate::source::SourceError;
use std::io;
use std::path::Path;

/// It is not there: nothing ran.
pub(super) fn missing_file(what: &str, path: &Path) -> Problem {
    Problem::usage("input-missing", format!("the {what} {} is not there", path.display()))
}

/// It is there and cannot be read.
pub(super) fn unreadable_file(what: &str, error: &dyn std::error::Error) -> Problem {
    let message = Message::new(Level::Error, "input-unreadable", format!("failed to read the {what}"));
    Problem::from_message(Exit::Failed, message.because(error.to_string()))
}

/// A source that is not there, is none, or cannot be read.
pub(super) fn no_source(what: &str, error: &SourceError, path: &Path) -> Problem {
    match error {
        SourceError::Io { source, .. } if source.kind() == io::ErrorKind::NotFound => {
            missing_file(what, path)
        }
        SourceError::Absent { dir, because } => {
            let told = format!("the {what} is not known by its files");
            let message = Message::new(Level::Error, "input-missing", told);
            Problem::from_message(Exit::Usage, message.path(dir).because(because))
        }
        error => unreadable_file(what, error),
    }
}
