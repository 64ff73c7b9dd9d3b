//! Blobs: files named by the BLAKE3 of their bytes, mode 0444, never changed in place.

use super::record::Output;
use super::{Digest, StoreError, Workspace, disk};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// The folders `cas/`, `tmp/` and `trash/`.
#[derive(Debug)]
pub struct Blobs {
    root: PathBuf,
    next: AtomicU64,
}

impl Blobs {
    pub(super) fn new(root: &Path) -> Self {
        Self { root: root.to_owned(), next: AtomicU64::new(0) }
    }

    pub(super) fn path(&self, digest: &Digest) -> PathBuf {
        let name = digest.to_string();
        self.root.join("cas").join(&name[..2]).join(&name)
    }

    fn fresh(&self, folder: &str) -> PathBuf {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.root.join(folder).join(format!("{}.{number}", std::process::id()))
    }

    pub(super) fn workspace(&self) -> Result<Workspace, StoreError> {
        let path = self.fresh("tmp");
        disk::create_dir(&path)?;
        Ok(Workspace { path })
    }

    pub(super) fn discard(&self, digest: &Digest) -> Result<(), StoreError> {
        disk::rename(&self.path(digest), &self.fresh("trash"))
    }

    /// Publishes every file of a workspace.
    pub(super) fn take_all(&self, workspace: &Workspace) -> Result<Vec<Output>, StoreError> {
        disk::files_below(workspace.path())?.into_iter().map(|(name, path)| self.take(name, &path)).collect()
    }

    fn take(&self, name: String, path: &Path) -> Result<Output, StoreError> {
        disk::make_read_only(path)?;
        let digest = disk::digest(path).map_err(disk::failed("reading", path))?;
        let size = std::fs::metadata(path).map_err(disk::failed("reading", path))?.len();
        let to = self.path(&digest);
        if let Some(folder) = to.parent() {
            disk::create_dir(folder)?;
        }
        let published = disk::link_new(path, &to)?;
        // Somebody had it first, or its bytes were altered since: only the bytes can tell.
        if !published && disk::digest(&to).map_err(disk::failed("reading", &to))? != digest {
            disk::rename(path, &to)?;
        }
        Ok(Output { name, digest, size })
    }
}
