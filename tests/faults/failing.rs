//! File operations with injected faults: one fails, or all from a given one on.

use gs2e_files::stat::FileStat;
use gs2e_store::Digest;
use gs2e_store::fs::{FolderEntry, Fs, SystemFs};
use std::io;
use std::path::Path;
use std::sync::Mutex;

/// Kinds of operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Folder,
    Write,
    Copy,
    Read,
    Stat,
    List,
    Protect,
    Touch,
    Link,
    Rename,
    Remove,
    Sync,
}

/// Ways in which an operation can fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FailureMode {
    NoSpace,
    Io,
    Interrupted,
    /// Half of the bytes are written, then there is no space.
    Short,
    /// The folder refuses the name.
    Denied,
}

impl FailureMode {
    pub(crate) const ALL: [Self; 5] = [Self::NoSpace, Self::Io, Self::Interrupted, Self::Short, Self::Denied];

    /// Returns true if an operation of this kind can fail in this way.
    pub(crate) fn can_meet(self, kind: Kind) -> bool {
        match self {
            Self::Io | Self::Interrupted => true,
            Self::NoSpace => {
                matches!(
                    kind,
                    Kind::Folder | Kind::Write | Kind::Copy | Kind::Link | Kind::Rename | Kind::Sync
                )
            }
            Self::Short => matches!(kind, Kind::Write | Kind::Copy),
            Self::Denied => matches!(kind, Kind::Folder | Kind::Link | Kind::Rename),
        }
    }

    fn error(self) -> io::Error {
        match self {
            Self::NoSpace | Self::Short => rustix::io::Errno::NOSPC.into(),
            Self::Io => rustix::io::Errno::IO.into(),
            Self::Interrupted => rustix::io::Errno::INTR.into(),
            Self::Denied => rustix::io::Errno::ACCESS.into(),
        }
    }
}

/// The operation that fails.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Injection {
    /// The number of the operation.
    pub(crate) at: usize,
    pub(crate) how: FailureMode,
    /// True if every later operation that can fail in this way fails too.
    pub(crate) forever: bool,
}

#[derive(Debug, Default)]
struct Log {
    kinds: Vec<Kind>,
    hits: u64,
    /// Description of the first operation that failed.
    message: Option<String>,
}

/// The system's files, with injected faults.
#[derive(Debug)]
pub(crate) struct Failing {
    injection: Option<Injection>,
    log: Mutex<Log>,
}

impl Failing {
    pub(crate) fn new(injection: Injection) -> Self {
        Self { injection: Some(injection), log: Mutex::default() }
    }

    /// Counts operations and injects no fault.
    pub(crate) fn never() -> Self {
        Self { injection: None, log: Mutex::default() }
    }

    pub(crate) fn kinds(&self) -> Vec<Kind> {
        self.log.lock().unwrap().kinds.clone()
    }

    pub(crate) fn hits(&self) -> u64 {
        self.log.lock().unwrap().hits
    }

    pub(crate) fn message(&self) -> String {
        self.log.lock().unwrap().message.clone().unwrap_or_default()
    }

    /// Counts the operation. Returns its fault, if it has one.
    fn meets(&self, kind: Kind, path: &Path) -> Option<FailureMode> {
        let mut log = self.log.lock().unwrap();
        let number = log.kinds.len();
        log.kinds.push(kind);
        let Injection { at, how, forever, .. } = self.injection?;
        let is_now = number == at || forever && number > at;
        if !is_now || !how.can_meet(kind) {
            return None;
        }
        log.hits += 1;
        log.message.get_or_insert_with(|| format!("{kind:?} of {}", path.display()));
        Some(how)
    }

    fn pass<T>(&self, kind: Kind, path: &Path, operation: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
        self.meets(kind, path).map_or_else(operation, |how| Err(how.error()))
    }
}

impl Fs for Failing {
    fn create_dir_all(&self, path: &Path) -> io::Result<()> {
        self.pass(Kind::Folder, path, || SystemFs.create_dir_all(path))
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        match self.meets(Kind::Write, path) {
            None => SystemFs.write(path, bytes),
            Some(FailureMode::Short) => {
                SystemFs.write(path, &bytes[..bytes.len() / 2])?;
                Err(FailureMode::Short.error())
            }
            Some(how) => Err(how.error()),
        }
    }

    fn copy(&self, from: &Path, to: &Path) -> io::Result<()> {
        match self.meets(Kind::Copy, to) {
            None => SystemFs.copy(from, to),
            Some(FailureMode::Short) => {
                let bytes = SystemFs.read(from)?;
                SystemFs.write(to, &bytes[..bytes.len() / 2])?;
                Err(FailureMode::Short.error())
            }
            Some(how) => Err(how.error()),
        }
    }

    fn copy_foreign(&self, from: &Path, to: &Path, size: u64) -> io::Result<Option<Digest>> {
        match self.meets(Kind::Copy, to) {
            None => SystemFs.copy_foreign(from, to, size),
            Some(FailureMode::Short) => {
                let bytes = SystemFs.read(from)?;
                SystemFs.write(to, &bytes[..bytes.len() / 2])?;
                Err(FailureMode::Short.error())
            }
            Some(how) => Err(how.error()),
        }
    }

    fn touch(&self, path: &Path) -> io::Result<()> {
        self.pass(Kind::Touch, path, || SystemFs.touch(path))
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        self.pass(Kind::Read, path, || SystemFs.read(path))
    }

    fn digest(&self, path: &Path) -> io::Result<Digest> {
        self.pass(Kind::Read, path, || SystemFs.digest(path))
    }

    fn stat(&self, path: &Path) -> io::Result<FileStat> {
        self.pass(Kind::Stat, path, || SystemFs.stat(path))
    }

    fn list(&self, path: &Path) -> io::Result<Vec<FolderEntry>> {
        self.pass(Kind::List, path, || SystemFs.list(path))
    }

    fn protect(&self, path: &Path) -> io::Result<()> {
        self.pass(Kind::Protect, path, || SystemFs.protect(path))
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.pass(Kind::Link, to, || SystemFs.link(from, to))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.pass(Kind::Rename, to, || SystemFs.rename(from, to))
    }

    fn remove(&self, root: &Path, below: &Path) -> io::Result<()> {
        self.pass(Kind::Remove, &root.join(below), || SystemFs.remove(root, below))
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        self.pass(Kind::Sync, path, || SystemFs.sync(path))
    }

    fn sync_all(&self, root: &Path) -> io::Result<()> {
        // In memory there is nothing to sync, and on a disk this would write the data of other
        // processes.
        self.pass(Kind::Sync, root, || Ok(()))
    }
}
