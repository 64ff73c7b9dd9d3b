//! The files of a release that is not written yet.

use gs2e_tree::{ListedFiles, ReleaseFiles};
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Files of the store and of memory.
#[derive(Debug)]
pub(super) struct UnwrittenFiles<'a> {
    pub(super) files: ListedFiles,
    /// Reading fails from the moment at which it is true.
    pub(super) cancel: &'a AtomicBool,
}

impl ReleaseFiles for UnwrittenFiles<'_> {
    fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>> {
        if self.cancel.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::Interrupted.into());
        }
        self.files.read(path, limit)
    }

    fn place(&self, path: &str) -> io::Result<PathBuf> {
        self.files.place(path)
    }

    fn has(&self, path: &str) -> io::Result<bool> {
        self.files.has(path)
    }
}
