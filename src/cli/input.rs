//! Errors about files and folders that the user named and that cannot be used.

use super::VerbError;
use gs2e_event::EventFileError;
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_source::SourceError;
use std::fmt::Display;
use std::io;
use std::path::Path;

/// The error for an absent file: nothing ran.
pub(super) fn missing_file(what: &str, path: &Path) -> VerbError {
    VerbError::usage("input-missing", format!("{what}: {} does not exist", path.display()))
}

/// The error for a file that exists and cannot be read.
pub(super) fn unreadable_file(what: &str, error: &dyn std::error::Error) -> VerbError {
    VerbError::failed("input-unreadable", format!("failed to read the {what}")).because(error)
}

/// The error for a file or folder that cannot be read.
pub(super) fn unreadable_path(path: &Path, error: impl Display) -> VerbError {
    VerbError::failed("input-unreadable", format!("{} cannot be read: {error}", path.display()))
}

/// The error for the content of a file.
pub(super) fn wrong_content(path: &Path, error: impl Display) -> VerbError {
    VerbError::failed("input-unreadable", format!("{}: {error}", path.display()))
}

/// The error for a file whose events cannot be read.
pub(super) fn wrong_events(path: &Path, error: &EventFileError) -> VerbError {
    wrong_content(path, format_args!("failed to read events: {error}"))
}

/// Refuses a path where no regular file lies, also if nothing would read it. `what` names its option.
pub(super) fn require_file(what: &str, path: &Path) -> Result<(), VerbError> {
    match files::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(missing_file(what, path)),
        Err(error) if files::is_no_file(&error) => {
            Err(VerbError::usage("input-missing", format!("{what}: {} is {error}", path.display())))
        }
        // Its reader has the words for a file without permission.
        _ => Ok(()),
    }
}

/// The error for a source that is absent, has no known layout, or cannot be read.
pub(super) fn no_source(what: &str, error: &SourceError, path: &Path) -> VerbError {
    match error {
        SourceError::Io(error) if error.source.kind() == io::ErrorKind::NotFound => missing_file(what, path),
        SourceError::Absent { dir, because } => {
            let text = format!("cannot determine the layout of the {what}");
            VerbError::usage("input-missing", text).path(dir).because(because)
        }
        error => unreadable_file(what, error),
    }
}

/// Reads `640x480`.
pub(super) fn parse_size(text: &str) -> Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let [width, height] = sides.ok_or_else(|| format!("{text} is not WIDTHxHEIGHT, such as 640x480"))?;
    let size = Size { width, height };
    if size.pixels() == 0 {
        return Err(format!("{text} is not a sensor size of 1 to 65536 columns and rows"));
    }
    size.check_sensor().map_err(|e| format!("a sensor of {e}"))?;
    Ok(size)
}
