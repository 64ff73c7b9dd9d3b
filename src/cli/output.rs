//! Files that a single step writes where the user asks: no file is replaced before all of them are
//! complete.
//!
//! A link is followed, and the file that it leads to is replaced. A replaced file keeps its mode. A
//! file without write permission is refused, as is anything but a regular file. `-` is stdout.

use super::VerbError;
use gs2e_files::rename::{PartialFile, link_target, parent_folder};
use gs2e_files::{self as files, write_by_rename};
use gs2e_store::space::is_full;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The path that means stdout.
const STDOUT: &str = "-";

/// Writes the content of an output.
type OutputFill<'a> = &'a dyn Fn(&mut dyn Write) -> io::Result<()>;

/// A file or stdout, with the function that writes its content.
pub(super) struct OutputFile<'a> {
    pub(super) path: &'a Path,
    pub(super) fill: OutputFill<'a>,
}

/// Returns true if a path means stdout.
fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == STDOUT
}

/// Refuses outputs that cannot be written, before anything is computed. `inputs` are the files that
/// are read. `json` is true if a result for programs goes to stdout.
pub(super) fn screen_outputs<'a>(
    paths: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
    json: bool,
) -> Result<(), VerbError> {
    let refuse = |what: String| Err(VerbError::usage("output-unwritable", what));
    // Compared by their targets: two paths may lead to one file through links.
    let inputs: BTreeSet<PathBuf> = inputs.into_iter().map(link_target).collect();
    let mut seen = BTreeSet::new();
    for path in paths {
        let display = path.display();
        if is_stdout(path) && json {
            return refuse("--json writes to stdout, and so does `-`".to_owned());
        }
        if !seen.insert(link_target(path)) {
            return refuse(format!("two outputs are written to {display}"));
        }
        if is_stdout(path) {
            continue;
        }
        if inputs.contains(&link_target(path)) {
            return refuse(format!("{display} is an input and would be overwritten"));
        }
        if path.is_dir() || path.file_name().is_none() {
            return refuse(format!("{display} is a folder, wanted a file"));
        }
        let place = link_target(path);
        if !parent_folder(&place).is_dir() {
            return refuse(format!("{display} is in a folder that does not exist"));
        }
        if let Err(because) = files::replaceable(&place) {
            return refuse(format!("{display} cannot be replaced: {because}"));
        }
    }
    Ok(())
}

/// Refuses an output in a folder whose files must stay as they are. `what` names the folder.
pub(super) fn refuse_inside(path: &Path, folder: &Path, what: &str) -> Result<(), VerbError> {
    if !resolved(path).starts_with(resolved(folder)) {
        return Ok(());
    }
    let what = format!("{} is in {what} {}, wanted a place outside of it", path.display(), folder.display());
    Err(VerbError::usage("output-unwritable", what))
}

/// An absolute path without links, as far as it exists.
fn resolved(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let found = whole.ancestors().find_map(|part| Some((part.canonicalize().ok()?, part)));
    let joined = found.and_then(|(there, part)| Some(there.join(whole.strip_prefix(part).ok()?)));
    joined.unwrap_or(whole)
}

/// Writes one output as [`write_outputs`] does.
pub(super) fn write_output(
    path: &Path,
    fill: impl Fn(&mut dyn Write) -> io::Result<()>,
) -> Result<(), VerbError> {
    write_outputs(&[OutputFile { path, fill: &fill }])
}

/// Writes the outputs that have a path, as [`write_outputs`] does.
pub(super) fn write_given(outputs: &[(Option<&Path>, OutputFill<'_>)]) -> Result<(), VerbError> {
    let given = outputs.iter().filter_map(|(path, fill)| Some(OutputFile { path: (*path)?, fill: *fill }));
    write_outputs(&given.collect::<Vec<_>>())
}

/// Writes all outputs. Each file is written under a temporary name in its folder, and gets its own
/// name when the last one is complete.
pub(super) fn write_outputs(outputs: &[OutputFile<'_>]) -> Result<(), VerbError> {
    let mut parts = Vec::new();
    // Files are written first: a printed output cannot be taken back if a file fails.
    for OutputFile { path, fill } in outputs.iter().filter(|o| !is_stdout(o.path)) {
        parts.push(PartialFile::write_part(path, fill).map_err(|e| unwritable_file(path, e))?);
    }
    for OutputFile { path, fill } in outputs.iter().filter(|o| is_stdout(o.path)) {
        match print_to(fill) {
            // A reader that closed the pipe has read all it wants.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => {}
            printed => printed.map_err(|e| unwritable_file(path, e))?,
        }
    }
    // Only now is a file replaced. After an error above, the parts are dropped, and remove themselves.
    parts.into_iter().try_for_each(|part| {
        let path = part.path().to_owned();
        part.finish().map_err(|e| unwritable_file(&path, e))
    })
}

/// The error for a file that could not be written.
#[expect(clippy::needless_pass_by_value, reason = "it is what is handled here")]
pub(super) fn unwritable_file(path: &Path, error: io::Error) -> VerbError {
    let code = if is_full(&error) { "disk-full" } else { "output-unwritable" };
    VerbError::failed(code, format!("failed to write {}: {error}", path.display()))
}

/// Writes a file whole or not at all.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_by_rename(path, |part| File::create_new(part)?.write_all(bytes))
}

/// The error for a file in a format that cannot hold its content, or that was not written.
pub(super) fn not_written(path: &Path, error: impl Display) -> VerbError {
    VerbError::failed("not-written", format!("{}: {error}", path.display()))
}

fn print_to(fill: OutputFill<'_>) -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    fill(&mut out)?;
    out.flush()
}
