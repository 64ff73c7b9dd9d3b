//! Blobs: files named by the BLAKE3 of their bytes, mode 0444, never changed in place.

use super::disk::{StoreDisk, disk_error};
use super::record::StoredOutput;
use super::{Digest, StoreError, TRASH};
use gs2e_files::is_no_file;
use std::ffi::OsStr;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// The folders of blobs, of files that are being written, and of altered blobs.
#[derive(Debug)]
pub struct BlobFolders {
    root: PathBuf,
    disk: StoreDisk,
    next: AtomicU64,
    /// Held while a taken name changes hands: between the check of its bytes and the move, no other
    /// thread may put the sound blob there.
    replacing: Mutex<()>,
}

/// A finished file in a workspace, with its digest.
pub(super) struct FinishedBlob {
    pub(super) output: StoredOutput,
    path: PathBuf,
}

/// The name of a blob below a store.
pub(super) fn blob_name(digest: &Digest) -> String {
    let name = digest.to_string();
    format!("cas/{}/{name}", &name[..2])
}

/// A name that no other process uses, for a thing that this one writes.
pub(super) fn fresh_name(what: impl Display) -> String {
    format!("{}.{what}", std::process::id())
}

/// Returns true for the names of [`fresh_name`]: a process id, and the number of a file or the name of a
/// record.
pub(super) fn is_fresh_name(name: &OsStr) -> bool {
    let is_number = |text: &str| text.parse::<u64>().is_ok();
    let is_record = |text: &str| text.strip_suffix(".json").is_some_and(|key| key.parse::<Digest>().is_ok());
    let parts = name.to_str().and_then(|name| name.split_once('.'));
    parts.is_some_and(|(process, what)| is_number(process) && (is_number(what) || is_record(what)))
}

impl BlobFolders {
    pub(super) fn new(root: &Path, disk: StoreDisk) -> Self {
        Self { root: root.to_owned(), disk, next: AtomicU64::new(0), replacing: Mutex::new(()) }
    }

    pub(super) fn path(&self, digest: &Digest) -> PathBuf {
        self.root.join(blob_name(digest))
    }

    /// A path in a folder of the store that is not in use.
    pub(super) fn fresh(&self, folder: &str) -> PathBuf {
        // Relaxed is enough: the number must be unique, and orders nothing else.
        self.root.join(folder).join(fresh_name(self.next.fetch_add(1, Ordering::Relaxed)))
    }

    /// Moves an altered blob into the trash. A sound one stays.
    pub(super) fn discard(&self, digest: &Digest) -> Result<(), StoreError> {
        let path = self.path(digest);
        let _alone = self.replacing.lock().expect("no holder panics");
        // The bytes are read again: another step may have replaced the blob since it was examined.
        match self.found(&path) {
            Ok(found) if found == Some(*digest) => Ok(()),
            Ok(_) => self.disk.rename(&path, &self.fresh(TRASH)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
            Err(e) => Err(disk_error("reading", &path)(e)),
        }
    }

    /// The digest of the file in a blob's place; `None` if it is not a regular file, as every blob
    /// is.
    fn found(&self, path: &Path) -> std::io::Result<Option<Digest>> {
        match self.disk.digest(path) {
            Err(e) if is_no_file(&e) => Ok(None),
            found => found.map(Some),
        }
    }

    /// Hashes every file of a workspace, after making it read-only.
    pub(super) fn finish(&self, workspace: &Path) -> Result<Vec<FinishedBlob>, StoreError> {
        let files = self.disk.files_below(workspace)?.into_iter();
        files.map(|(name, path)| self.hash(name, path)).collect()
    }

    fn hash(&self, name: String, path: PathBuf) -> Result<FinishedBlob, StoreError> {
        // The mode comes before the hash, so that nothing opens the file for writing in between.
        self.disk.make_read_only(&path)?;
        let digest = self.disk.digest(&path).map_err(disk_error("reading", &path))?;
        let size = self.disk.stat(&path).map_err(disk_error("reading", &path))?.size;
        Ok(FinishedBlob { output: StoredOutput { name, digest, size }, path })
    }

    /// A file in a workspace whose digest is known, after making it read-only.
    pub(super) fn known(&self, output: &StoredOutput, path: PathBuf) -> Result<FinishedBlob, StoreError> {
        self.disk.make_read_only(&path)?;
        Ok(FinishedBlob { output: output.clone(), path })
    }

    /// Publishes a finished file; the first writer wins. Returns true if this file became the blob.
    /// Its name in the workspace is removed at once: removing it later would change the blob's
    /// ctime, and the blob would be read again.
    pub(super) fn publish(&self, file: &FinishedBlob) -> Result<bool, StoreError> {
        let to = self.path(&file.output.digest);
        if let Some(folder) = to.parent() {
            self.disk.create_dir(folder)?;
        }
        // A link never replaces a file, so no lock is needed to be the first writer.
        if self.disk.link_new(&file.path, &to)? {
            return self.disk.remove(&file.path).map(|()| true);
        }
        // Another writer was first, or its bytes were altered since: only the bytes can decide.
        let _alone = self.replacing.lock().expect("no holder panics");
        let found = self.found(&to).map_err(disk_error("reading", &to))?;
        if found.is_none() {
            // A file does not take the place of a folder.
            self.disk.rename(&to, &self.fresh(TRASH))?;
        }
        let is_altered = found != Some(file.output.digest);
        if is_altered {
            // A rename replaces altered bytes in one step, so a reader never finds the name missing.
            self.disk.rename(&file.path, &to)?;
        }
        // A file with the same bytes as the blob stays in the workspace, and is removed with it.
        Ok(is_altered)
    }
}
