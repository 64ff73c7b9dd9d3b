//! A folder that the stores of several machines share: `VERSION`, `cas/` and `ac/` as in a store, and
//! `tmp/`.
//!
//! Files appear whole, by a link to a finished one, and never change: the first writer wins. There is no
//! lock, no counter and no database, because those fail on network file systems. A folder that is seen
//! late by a cache of the file system costs a copy, and nothing else. Nobody trusts the bytes: whoever
//! takes a file compares it with its name.

mod gc;

pub use gc::{SharedSweep, SharedSwept, sweep_shared};

use super::blob::BlobFolders;
use super::disk::{StoreDisk, disk_error, is_absent};
use super::fs::SystemFs;
use super::record::{RecordSummary, StepRecord, StoredOutput};
use super::{Digest, FORMAT, Key, Store, StoreError};
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use tempfile::TempDir;

/// A shared folder, open for reading and writing.
#[derive(Debug)]
pub(super) struct SharedStore {
    root: PathBuf,
    disk: StoreDisk,
    blobs: BlobFolders,
    /// A folder below `tmp/` that no other process has: machines may have equal process ids. `None` for a
    /// reader.
    own: Option<TempDir>,
    next: AtomicU64,
    /// Files that are lost, or have other bytes than their name says. Sound ones take their place.
    damaged: Mutex<BTreeSet<Digest>>,
}

/// Different outputs of one key, in the shared folder and on this machine.
#[derive(Debug)]
pub struct SharedMismatch {
    /// The shared folder.
    pub shared: PathBuf,
    /// The record that was there first.
    pub first: StepRecord,
    /// The record of this machine.
    pub own: StepRecord,
}

impl fmt::Display for SharedMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let differs = |own: &&StoredOutput| !self.first.outputs.contains(own);
        let file = self.own.outputs.iter().find(differs).map_or("the list of files", |own| own.name.as_str());
        write!(
            f,
            "{} has other outputs of key {} than this machine: {file} differs",
            self.shared.display(),
            self.own.key
        )
    }
}

impl SharedStore {
    /// Opens a shared folder for reading.
    pub(super) fn open_for_reading(root: &Path) -> Result<Self, StoreError> {
        // Each file is synced before others can see it, whatever the own store does.
        let disk = StoreDisk::new(Arc::new(SystemFs), true);
        disk.check_format(root, FORMAT, false)?;
        if crate::files::is_there(&root.join("lock")) {
            return Err(StoreError::NotShared { path: root.to_owned() });
        }
        let (next, damaged) = (AtomicU64::new(0), Mutex::default());
        let blobs = BlobFolders::new(root, disk.clone());
        Ok(Self { root: root.to_owned(), blobs, disk, own: None, next, damaged })
    }

    /// Opens a shared folder, and creates it if it is absent.
    pub(super) fn open(root: &Path) -> Result<Self, StoreError> {
        let mut shared = Self::open_for_reading(root)?;
        for folder in ["cas", "ac", "tmp"] {
            shared.disk.create_dir(&root.join(folder)).map_err(not_permitted)?;
        }
        let tmp = root.join("tmp");
        let own = tempfile::Builder::new().prefix("gs2e-").tempdir_in(&tmp);
        shared.own = Some(own.map_err(disk_error("creating a folder in", &tmp)).map_err(not_permitted)?);
        let version = root.join("VERSION");
        if !crate::files::is_there(&version) {
            // Another process may do the same at this moment.
            let own = shared.fresh();
            shared.disk.write(&own, format!("{FORMAT}\n").as_bytes())?;
            shared.publish(&own, &version)?;
        }
        Ok(shared)
    }

    fn fresh(&self) -> PathBuf {
        let own = self.own.as_ref().expect("a reader writes nothing");
        own.path().join(self.next.fetch_add(1, Ordering::Relaxed).to_string())
    }

    fn damaged(&self) -> std::sync::MutexGuard<'_, BTreeSet<Digest>> {
        self.damaged.lock().expect("no holder panics")
    }

    fn record(&self, key: &Key) -> Result<Option<StepRecord>, StoreError> {
        let record = StepRecord::read(&self.root, &self.disk, key)?;
        // A name that leads out of a folder was not written by this program.
        Ok(record.filter(|record| record.outputs.iter().all(|output| stays_inside(&output.name))))
    }

    /// Copies an output to a new file. Returns `false` if it is not there.
    fn take(&self, output: &StoredOutput, to: &Path) -> Result<bool, StoreError> {
        let from = self.blobs.path(&output.digest);
        match self.disk.stat(&from) {
            Ok(_) => self.disk.copy(&from, to).map(|()| true),
            Err(e) if is_absent(&e) => Ok(false),
            Err(e) => Err(disk_error("reading", &from)(e)),
        }
    }

    /// Publishes a record and its outputs, whose files are at `path_of`.
    fn offer(&self, record: &StepRecord, path_of: &dyn Fn(&Digest) -> PathBuf) -> Result<Offer, StoreError> {
        self.mark_used(&record.key)?;
        if let Some(first) = self.record(&record.key)? {
            let is_damaged = |output: &&StoredOutput| self.damaged().contains(&output.digest);
            let damaged: Vec<&StoredOutput> = record.outputs.iter().filter(is_damaged).collect();
            let was_sound = damaged.is_empty();
            damaged.into_iter().try_for_each(|output| self.put(output, &path_of(&output.digest)))?;
            return Ok(if was_sound { Offer::Known(first) } else { Offer::Repaired(first) });
        }
        record.outputs.iter().try_for_each(|output| self.put(output, &path_of(&output.digest)))?;
        // After the files, so that no record names bytes that are not there.
        let (from, to) = (self.fresh(), StepRecord::record_path(&self.root, &record.key));
        self.disk.write(&from, &record.to_bytes())?;
        if !self.publish(&from, &to)? {
            // Another machine was faster, or a damaged record has the name.
            if let Some(first) = self.record(&record.key)? {
                return Ok(Offer::Known(first));
            }
            self.disk.write(&from, &record.to_bytes())?;
            self.disk.rename(&from, &to)?;
        }
        // A file that was there before may have been unused for long, and a collection that did not see the
        // record may have moved it away.
        for output in &record.outputs {
            let stored = self.blobs.path(&output.digest);
            if self.disk.stat(&stored).is_err_and(|e| is_absent(&e)) {
                self.put(output, &path_of(&output.digest))?;
            }
        }
        Ok(Offer::New)
    }

    /// Sets the time of the last use of a record, by the clock of the file system. A collection keeps what
    /// was used lately.
    fn mark_used(&self, key: &Key) -> Result<(), StoreError> {
        let path = StepRecord::record_path(&self.root, key);
        match self.disk.touch(&path) {
            // A user outside the group may read only. The record then looks unused, which costs work if it is
            // collected, and nothing else.
            Err(e) if is_absent(&e) || is_refused(&e) => Ok(()),
            done => done.map_err(disk_error("touching", &path)),
        }
    }

    fn put(&self, output: &StoredOutput, own: &Path) -> Result<(), StoreError> {
        let to = self.blobs.path(&output.digest);
        // Bytes without a record are rare, and may be those of a machine that lost its power.
        let is_sound = || self.disk.digest(&to).is_ok_and(|found| found == output.digest);
        let from = self.fresh();
        if !is_sound() {
            self.disk.copy(own, &from)?;
            if !self.publish(&from, &to)? && !is_sound() {
                self.disk.copy(own, &from)?;
                self.disk.rename(&from, &to)?;
            }
        }
        self.damaged().remove(&output.digest);
        Ok(())
    }

    /// Gives a finished file its name, if nobody else has. Returns `false` if the name is taken.
    fn publish(&self, from: &Path, to: &Path) -> Result<bool, StoreError> {
        if let Some(folder) = to.parent() {
            self.disk.create_dir(folder)?;
        }
        let is_ours = self.disk.link_new(from, to)?;
        self.disk.remove(from)?;
        Ok(is_ours)
    }
}

/// Result of an offer to the shared folder.
#[derive(Debug)]
enum Offer {
    /// The folder had no record of this key.
    New,
    /// It had a record whose files were damaged, and has sound files now.
    Repaired(StepRecord),
    /// It had this record.
    Known(StepRecord),
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
fn is_refused(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
    matches!(error.kind(), PermissionDenied | ReadOnlyFilesystem)
}

/// Returns true for a name of a file below a folder.
fn stays_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

impl Store {
    /// Takes the outputs of a key from the shared folder. `None` if there is no such folder, or it lacks
    /// them, or they are damaged there.
    ///
    /// # Errors
    /// They cannot be read or written.
    pub fn adopt(&self, key: &Key) -> Result<Option<StepRecord>, StoreError> {
        let Some(shared) = &self.shared else { return Ok(None) };
        // Before it is read: a collection that moves it away sees this, and puts it back.
        shared.mark_used(key)?;
        let Some(record) = shared.record(key)? else { return Ok(None) };
        let workspace = self.workspace()?;
        let mut wrong = Vec::new();
        for output in &record.outputs {
            let to = workspace.path().join(&output.name);
            if let Some(folder) = to.parent() {
                self.disk.create_dir(folder)?;
            }
            if !shared.take(output, &to)? {
                wrong.push(output.digest);
            }
        }
        let files = self.blobs.finish(workspace.path())?;
        let found = |wanted: &StoredOutput| files.iter().any(|file| file.output == *wanted);
        wrong.extend(record.outputs.iter().filter(|output| !found(output)).map(|output| output.digest));
        if !wrong.is_empty() {
            shared.damaged().extend(wrong);
            return Ok(None);
        }
        self.publish_files(&workspace, &files, record.clone())?;
        Ok(Some(record))
    }

    /// Offers the outputs of a key to the shared folder, if there is one and it lacks them. Returns true if
    /// it had them.
    ///
    /// # Errors
    /// It cannot be read or written, or it has other outputs of this key.
    pub fn share(&self, key: &Key) -> Result<bool, StoreError> {
        let Some(shared) = &self.shared else { return Ok(false) };
        let Some(own) = self.full_record(key)? else { return Ok(false) };
        match shared.offer(&own, &|digest| self.path_of(digest))? {
            Offer::Known(first) | Offer::Repaired(first) if first.outputs != own.outputs => {
                let shared = shared.root.clone();
                Err(StoreError::SharedMismatch(Box::new(SharedMismatch { shared, first, own })))
            }
            offer => Ok(matches!(offer, Offer::Known(_))),
        }
    }

    /// The record of a key in the shared folder. Its files may be lost or damaged there: only
    /// [`Store::adopt`] reads them.
    ///
    /// # Errors
    /// The record exists but cannot be read.
    pub fn shared_record(&self, key: &Key) -> Result<Option<RecordSummary>, StoreError> {
        let Some(shared) = &self.shared else { return Ok(None) };
        Ok(shared.record(key)?.map(|record| record.brief()))
    }
}
