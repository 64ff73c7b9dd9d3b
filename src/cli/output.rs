//! What a single step writes where the user says: every file whole, or none of them and everything as it was.

use super::problem::Problem;
use crate::store::space::is_full;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The name that stands for stdout.
const STDOUT: &str = "-";

/// A file, or stdout, and what fills it.
pub(super) struct Output<'a> {
    pub(super) path: &'a Path,
    pub(super) fill: &'a dyn Fn(&mut dyn Write) -> io::Result<()>,
}

/// Whether a path stands for stdout.
fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == STDOUT
}

/// Refuses, before anything is worked out, what cannot be written to. `inputs` are read; `json`: stdout has its result
/// already.
pub(super) fn screen<'a>(
    paths: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path>,
    json: bool,
) -> Result<(), Problem> {
    let refuse = |what: String| Err(Problem::usage("output-unwritable", what));
    let inputs: BTreeSet<PathBuf> = inputs.into_iter().map(target).collect();
    let mut seen = BTreeSet::new();
    for path in paths {
        let shown = path.display();
        if is_stdout(path) && json {
            return refuse("--json writes to stdout, and so does `-`".to_owned());
        }
        if !seen.insert(target(path)) {
            return refuse(format!("two outputs are written to {shown}"));
        }
        if is_stdout(path) {
            continue;
        }
        if inputs.contains(&target(path)) {
            return refuse(format!("{shown} is read, and would be written over"));
        }
        if path.is_dir() || path.file_name().is_none() {
            return refuse(format!("{shown} is a folder, wanted a file"));
        }
        if !folder(path).is_dir() {
            return refuse(format!("{shown} lies in a folder that is not there"));
        }
    }
    Ok(())
}

/// Writes all outputs: files under temporary names beside their own, which they take when the last is finished.
pub(super) fn write(outputs: &[Output<'_>]) -> Result<(), Problem> {
    let mut parts = Vec::new();
    for (number, Output { path, fill }) in outputs.iter().enumerate().filter(|(_, o)| !is_stdout(o.path)) {
        parts.push(Part::write(path, number, fill).map_err(|e| unwritable(path, e))?);
    }
    for Output { path, fill } in outputs.iter().filter(|o| is_stdout(o.path)) {
        match print(fill) {
            // A reader that closed the pipe has read all it wants.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => {}
            printed => printed.map_err(|e| unwritable(path, e))?,
        }
    }
    parts.into_iter().try_for_each(|part| {
        let path = part.path.clone();
        part.finish().map_err(|e| unwritable(&path, e))
    })
}

/// What is told of a file that could not be written.
#[expect(clippy::needless_pass_by_value, reason = "it is what is handled here")]
pub(super) fn unwritable(path: &Path, error: io::Error) -> Problem {
    let code = if is_full(&error) { "disk-full" } else { "output-unwritable" };
    Problem::failed(code, format!("failed to write {}: {error}", path.display()))
}

fn print(fill: &dyn Fn(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    fill(&mut out)?;
    out.flush()
}

/// Writes a file whole or not at all: beside its place, then into it.
pub(super) fn write_beside<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let finish = || {
        File::open(&beside)?.sync_all()?;
        fs::rename(&beside, path)
    };
    let written = fill(&beside).and_then(|()| finish().map_err(E::from));
    if written.is_err() {
        // The first error is the one to tell.
        let _ = fs::remove_file(&beside);
    }
    written
}

/// The file that a path leads to, links followed, where it is there.
fn target(path: &Path) -> PathBuf {
    let in_folder = || Some(folder(path).canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

/// The folder that a file lies in, by a path that the system takes.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file that is written and does not have its name yet; without it, it is removed.
struct Part {
    /// Where it is; `None` where it was written in place, or has its name.
    temporary: Option<PathBuf>,
    path: PathBuf,
}

impl Part {
    fn write(
        path: &Path,
        number: usize,
        fill: &dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<Self> {
        let path = target(path);
        // A pipe or a device keeps its name.
        if fs::metadata(&path).is_ok_and(|about| !about.is_file()) {
            let mut out = BufWriter::new(File::options().write(true).open(&path)?);
            fill(&mut out)?;
            out.flush()?;
            return Ok(Self { temporary: None, path });
        }
        let temporary = folder(&path).join(format!(".gs2e-{}-{number}.part", std::process::id()));
        let file = File::create(&temporary)?;
        let part = Self { temporary: Some(temporary), path };
        let mut out = BufWriter::new(file);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        Ok(part)
    }

    fn finish(mut self) -> io::Result<()> {
        if let Some(temporary) = &self.temporary {
            fs::rename(temporary, &self.path)?;
        }
        self.temporary = None;
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // What failed was told already.
            let _ = fs::remove_file(temporary);
        }
    }
}
