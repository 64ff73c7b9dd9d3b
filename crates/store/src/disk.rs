//! File operations of the store, with errors that name the file, and with writes that are whole or
//! absent.

use super::blob::is_fresh_name;
use super::fs::{FolderEntry, Fs};
use super::{Digest, StoreError};
use gs2e_files::rename::parent_folder;
use gs2e_files::stat::FileStat;
use rustix::io::Errno;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) fn disk_error(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::Io { doing, path, source }
}

/// Returns true if a path does not exist: the file itself, or a folder on the way.
pub(super) fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

/// Refuses a link of this name.
fn refuse_link(path: &Path) -> Result<(), StoreError> {
    match std::fs::symlink_metadata(path) {
        Ok(about) if about.is_symlink() => Err(StoreError::Link { path: path.to_owned() }),
        Err(e) if !is_absent(&e) => Err(disk_error("reading", path)(e)),
        _ => Ok(()),
    }
}

/// Maximum number of attempts at an operation that is interrupted by signals.
const PATIENCE: usize = 100;

/// Retries an operation that a signal interrupted.
fn retry_interrupted<T>(mut operation: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    for _ in 1..PATIENCE {
        match operation() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
    // The last attempt reports its error, even if that is one more interruption.
    operation()
}

/// File operations with errors that name the file.
#[derive(Debug, Clone)]
pub(super) struct StoreDisk {
    root: PathBuf,
    fs: Arc<dyn Fs>,
    /// True if each file is synced before the next is written; false if a whole batch is synced at
    /// once.
    sync_each: bool,
}

impl StoreDisk {
    /// The operations on the store at `root`.
    pub(super) fn new(root: &Path, fs: Arc<dyn Fs>, sync_each: bool) -> Self {
        Self { root: root.to_owned(), fs, sync_each }
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// The same operations, with a sync after each.
    pub(super) fn syncing_each(&self) -> Self {
        Self { sync_each: true, ..self.clone() }
    }

    pub(super) fn stat(&self, path: &Path) -> io::Result<FileStat> {
        retry_interrupted(|| self.fs.stat(path))
    }

    pub(super) fn touch(&self, path: &Path) -> io::Result<()> {
        retry_interrupted(|| self.fs.touch(path))
    }

    pub(super) fn digest(&self, path: &Path) -> io::Result<Digest> {
        retry_interrupted(|| self.fs.digest(path))
    }

    /// Creates a folder and its parents.
    ///
    /// # Errors
    /// It cannot be created, or a link has its name: through that, files of others would be changed and
    /// deleted. The store itself may be a link.
    pub(super) fn create_dir(&self, path: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| self.fs.create_dir_all(path)).map_err(disk_error("creating", path))?;
        if path == self.root { Ok(()) } else { refuse_link(path) }
    }

    /// Refuses a store in which one of these names is a link.
    pub(super) fn refuse_links(&self, names: &[&str]) -> Result<(), StoreError> {
        names.iter().try_for_each(|name| refuse_link(&self.root.join(name)))
    }

    /// Removes the files and folders that dead processes left in a folder of the store: those with a name
    /// of [`fresh_name`](super::blob::fresh_name). Others stay.
    pub(super) fn remove_fresh(&self, folder: &str) -> Result<(), StoreError> {
        let entries = self.entries(&self.root.join(folder))?;
        let is_fresh = |entry: &&FolderEntry| entry.path.file_name().is_some_and(is_fresh_name);
        entries.iter().filter(is_fresh).try_for_each(|entry| self.remove(&entry.path))
    }

    /// Removes a file of the store, or a folder with its content. No link on the way is followed.
    pub(super) fn remove(&self, path: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| self.try_remove(path)).map_err(disk_error("removing", path))
    }

    fn try_remove(&self, path: &Path) -> io::Result<()> {
        match path.strip_prefix(&self.root) {
            Ok(below) => self.fs.remove(&self.root, below),
            // The index of a store on a network file system has a folder of its own.
            Err(_) => self.fs.remove(parent_folder(path), Path::new(path.file_name().unwrap_or_default())),
        }
    }

    /// The entries of a folder, sorted by path; empty if it is absent.
    pub(super) fn entries(&self, path: &Path) -> Result<Vec<FolderEntry>, StoreError> {
        match retry_interrupted(|| self.fs.list(path)) {
            Err(e) if is_absent(&e) => Ok(Vec::new()),
            entries => entries.map_err(disk_error("listing", path)),
        }
    }

    /// Writes a file under a temporary name and renames it, so that it is there whole or not at
    /// all.
    pub(super) fn write_atomically(
        &self,
        path: &Path,
        temporary: &Path,
        bytes: &[u8],
    ) -> Result<(), StoreError> {
        let write = || -> io::Result<()> {
            // The bytes are synced before the rename. Otherwise a power cut could leave an empty
            // file under the final name.
            retry_interrupted(|| self.fs.write(temporary, bytes))?;
            self.sync_now(temporary)?;
            retry_interrupted(|| self.fs.rename(temporary, path))?;
            // The name lies in the folder: until that is synced, a power cut could undo the rename.
            self.sync_folder_of(path)
        };
        write().map_err(|e| {
            // The error is reported by the caller. A remaining temporary file is removed when the
            // store is next opened.
            let _ = self.try_remove(temporary);
            disk_error("writing", path)(e)
        })
    }

    /// Copies a file to a name that is not in use.
    pub(super) fn copy(&self, from: &Path, to: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| {
            // A part of an interrupted copy cannot be written over: it is read-only.
            match self.try_remove(to) {
                Err(e) if !is_absent(&e) => return Err(e),
                _ => {}
            }
            self.fs.copy(from, to)
        })
        .map_err(disk_error("copying to", to))
    }

    /// Copies a file from a folder to which other people can write; see [`Fs::copy_foreign`].
    pub(super) fn copy_foreign(
        &self,
        from: &Path,
        to: &Path,
        size: u64,
    ) -> Result<Option<Digest>, StoreError> {
        retry_interrupted(|| {
            match self.try_remove(to) {
                Err(e) if !is_absent(&e) => return Err(e),
                _ => {}
            }
            self.fs.copy_foreign(from, to, size)
        })
        .map_err(disk_error("copying to", to))
    }

    /// Creates or replaces a file. After an error, it may have part of the bytes.
    pub(super) fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
        retry_interrupted(|| self.fs.write(path, bytes)).map_err(disk_error("writing", path))
    }

    /// Publishes a finished file under its final name; the first writer wins. Returns `false` if
    /// the name was taken.
    pub(super) fn link_new(&self, from: &Path, to: &Path) -> Result<bool, StoreError> {
        // Before the link: once the name is there, a reader and a power cut must both find all bytes.
        self.sync_now(from).map_err(disk_error("syncing", from))?;
        // A link fails if the name is taken; a rename would replace the file.
        match retry_interrupted(|| self.fs.link(from, to)) {
            Ok(()) => self.sync_folder_of(to).map(|()| true).map_err(disk_error("syncing", to)),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(false),
            // SFTP has no error for a name that is taken, and reports this one.
            Err(e) if e.raw_os_error() == Some(Errno::PERM.raw_os_error()) && self.stat(to).is_ok() => {
                Ok(false)
            }
            Err(e) => Err(disk_error("publishing", to)(e)),
        }
    }

    fn sync_now(&self, path: &Path) -> io::Result<()> {
        // Otherwise `Store::flush` syncs the whole batch before the database names any file of it.
        if self.sync_each { retry_interrupted(|| self.fs.sync(path)) } else { Ok(()) }
    }

    fn sync_folder_of(&self, path: &Path) -> io::Result<()> {
        path.parent().map_or(Ok(()), |folder| self.sync_now(folder))
    }

    /// Syncs everything written so far.
    pub(super) fn sync_all(&self, root: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| self.fs.sync_all(root)).map_err(disk_error("syncing", root))
    }

    pub(super) fn committed(&self, database: &Path) -> Result<(), StoreError> {
        self.fs.committed(database).map_err(disk_error("writing", database))
    }

    pub(super) fn make_read_only(&self, path: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| self.fs.protect(path)).map_err(disk_error("protecting", path))
    }

    pub(super) fn rename(&self, from: &Path, to: &Path) -> Result<(), StoreError> {
        retry_interrupted(|| self.fs.rename(from, to)).map_err(disk_error("renaming", from))
    }

    /// The files below a folder, as sorted relative names joined by `/`.
    pub(super) fn files_below(&self, root: &Path) -> Result<Vec<(String, PathBuf)>, StoreError> {
        let (mut files, mut folders) = (Vec::new(), vec![root.to_owned()]);
        while let Some(folder) = folders.pop() {
            for entry in
                retry_interrupted(|| self.fs.list(&folder)).map_err(disk_error("listing", &folder))?
            {
                if entry.is_dir {
                    folders.push(entry.path);
                } else {
                    let below = entry.path.strip_prefix(root).expect("the walk starts at the root");
                    let name: Vec<_> = below.iter().map(|part| part.to_string_lossy().into_owned()).collect();
                    files.push((name.join("/"), entry.path));
                }
            }
        }
        files.sort();
        Ok(files)
    }

    /// Reads a whole file; `None` if it is absent.
    pub(super) fn read_optional(&self, path: &Path) -> Result<Option<Vec<u8>>, StoreError> {
        match retry_interrupted(|| self.fs.read(path)) {
            Ok(bytes) => Ok(Some(bytes)),
            // Every other error is one of the disk, and must not pass for a miss.
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(disk_error("reading", path)(e)),
        }
    }
}
