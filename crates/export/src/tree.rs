//! The folder of an export: hidden next to its place until it is complete.

use super::{ExportError, ExportProgress, ExportSubject};
use gs2e_files as files;
use gs2e_files::rename::parent_folder;
use gs2e_files::{LinkRule, MAX_TEXT, Removal};
use rustix::fs::{CWD, Mode, OFlags, RenameFlags};
use rustix::io::Errno;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Permissions};
use std::io::{self, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

/// Number of events between two reports: a few milliseconds of work.
const REPORTED_AT_ONCE: u64 = 65_536;

/// Separates the target's name from the letters in the name of a hidden folder.
const INFIX: &str = ".gs2e-export-";
/// Number of those letters: about 95 bits.
const LETTERS: usize = 16;
/// The file that says what the folder is, and its text.
const ABOUT: &str = "about";
const MAGIC: &str = "export of gs2e, not complete\n";
/// The export, in the hidden folder.
const TREE: &str = "tree";

/// A folder that is being written. It is removed when it is dropped before [`ExportFolder::place`].
///
/// It is `tree/` in a hidden folder, which has a name that cannot be guessed and belongs to one process.
pub(super) struct ExportFolder<'a> {
    target: PathBuf,
    hidden: PathBuf,
    /// `tree/` in the hidden folder.
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
    pub(super) fn create(target: &Path, progress: &'a dyn ExportProgress) -> Result<Self, ExportError> {
        let exists = |because| ExportError::Exists { path: target.to_owned(), because };
        let Some(name) = target.file_name() else {
            return Err(exists("wanted the name of a new folder"));
        };
        if files::is_there(target) || target.is_symlink() {
            return Err(exists("it exists already; an export replaces nothing"));
        }
        let parent = parent_folder(target);
        std::fs::create_dir_all(parent).map_err(ExportError::unwritten(parent))?;
        let mut prefix = OsString::from(".");
        prefix.push(name);
        prefix.push(INFIX);
        if !clear_leftovers(parent, &prefix).map_err(ExportError::unwritten(parent))? {
            return Err(exists("another process exports to it"));
        }
        let made = tempfile::Builder::new()
            .prefix(&prefix)
            .rand_bytes(LETTERS)
            .permissions(Permissions::from_mode(0o700))
            .tempdir_in(parent);
        // `tempfile` would remove it without the order of `remove_hidden`, so this type takes that over.
        let hidden = made.map_err(ExportError::unwritten(parent))?.keep();
        let folder = hidden.join(TREE);
        let lock = begin(&hidden, &folder).map_err(|e| {
            // The first error is the one to report.
            let _ = remove_hidden(&hidden);
            ExportError::unwritten(&hidden)(e)
        })?;
        Ok(Self { target: target.to_owned(), hidden, folder, _lock: lock, files: 0, unreported: 0, progress })
    }

    /// The path of a file of the export, with its folders made. It counts as a file that is written.
    ///
    /// # Errors
    /// A folder cannot be made.
    pub(super) fn file(&mut self, name: &str) -> Result<PathBuf, ExportError> {
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
    pub(super) fn write_file(&mut self, name: &str, bytes: &[u8]) -> Result<(), ExportError> {
        let path = self.file(name)?;
        let write = || File::create_new(&path)?.write_all(bytes);
        write().map_err(ExportError::unwritten(&path))
    }

    /// Writes sharp frames as `FOLDER/NNNNNN.png`.
    ///
    /// # Errors
    /// A frame cannot be read or written, or the export is to stop.
    pub(super) fn write_frames(
        &mut self,
        folder: &str,
        subject: &ExportSubject,
        frames: &[usize],
    ) -> Result<(), ExportError> {
        for (index, pose) in frames.iter().enumerate() {
            self.write_file(&format!("{folder}/{index:06}.png"), &subject.sharp_file(*pose)?)?;
            self.report()?;
        }
        Ok(())
    }

    /// Gives a file of the export a second name. It is copied on file systems without hard links.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn repeat(&mut self, of: &str, name: &str) -> Result<(), ExportError> {
        let (of, path) = (self.folder.join(of), self.file(name)?);
        let linked = fs::hard_link(&of, &path).or_else(|_| fs::copy(&of, &path).map(|_| ()));
        linked.map_err(ExportError::unwritten(&path))
    }

    /// Number of files so far.
    #[must_use]
    pub(super) fn files(&self) -> usize {
        self.files
    }

    /// Counts an event that was written, and reports the count now and then.
    ///
    /// # Errors
    /// The export is to stop.
    pub(super) fn count_event(&mut self) -> Result<(), ExportError> {
        self.unreported += 1;
        if self.unreported < REPORTED_AT_ONCE { Ok(()) } else { self.report() }
    }

    /// Reports the events that were counted.
    ///
    /// # Errors
    /// The export is to stop.
    pub(super) fn report(&mut self) -> Result<(), ExportError> {
        self.progress.advance(std::mem::take(&mut self.unreported));
        if self.progress.is_cancelled() { Err(ExportError::Interrupted) } else { Ok(()) }
    }

    /// Moves the folder to its place.
    ///
    /// # Errors
    /// Something is there by now, or the folder cannot be moved.
    pub(super) fn place(self) -> Result<(), ExportError> {
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
        // The first error is the one to report. The next export to this place removes what stays.
        // The lock is a field, which is dropped after this, so no other export takes the folder for a remain.
        let _ = remove_hidden(&self.hidden);
    }
}

/// Writes what the hidden folder is, makes `tree`, and takes the lock, which ends with the process.
fn begin(hidden: &Path, tree: &Path) -> io::Result<File> {
    let lock = open_folder(hidden)?;
    // Before anything is in the folder: one without a lock counts as the remains of a killed process.
    lock.try_lock()?;
    File::create_new(hidden.join(ABOUT))?.write_all(MAGIC.as_bytes())?;
    fs::create_dir(tree)?;
    Ok(lock)
}

/// Opens a folder itself. A link would lead to a folder of others.
fn open_folder(folder: &Path) -> io::Result<File> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    Ok(File::from(rustix::fs::open(folder, flags, Mode::empty())?))
}

/// Removes the hidden folders that killed exports of one target left. Returns false if one of them belongs
/// to a process that still runs.
fn clear_leftovers(parent: &Path, prefix: &OsStr) -> io::Result<bool> {
    for entry in fs::read_dir(parent)? {
        let entry = entry?;
        if !is_hidden_name(&entry.file_name(), prefix) {
            continue;
        }
        // Something else that cannot be opened as a folder is not a hidden folder.
        let Ok(folder) = open_folder(&entry.path()) else { continue };
        if folder.try_lock().is_err() {
            return Ok(false);
        }
        if is_hidden_folder(&entry.path()) {
            remove_hidden(&entry.path())?;
        } else {
            // A process that was killed before it wrote `about` left an empty folder. Anything else stays.
            let _ = files::remove(&entry.path(), Removal::EmptyFolder);
        }
    }
    Ok(true)
}

fn is_hidden_name(name: &OsStr, prefix: &OsStr) -> bool {
    let letters = name.as_encoded_bytes().strip_prefix(prefix.as_encoded_bytes());
    letters.is_some_and(|letters| letters.len() == LETTERS && letters.iter().all(u8::is_ascii_alphanumeric))
}

/// Returns true if an export made this folder, and nothing was added to it.
fn is_hidden_folder(folder: &Path) -> bool {
    let about = files::read_with(&folder.join(ABOUT), LinkRule::Refuse, MAX_TEXT);
    let names = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.file_name());
    about.is_ok_and(|about| about == MAGIC.as_bytes())
        && names.into_iter().all(|name| name == ABOUT || name == TREE)
}

/// Removes a hidden folder. `about` goes last: without it the folder would not be recognised.
fn remove_hidden(hidden: &Path) -> io::Result<()> {
    let tree = hidden.join(TREE);
    if files::is_there(&tree) {
        files::remove(&tree, Removal::Tree)?;
    }
    if files::is_there(&hidden.join(ABOUT)) {
        files::remove(&hidden.join(ABOUT), Removal::File)?;
    }
    files::remove(hidden, Removal::EmptyFolder)
}
