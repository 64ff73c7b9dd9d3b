//! File operations of the store behind one trait, so that tests can count, fail and record each of
//! them.
//!
//! The database does its own input and output; its commits are reported to [`Fs::committed`]. Steps
//! write into their workspace directly, and the store sees those files when it publishes them.

use super::Digest;
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_files::stat::FileStat;
use rustix::fs::{AtFlags, CWD, Timespec, Timestamps, UTIME_NOW};
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// An entry of a folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct FolderEntry {
    /// Path.
    pub path: PathBuf,
    /// True if it is a folder. Links are not followed.
    pub is_dir: bool,
}

/// The file operations of the store. Errors are those of the system.
#[expect(clippy::missing_errors_doc, reason = "each fails as the system call of its name does")]
pub trait Fs: fmt::Debug + Send + Sync {
    /// Creates a folder and its parents. An existing folder is not an error.
    fn create_dir_all(&self, path: &Path) -> io::Result<()>;

    /// Creates or replaces a file. After an error, it may have part of the bytes.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Copies a file and its permissions. After an error, the copy may have part of the bytes.
    fn copy(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::copy(from, to).map(drop)
    }

    /// Copies a regular file of `size` bytes to a new file, from a folder to which other people can write.
    /// Returns the digest of the bytes that were copied, or `None` if no such file is there. A link
    /// does not count.
    fn copy_foreign(&self, from: &Path, to: &Path, size: u64) -> io::Result<Option<Digest>> {
        Digest::of_copy(from, to, size)
    }

    /// Reads a file.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// BLAKE3 of a file's bytes.
    fn digest(&self, path: &Path) -> io::Result<Digest>;

    /// The stat fields of a path. Links are followed.
    fn stat(&self, path: &Path) -> io::Result<FileStat>;

    /// Sets the times of a file to now, by the clock of the file system. Those of a link are its own.
    fn touch(&self, path: &Path) -> io::Result<()> {
        // The time is left to the file system, since the clocks of machines differ.
        let now = Timespec { tv_sec: 0, tv_nsec: UTIME_NOW };
        let times = Timestamps { last_access: now, last_modification: now };
        Ok(rustix::fs::utimensat(CWD, path, &times, AtFlags::SYMLINK_NOFOLLOW)?)
    }

    /// The entries of a folder, sorted by path. A link to a folder is an error.
    fn list(&self, path: &Path) -> io::Result<Vec<FolderEntry>>;

    /// Removes write permission for all users.
    fn protect(&self, path: &Path) -> io::Result<()>;

    /// Creates a second name for a file. Fails if the name is taken.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Renames a file or folder. A file of the new name is replaced.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a file, or a folder with its content. `below` is relative to `root`, and its links are
    /// refused.
    fn remove(&self, root: &Path, below: &Path) -> io::Result<()>;

    /// Syncs one file, or the names in one folder.
    fn sync(&self, path: &Path) -> io::Result<()>;

    /// Syncs everything written to the file system of a folder.
    fn sync_all(&self, root: &Path) -> io::Result<()>;

    /// Called after each commit of the database.
    fn committed(&self, _database: &Path) -> io::Result<()> {
        Ok(())
    }
}

/// The file operations of the system.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemFs;

impl Fs for SystemFs {
    fn create_dir_all(&self, path: &Path) -> io::Result<()> {
        fs::create_dir_all(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        File::create(path)?.write_all(bytes)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        files::read(path, files::MAX_DOCUMENT)
    }

    fn digest(&self, path: &Path) -> io::Result<Digest> {
        Digest::of_file(path)
    }

    fn stat(&self, path: &Path) -> io::Result<FileStat> {
        Ok(FileStat::from(&fs::metadata(path)?))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<FolderEntry>> {
        // A link would lead to files of others.
        if !fs::symlink_metadata(path)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        let entries = fs::read_dir(path)?.map(|entry| {
            let entry = entry?;
            Ok(FolderEntry { path: entry.path(), is_dir: entry.file_type()?.is_dir() })
        });
        let mut entries = entries.collect::<io::Result<Vec<_>>>()?;
        entries.sort();
        Ok(entries)
    }

    fn protect(&self, path: &Path) -> io::Result<()> {
        fs::set_permissions(path, fs::Permissions::from_mode(0o444))
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::hard_link(from, to)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn remove(&self, root: &Path, below: &Path) -> io::Result<()> {
        files::remove_below(root, below, Removal::Tree)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        // A handle for reading is enough for `fsync`, and a folder has no other.
        File::open(path)?.sync_all()
    }

    fn sync_all(&self, root: &Path) -> io::Result<()> {
        // One call for all files: a sync of each would cost milliseconds.
        Ok(rustix::fs::syncfs(File::open(root)?)?)
    }
}
