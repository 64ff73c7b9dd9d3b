//! A shared store in a folder.

use super::PLANS;
use super::medium::{MAX_RECORD, SharedBytes, SharedMedium};
use crate::blob::blob_name;
use crate::disk::{StoreDisk, disk_error, is_absent};
use crate::fs::Fs;
use crate::marker::{StoreFolder, StoreKind, examine};
use crate::record::StoredOutput;
use crate::{StoreError, TMP, TRASH};
use gs2e_files::is_no_file;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tempfile::TempDir;

/// Beginning of the names of folders of one process.
pub(super) const PROCESS_FOLDER: &str = "gs2e-";

/// A folder: `VERSION`, `cas/` and `ac/` as in a store, and folders for files that are being written, and
/// that are about to be deleted.
#[derive(Debug)]
pub(super) struct SharedFolder {
    pub(super) root: PathBuf,
    pub(super) disk: StoreDisk,
    /// A folder that no other process has: machines may have equal process ids. Only this user can write to
    /// it, so no link takes the place of a file there. `None` for a reader.
    pub(super) private: Option<TempDir>,
    next: AtomicU64,
}

impl SharedFolder {
    /// Opens a shared folder for reading.
    pub(super) fn open_for_reading(root: &Path, fs: Arc<dyn Fs>) -> Result<Self, StoreError> {
        // Each file is synced before others can see it, whatever the store of this machine does.
        let disk = StoreDisk::new(root, fs, true);
        examine(root, StoreKind::Shared)?;
        Ok(Self { root: root.to_owned(), disk, private: None, next: AtomicU64::new(0) })
    }

    /// Opens a shared folder, and creates it if it is absent.
    pub(super) fn open(root: &Path, fs: Arc<dyn Fs>) -> Result<Self, StoreError> {
        let mut shared = Self::open_for_reading(root, fs)?;
        if shared.disk.claim(StoreKind::Shared).map_err(not_permitted)? == StoreFolder::Unmarked {
            shared.disk.mark_earlier(StoreKind::Shared).map_err(not_permitted)?;
        }
        shared.disk.refuse_links(&[TRASH, PLANS])?;
        for folder in ["cas", "ac", TMP] {
            shared.disk.create_dir(&root.join(folder)).map_err(not_permitted)?;
        }
        let tmp = root.join(TMP);
        let private = tempfile::Builder::new().prefix(PROCESS_FOLDER).tempdir_in(&tmp);
        shared.private =
            Some(private.map_err(disk_error("creating a folder in", &tmp)).map_err(not_permitted)?);
        Ok(shared)
    }

    /// A file of this process, with the bytes.
    fn lay(&self, bytes: SharedBytes<'_>) -> Result<PathBuf, StoreError> {
        let fresh = self.fresh();
        match bytes {
            SharedBytes::File(from) => self.disk.copy(from, &fresh)?,
            SharedBytes::Memory(bytes) => self.disk.write(&fresh, bytes)?,
        }
        Ok(fresh)
    }

    pub(super) fn fresh(&self) -> PathBuf {
        let private = self.private.as_ref().expect("a reader writes nothing");
        private.path().join(self.next.fetch_add(1, Ordering::Relaxed).to_string())
    }

    /// Gives a finished file its name. Returns `false` if the name is taken.
    pub(super) fn link(&self, from: &Path, to: &Path) -> Result<bool, StoreError> {
        if let Some(folder) = to.parent() {
            self.disk.create_dir(folder)?;
        }
        let is_ours = self.disk.link_new(from, to)?;
        self.disk.remove(from)?;
        Ok(is_ours)
    }
}

impl SharedFolder {
    /// Moves what is no file out of the way of a file.
    fn clear(&self, path: &Path) -> Result<(), StoreError> {
        match std::fs::symlink_metadata(path) {
            Ok(about) if about.is_dir() => {
                let name = path.file_name().unwrap_or_default();
                self.disk.rename(path, &self.fresh_trash()?.join(name))
            }
            _ => Ok(()),
        }
    }
}

/// Returns true if a regular file of at most, or of exactly, this size is there. A link does not count.
fn is_file(path: &Path, has_size: impl Fn(u64) -> bool) -> Result<bool, StoreError> {
    match std::fs::symlink_metadata(path) {
        Ok(about) => Ok(about.is_file() && has_size(about.len())),
        Err(e) if is_absent(&e) => Ok(false),
        Err(e) => Err(disk_error("reading", path)(e)),
    }
}

impl SharedMedium for SharedFolder {
    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.root.join(name);
        if is_file(&path, |size| size <= MAX_RECORD)? { self.disk.read_optional(&path) } else { Ok(None) }
    }

    fn take(&self, blob: &StoredOutput, to: &Path) -> Result<bool, StoreError> {
        let from = self.root.join(blob_name(&blob.digest));
        Ok(self.disk.copy_foreign(&from, to, blob.size)? == Some(blob.digest))
    }

    fn publish(&self, bytes: SharedBytes<'_>, name: &str) -> Result<bool, StoreError> {
        self.link(&self.lay(bytes)?, &self.root.join(name))
    }

    fn replace(&self, bytes: SharedBytes<'_>, name: &str) -> Result<(), StoreError> {
        let path = self.root.join(name);
        self.clear(&path)?;
        self.disk.rename(&self.lay(bytes)?, &path)
    }

    fn is_sound(&self, blob: &StoredOutput) -> Result<bool, StoreError> {
        // Bytes without a record are rare, and may be those of a machine that lost its power.
        let path = self.root.join(blob_name(&blob.digest));
        if !is_file(&path, |size| size == blob.size)? {
            return Ok(false);
        }
        match self.disk.digest(&path) {
            Ok(found) => Ok(found == blob.digest),
            Err(e) if is_absent(&e) || is_no_file(&e) => Ok(false),
            Err(e) => Err(disk_error("reading", &path)(e)),
        }
    }

    fn is_gone(&self, name: &str) -> Result<bool, StoreError> {
        let path = self.root.join(name);
        match self.disk.stat(&path) {
            Ok(_) => Ok(false),
            Err(e) if is_absent(&e) => Ok(true),
            Err(e) => Err(disk_error("reading", &path)(e)),
        }
    }

    fn mark_used(&self, name: &str) -> Result<(), StoreError> {
        let path = self.root.join(name);
        match self.disk.touch(&path) {
            // A user outside the group may read only. The record then looks unused, which costs work if it is
            // collected, and nothing else.
            Err(e) if is_absent(&e) || is_refused(&e) => Ok(()),
            done => done.map_err(disk_error("touching", &path)),
        }
    }

    fn place(&self) -> String {
        self.root.display().to_string()
    }
}

/// Names the error of a user who may not write.
fn not_permitted(error: StoreError) -> StoreError {
    match error {
        StoreError::Io { path, source, .. } if is_refused(&source) => {
            StoreError::NotPermitted { path, source }
        }
        other => other,
    }
}

/// Returns true if the system refused an operation.
pub(super) fn is_refused(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
    matches!(error.kind(), PermissionDenied | ReadOnlyFilesystem)
}
