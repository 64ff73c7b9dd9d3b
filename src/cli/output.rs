//! Files that a single step writes where the user asks: no file is replaced before all of them are
//! complete.
//!
//! A link is followed, and the file that it leads to is replaced. A replaced file keeps its mode. A
//! file without write permission is refused, as is anything but a regular file. `-` is stdout.

use super::problem::VerbError;
use crate::files;
use crate::store::space::is_full;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

/// The path that means stdout.
const STDOUT: &str = "-";

/// A file or stdout, with the function that writes its content.
pub(super) struct OutputFile<'a> {
    pub(super) path: &'a Path,
    pub(super) fill: &'a dyn Fn(&mut dyn Write) -> io::Result<()>,
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
        let shown = path.display();
        if is_stdout(path) && json {
            return refuse("--json writes to stdout, and so does `-`".to_owned());
        }
        if !seen.insert(link_target(path)) {
            return refuse(format!("two outputs are written to {shown}"));
        }
        if is_stdout(path) {
            continue;
        }
        if inputs.contains(&link_target(path)) {
            return refuse(format!("{shown} is an input and would be overwritten"));
        }
        if path.is_dir() || path.file_name().is_none() {
            return refuse(format!("{shown} is a folder, wanted a file"));
        }
        let place = link_target(path);
        if !parent_folder(&place).is_dir() {
            return refuse(format!("{shown} is in a folder that does not exist"));
        }
        if let Err(because) = files::replaceable(&place) {
            return refuse(format!("{shown} cannot be replaced: {because}"));
        }
    }
    Ok(())
}

/// Writes all outputs. Each file is written under a temporary name in its folder, and gets its own
/// name when the last one is complete.
pub(super) fn write_outputs(outputs: &[OutputFile<'_>]) -> Result<(), VerbError> {
    let mut parts = Vec::new();
    // Files are written first: a printed output cannot be taken back if a file fails.
    for (number, OutputFile { path, fill }) in outputs.iter().enumerate().filter(|(_, o)| !is_stdout(o.path))
    {
        parts.push(PartialFile::write_part(path, number, fill).map_err(|e| unwritable_file(path, e))?);
    }
    for OutputFile { path, fill } in outputs.iter().filter(|o| is_stdout(o.path)) {
        match print_to(fill) {
            // A reader that closed the pipe has read all it wants.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => {}
            printed => printed.map_err(|e| unwritable_file(path, e))?,
        }
    }
    parts.into_iter().try_for_each(|part| {
        let path = part.path.clone();
        part.finish().map_err(|e| unwritable_file(&path, e))
    })
}

/// The error for a file that could not be written.
#[expect(clippy::needless_pass_by_value, reason = "it is what is handled here")]
pub(super) fn unwritable_file(path: &Path, error: io::Error) -> VerbError {
    let code = if is_full(&error) { "disk-full" } else { "output-unwritable" };
    VerbError::failed(code, format!("failed to write {}: {error}", path.display()))
}

fn print_to(fill: &dyn Fn(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    fill(&mut out)?;
    out.flush()
}

/// Writes a file whole or not at all: under a temporary name in its folder, then under its own.
pub(super) fn write_beside<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let part = PartialFile::new(path, 0)?;
    fill(&part.temporary)?;
    // Without the sync, a power cut could leave an empty file under the final name.
    files::open(&part.temporary)?.sync_all()?;
    Ok(part.finish()?)
}

/// Maximum number of links followed to a target. Linux follows no more.
const MAX_LINKS: usize = 40;

/// The target of a path with all links followed, even if nothing is there yet.
fn link_target(path: &Path) -> PathBuf {
    let mut place = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(to) = fs::read_link(&place) else { break };
        place = parent_folder(&place).join(to);
    }
    // Without the file, its folder can still be resolved.
    let in_folder = || Some(parent_folder(&place).canonicalize().ok()?.join(place.file_name()?));
    place.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| place.clone())
}

/// The folder of a file, as a path that the system accepts. The parent of a bare name is the empty
/// path, which the system does not accept.
fn parent_folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file that is being written under a temporary name. It is removed when it is dropped
/// unfinished.
struct PartialFile {
    temporary: PathBuf,
    path: PathBuf,
}

impl PartialFile {
    /// Prepares a part without content.
    fn new(path: &Path, number: usize) -> io::Result<Self> {
        let path = link_target(path);
        files::replaceable(&path)?;
        // In the same folder, because a rename does not cross file systems. The number separates
        // the outputs of one process.
        let temporary = parent_folder(&path).join(format!(".gs2e-{}-{number}.part", std::process::id()));
        // An earlier process with this id may have been killed.
        let _ = fs::remove_file(&temporary);
        Ok(Self { temporary, path })
    }

    fn write_part(
        path: &Path,
        number: usize,
        fill: &dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<Self> {
        let part = Self::new(path, number)?;
        let mut out = BufWriter::new(File::create_new(&part.temporary)?);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        Ok(part)
    }

    fn finish(self) -> io::Result<()> {
        // Another file may have been created there while this one was written.
        if let Some(mode) = files::replaceable(&self.path)? {
            fs::set_permissions(&self.temporary, fs::Permissions::from_mode(mode))?;
        }
        fs::rename(&self.temporary, &self.path)
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        // The first error is the one to report, and a finished file has another name by now.
        let _ = fs::remove_file(&self.temporary);
    }
}
