//! Every file operation of the store behind one trait, so that each can be counted, failed and recorded.
//!
//! The database does its own input and output; what it commits is told to [`Fs::committed`]. Steps write into their
//! workspace by themselves: the store sees those files when it publishes them.

use super::Digest;
use crate::files;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// A file at a moment. Two equal values of one path mean that nobody wrote to it in between, but for the grain of
/// the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Stat {
    /// Device.
    pub dev: u64,
    /// Inode.
    pub ino: u64,
    /// Length in bytes.
    pub size: u64,
    /// Last change of the bytes, ns since the epoch.
    pub mtime_ns: i64,
    /// Last change of the bytes or of the inode, ns since the epoch; no program can set it.
    pub ctime_ns: i64,
}

impl From<&fs::Metadata> for Stat {
    fn from(m: &fs::Metadata) -> Self {
        let ns = |s: i64, n: i64| s.saturating_mul(1_000_000_000).saturating_add(n);
        Self {
            dev: m.dev(),
            ino: m.ino(),
            size: m.size(),
            mtime_ns: ns(m.mtime(), m.mtime_nsec()),
            ctime_ns: ns(m.ctime(), m.ctime_nsec()),
        }
    }
}

/// Something in a folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Entry {
    /// Where it is.
    pub path: PathBuf,
    /// Whether it is a folder; links are not followed.
    pub is_dir: bool,
}

/// The file operations of the store. Errors are the system's own.
#[expect(clippy::missing_errors_doc, reason = "each fails as the system call of its name does")]
pub trait Fs: fmt::Debug + Send + Sync {
    /// Makes a folder and those above it; one that is there is no error.
    fn create_dir_all(&self, path: &Path) -> io::Result<()>;

    /// Creates or replaces a file. After an error part of the bytes may be there.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// The bytes of a file.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// BLAKE3 of a file's bytes.
    fn digest(&self, path: &Path) -> io::Result<Digest>;

    /// The stat fields of what a path leads to, links followed.
    fn stat(&self, path: &Path) -> io::Result<Stat>;

    /// What is in a folder, sorted by path.
    fn list(&self, path: &Path) -> io::Result<Vec<Entry>>;

    /// Takes away everybody's right to write.
    fn protect(&self, path: &Path) -> io::Result<()>;

    /// A second name for a file; fails where the name is taken.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Another name for a file or folder; a file of that name is replaced.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a file, or a folder with all that is in it.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Has one file, or the names in one folder, on disk.
    fn sync(&self, path: &Path) -> io::Result<()>;

    /// Has everything that was written to the file system of a folder on disk.
    fn sync_all(&self, root: &Path) -> io::Result<()>;

    /// Told after each commit of the database.
    fn committed(&self, _database: &Path) -> io::Result<()> {
        Ok(())
    }
}

/// The system's files.
#[derive(Debug, Clone, Copy, Default)]
pub struct Real;

impl Fs for Real {
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

    fn stat(&self, path: &Path) -> io::Result<Stat> {
        Ok(Stat::from(&fs::metadata(path)?))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<Entry>> {
        let entries = fs::read_dir(path)?.map(|entry| {
            let entry = entry?;
            Ok(Entry { path: entry.path(), is_dir: entry.file_type()?.is_dir() })
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

    fn remove(&self, path: &Path) -> io::Result<()> {
        if fs::symlink_metadata(path)?.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        File::open(path)?.sync_all()
    }

    fn sync_all(&self, root: &Path) -> io::Result<()> {
        Ok(rustix::fs::syncfs(File::open(root)?)?)
    }
}
