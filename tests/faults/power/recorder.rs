//! File operations that are carried out and recorded.

use gs2e_files::stat::FileStat;
use gs2e_store::Digest;
use gs2e_store::fs::{FolderEntry, Fs, SystemFs};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{fs, io};

/// The files of the database, by name.
pub(super) type Database = Vec<(&'static str, Vec<u8>)>;

/// An operation that changes what the disk holds; paths are relative to the store.
#[derive(Debug, Clone)]
pub(super) enum DiskOperation {
    Folder(PathBuf),
    /// A file's bytes, under a new name or in place of its old content.
    Write(PathBuf, Vec<u8>),
    /// A second name, with the bytes: steps write their files by themselves.
    Link(PathBuf, Vec<u8>),
    /// A new name, with the bytes if it is a file's.
    Rename(PathBuf, PathBuf, Option<Vec<u8>>),
    Remove(PathBuf),
    Sync(PathBuf),
    SyncAll,
    Commit(Database),
}

/// The system's files, recorded.
#[derive(Debug)]
pub(super) struct Recorder {
    root: PathBuf,
    ops: Mutex<Vec<DiskOperation>>,
    /// The stat fields that the engine last saw of each file.
    stats: Mutex<BTreeMap<PathBuf, FileStat>>,
}

impl Recorder {
    /// Records operations below the store at `root`.
    pub(super) fn new(root: PathBuf) -> Self {
        Self { root, ops: Mutex::default(), stats: Mutex::default() }
    }

    pub(super) fn len(&self) -> usize {
        self.ops.lock().unwrap().len()
    }

    pub(super) fn ops(&self) -> Vec<DiskOperation> {
        self.ops.lock().unwrap().clone()
    }

    pub(super) fn stats(&self) -> BTreeMap<PathBuf, FileStat> {
        self.stats.lock().unwrap().clone()
    }

    fn below(&self, path: &Path) -> PathBuf {
        path.strip_prefix(&self.root).unwrap().to_owned()
    }

    fn note(&self, op: DiskOperation) {
        self.ops.lock().unwrap().push(op);
    }
}

impl Fs for Recorder {
    fn create_dir_all(&self, path: &Path) -> io::Result<()> {
        self.note(DiskOperation::Folder(self.below(path)));
        SystemFs.create_dir_all(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.note(DiskOperation::Write(self.below(path), bytes.to_vec()));
        SystemFs.write(path, bytes)
    }

    fn copy(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.note(DiskOperation::Write(self.below(to), fs::read(from)?));
        SystemFs.copy(from, to)
    }

    fn copy_foreign(&self, from: &Path, to: &Path, size: u64) -> io::Result<Option<Digest>> {
        self.note(DiskOperation::Write(self.below(to), fs::read(from)?));
        SystemFs.copy_foreign(from, to, size)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        SystemFs.read(path)
    }

    fn digest(&self, path: &Path) -> io::Result<Digest> {
        SystemFs.digest(path)
    }

    fn stat(&self, path: &Path) -> io::Result<FileStat> {
        let stat = SystemFs.stat(path)?;
        if path.starts_with(&self.root) {
            self.stats.lock().unwrap().insert(path.to_owned(), stat);
        }
        Ok(stat)
    }

    fn list(&self, path: &Path) -> io::Result<Vec<FolderEntry>> {
        SystemFs.list(path)
    }

    fn protect(&self, path: &Path) -> io::Result<()> {
        SystemFs.protect(path)
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        let bytes = fs::read(from)?;
        SystemFs.link(from, to)?;
        self.note(DiskOperation::Link(self.below(to), bytes));
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let bytes = fs::read(from).ok();
        SystemFs.rename(from, to)?;
        self.note(DiskOperation::Rename(self.below(from), self.below(to), bytes));
        Ok(())
    }

    fn remove(&self, root: &Path, below: &Path) -> io::Result<()> {
        SystemFs.remove(root, below)?;
        self.note(DiskOperation::Remove(self.below(&root.join(below))));
        Ok(())
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        self.note(DiskOperation::Sync(self.below(path)));
        Ok(())
    }

    fn sync_all(&self, _: &Path) -> io::Result<()> {
        self.note(DiskOperation::SyncAll);
        Ok(())
    }

    fn committed(&self, database: &Path) -> io::Result<()> {
        let mut files = Database::new();
        for suffix in SUFFIXES {
            let mut path = database.to_owned().into_os_string();
            path.push(suffix);
            if let Ok(bytes) = fs::read(PathBuf::from(path)) {
                files.push((suffix, bytes));
            }
        }
        self.note(DiskOperation::Commit(files));
        Ok(())
    }
}

/// Suffixes of the database and of its log. The log's index is never trusted after a crash.
const SUFFIXES: [&str; 2] = ["", "-wal"];
