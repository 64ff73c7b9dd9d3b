//! The folder of an export: hidden next to its place until it is complete.

use super::{ExportError, ExportProgress};
use crate::files;
use crate::files::rename::parent_folder;
use rustix::fs::{CWD, Mode, OFlags, RenameFlags};
use rustix::io::Errno;
use std::fs::{self, File};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

/// Number of events between two reports: a few milliseconds of work.
const REPORTED_AT_ONCE: u64 = 65_536;

/// A folder that is being written. It is removed when it is dropped before [`ExportFolder::place`].
pub struct ExportFolder<'a> {
    target: PathBuf,
    folder: PathBuf,
    /// Holds the lock on the hidden folder.
    _lock: File,
    files: usize,
    /// Events that were counted since the last report.
    unreported: u64,
    progress: &'a dyn ExportProgress,
}

impl std::fmt::Debug for ExportFolder<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ExportFolder").field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl<'a> ExportFolder<'a> {
    /// Creates the hidden folder for `target`. The remains of a killed export of the same place are
    /// removed.
    ///
    /// # Errors
    /// Something exists at `target`, another process exports to it, or the folder cannot be made.
    pub fn create(target: &Path, progress: &'a dyn ExportProgress) -> Result<Self, ExportError> {
        let exists = |because| ExportError::Exists { path: target.to_owned(), because };
        let Some(name) = target.file_name() else {
            return Err(exists("wanted the name of a new folder"));
        };
        if files::is_there(target) || target.is_symlink() {
            return Err(exists("it exists already; an export replaces nothing"));
        }
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(".gs2e-export");
        let parent = parent_folder(target);
        if !parent.is_dir() {
            return Err(exists("it is in a folder that does not exist"));
        }
        let folder = parent.join(hidden);
        let failed = ExportError::unwritten;
        match fs::create_dir(&folder) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            made => made.map_err(failed(&folder))?,
        }
        // A link would lead to a folder of others, whose content would be removed.
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let lock = match rustix::fs::open(&folder, flags, Mode::empty()) {
            Ok(lock) => File::from(lock),
            Err(Errno::NOTDIR | Errno::LOOP) => {
                return Err(exists("its hidden folder is a file or a link; remove it"));
            }
            Err(e) => return Err(failed(&folder)(e.into())),
        };
        // The lock ends with the process, also with a killed one, so no remains of it block the place.
        if lock.try_lock().is_err() {
            return Err(exists("another process exports to it"));
        }
        for entry in fs::read_dir(&folder).map_err(failed(&folder))? {
            let path = entry.map_err(failed(&folder))?.path();
            let removed = if path.is_dir() && !path.is_symlink() {
                fs::remove_dir_all(&path)
            } else {
                fs::remove_file(&path)
            };
            removed.map_err(failed(&path))?;
        }
        Ok(Self { target: target.to_owned(), folder, _lock: lock, files: 0, unreported: 0, progress })
    }

    /// The path of a file of the export, with its folders made. It counts as a file that is written.
    ///
    /// # Errors
    /// A folder cannot be made.
    pub fn file(&mut self, name: &str) -> Result<PathBuf, ExportError> {
        let path = self.folder.join(name);
        let parent = parent_folder(&path);
        fs::create_dir_all(parent).map_err(ExportError::unwritten(parent))?;
        self.files += 1;
        Ok(path)
    }

    /// Writes a file.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_file(&mut self, name: &str, bytes: &[u8]) -> Result<(), ExportError> {
        let path = self.file(name)?;
        let write = || File::create_new(&path)?.write_all(bytes);
        write().map_err(ExportError::unwritten(&path))
    }

    /// Gives a file of the export a second name. It is copied on file systems without hard links.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn repeat(&mut self, of: &str, name: &str) -> Result<(), ExportError> {
        let (of, path) = (self.folder.join(of), self.file(name)?);
        let linked = fs::hard_link(&of, &path).or_else(|_| fs::copy(&of, &path).map(|_| ()));
        linked.map_err(ExportError::unwritten(&path))
    }

    /// Number of files so far.
    #[must_use]
    pub fn files(&self) -> usize {
        self.files
    }

    /// Counts an event that was written, and reports the count now and then.
    ///
    /// # Errors
    /// The export is to stop.
    pub fn count_event(&mut self) -> Result<(), ExportError> {
        self.unreported += 1;
        if self.unreported < REPORTED_AT_ONCE { Ok(()) } else { self.report() }
    }

    /// Reports the events that were counted.
    ///
    /// # Errors
    /// The export is to stop.
    pub fn report(&mut self) -> Result<(), ExportError> {
        self.progress.advance(std::mem::take(&mut self.unreported));
        if self.progress.is_cancelled() { Err(ExportError::Interrupted) } else { Ok(()) }
    }

    /// Moves the folder to its place.
    ///
    /// # Errors
    /// Something is there by now, or the folder cannot be moved.
    pub fn place(self) -> Result<(), ExportError> {
        let moved = rustix::fs::renameat_with(CWD, &self.folder, CWD, &self.target, RenameFlags::NOREPLACE);
        let moved = match moved {
            // File systems without this flag: a plain rename replaces an empty folder at most.
            Err(Errno::INVAL | Errno::NOSYS) => fs::rename(&self.folder, &self.target),
            moved => moved.map_err(Into::into),
        };
        moved.map_err(ExportError::unwritten(&self.target))
    }
}

impl Drop for ExportFolder<'_> {
    fn drop(&mut self) {
        // A placed folder has another name by now. The first error is the one to report.
        let _ = fs::remove_dir_all(&self.folder);
    }
}
