//! Files whose stat fields stay as they were: damage below the file system, as bit rot is.

use gs2e::store::Digest;
use gs2e::store::fs::{Entry, Fs, Real, Stat};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// The system's files, whose stat fields are answered as they were seen before, if they have the size they had.
#[derive(Debug)]
pub(crate) struct Frozen {
    then: BTreeMap<PathBuf, Stat>,
}

impl Frozen {
    pub(crate) fn new(then: BTreeMap<PathBuf, Stat>) -> Self {
        Self { then }
    }
}

impl Fs for Frozen {
    fn create_dir_all(&self, path: &Path) -> io::Result<()> {
        Real.create_dir_all(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        Real.write(path, bytes)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        Real.read(path)
    }

    fn digest(&self, path: &Path) -> io::Result<Digest> {
        Real.digest(path)
    }

    fn stat(&self, path: &Path) -> io::Result<Stat> {
        let now = Real.stat(path)?;
        Ok(self.then.get(path).filter(|then| then.size == now.size).copied().unwrap_or(now))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<Entry>> {
        Real.list(path)
    }

    fn protect(&self, path: &Path) -> io::Result<()> {
        Real.protect(path)
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        Real.link(from, to)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        Real.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        Real.remove(path)
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn sync_all(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
}
