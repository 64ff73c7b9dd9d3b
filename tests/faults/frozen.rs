//! Files whose stat fields stay unchanged: damage below the file system, such as bit rot.

use gs2e_files::stat::FileStat;
use gs2e_store::Digest;
use gs2e_store::fs::{FolderEntry, Fs, SystemFs};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// The system's files. A file that has kept its size is reported with its earlier stat fields.
#[derive(Debug)]
pub(crate) struct Frozen {
    then: BTreeMap<PathBuf, FileStat>,
}

impl Frozen {
    pub(crate) fn new(then: BTreeMap<PathBuf, FileStat>) -> Self {
        Self { then }
    }
}

impl Fs for Frozen {
    fn create_dir_all(&self, path: &Path) -> io::Result<()> {
        SystemFs.create_dir_all(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        SystemFs.write(path, bytes)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        SystemFs.read(path)
    }

    fn digest(&self, path: &Path) -> io::Result<Digest> {
        SystemFs.digest(path)
    }

    fn stat(&self, path: &Path) -> io::Result<FileStat> {
        let now = SystemFs.stat(path)?;
        Ok(self.then.get(path).filter(|then| then.size == now.size).copied().unwrap_or(now))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<FolderEntry>> {
        SystemFs.list(path)
    }

    fn protect(&self, path: &Path) -> io::Result<()> {
        SystemFs.protect(path)
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        SystemFs.link(from, to)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        SystemFs.rename(from, to)
    }

    fn remove(&self, root: &Path, below: &Path) -> io::Result<()> {
        SystemFs.remove(root, below)
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn sync_all(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
}
