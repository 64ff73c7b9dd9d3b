//! A folder or a bucket that the stores of several machines share: `VERSION`, `cas/` and `ac/` as in a
//! store.
//!
//! Files appear whole and never change: the first writer wins. There is no lock, no counter and no database,
//! because those fail on network file systems. A file that is seen late by a cache of the file system costs a
//! copy, and nothing else.
//!
//! Other people can write there. A blob is compared with its name while it is copied, no link is followed,
//! and a file that is no blob or no record counts as absent. Records are trusted: a record says which blobs
//! belong to a key, and only another run of the step can prove it wrong. A build therefore makes a share of
//! the steps again.

#[cfg(feature = "s3")]
mod bucket;
mod folder;
mod gc;
mod medium;
mod place;

pub use gc::{SharedSweep, SharedSweepSummary, sweep_shared};
pub use place::is_bucket;

use super::blob::blob_name;
use super::record::{RecordSummary, StepRecord, StoredOutput};
use super::{Digest, Key, Store, StoreError, StoreOptions};
use medium::{SharedBytes, SharedMedium, read_record};
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A shared store, open for reading and writing.
#[derive(Debug)]
pub(super) struct SharedStore {
    medium: Box<dyn SharedMedium>,
    /// Files that are lost, or have other bytes than their name says. Sound ones take their place.
    damaged: Mutex<BTreeSet<Digest>>,
}

/// Folder of the plans of array jobs. Only `gs2e gc` needs its name here.
pub const PLANS: &str = "gs2e-plans";

/// Different outputs of one key, in the shared store and on this machine.
#[derive(Debug)]
pub struct SharedMismatch {
    /// The shared store.
    pub shared: String,
    /// The record that was there first.
    pub first: StepRecord,
    /// The record of this machine.
    pub local: StepRecord,
}

impl fmt::Display for SharedMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let differs = |local: &&StoredOutput| !self.first.outputs.contains(local);
        let file =
            self.local.outputs.iter().find(differs).map_or("the list of files", |local| local.name.as_str());
        write!(
            f,
            "{} has other outputs of key {} than this machine: {file} differs",
            self.shared, self.local.key
        )
    }
}

impl SharedMismatch {
    /// The file of the record that was there first.
    #[must_use]
    pub fn record(&self) -> String {
        format!("{}/{}", self.shared, StepRecord::record_name(&self.first.key))
    }
}

impl SharedStore {
    /// Opens a shared store. One that is opened for writing is created if it is absent.
    pub(super) fn open(place: &Path, opening: &StoreOptions) -> Result<Self, StoreError> {
        Ok(Self { medium: place::open(place, opening)?, damaged: Mutex::default() })
    }

    fn damaged(&self) -> std::sync::MutexGuard<'_, BTreeSet<Digest>> {
        self.damaged.lock().expect("no holder panics")
    }

    fn record(&self, key: &Key) -> Result<Option<StepRecord>, StoreError> {
        read_record(self.medium.as_ref(), key)
    }

    /// The outputs of a key; `None` without a record.
    pub(super) fn outputs(&self, key: &Key) -> Result<Option<Vec<StoredOutput>>, StoreError> {
        Ok(self.record(key)?.map(|record| record.outputs))
    }

    /// Publishes a record and its outputs, whose files are at `path_of`.
    fn offer(&self, record: &StepRecord, path_of: &dyn Fn(&Digest) -> PathBuf) -> Result<Offer, StoreError> {
        let name = StepRecord::record_name(&record.key);
        // Before the record is read, as in `Store::adopt`.
        self.medium.mark_used(&name)?;
        if let Some(first) = self.record(&record.key)? {
            let is_damaged = |output: &&StoredOutput| self.damaged().contains(&output.digest);
            let damaged: Vec<&StoredOutput> = record.outputs.iter().filter(is_damaged).collect();
            let was_sound = damaged.is_empty();
            damaged.into_iter().try_for_each(|output| self.put(output, &path_of(&output.digest)))?;
            return Ok(if was_sound { Offer::Known(first) } else { Offer::Repaired(first) });
        }
        record.outputs.iter().try_for_each(|output| self.put(output, &path_of(&output.digest)))?;
        // After the files, so that no record names bytes that are not there.
        let bytes = record.to_bytes();
        if !self.medium.publish(SharedBytes::Memory(&bytes), &name)? {
            match self.record(&record.key)? {
                // The answer to an earlier attempt of this machine was lost.
                Some(first) if first.to_bytes() == bytes => {}
                // Another machine was faster.
                Some(first) => return Ok(Offer::Known(first)),
                // A damaged record has the name.
                None => self.medium.replace(SharedBytes::Memory(&bytes), &name)?,
            }
        }
        // A file that was there before may have been unused for long, and a collection that did not see the
        // record may have moved it away.
        for output in &record.outputs {
            if self.medium.is_gone(&blob_name(&output.digest))? {
                self.put(output, &path_of(&output.digest))?;
            }
        }
        Ok(Offer::New)
    }

    fn put(&self, output: &StoredOutput, local: &Path) -> Result<(), StoreError> {
        let digest = &output.digest;
        let name = blob_name(digest);
        let is_sound = || Ok(!self.damaged().contains(digest) && self.medium.is_sound(output)?);
        // The second look is after the attempt: another machine may have put the same bytes there meanwhile.
        if !is_sound()? && !self.medium.publish(SharedBytes::File(local), &name)? && !is_sound()? {
            self.medium.replace(SharedBytes::File(local), &name)?;
        }
        self.damaged().remove(digest);
        Ok(())
    }
}

/// Result of an offer to the shared store.
#[derive(Debug)]
enum Offer {
    /// It had no record of this key.
    New,
    /// It had a record whose files were damaged, and has sound files now.
    Repaired(StepRecord),
    /// It had this record.
    Known(StepRecord),
}

impl Store {
    /// Takes the outputs of a key from the shared store. `None` if there is no such store, or it lacks
    /// them, or they are damaged there.
    ///
    /// # Errors
    /// They cannot be read or written.
    pub fn adopt(&self, key: &Key) -> Result<Option<StepRecord>, StoreError> {
        let Some(shared) = &self.shared else { return Ok(None) };
        // Before it is read: a collection that moves it away sees this, and puts it back.
        shared.medium.mark_used(&StepRecord::record_name(key))?;
        let Some(record) = shared.record(key)? else { return Ok(None) };
        let workspace = self.workspace()?;
        let (mut files, mut wrong) = (Vec::new(), Vec::new());
        for output in &record.outputs {
            let to = workspace.path().join(&output.name);
            if let Some(folder) = to.parent() {
                self.disk.create_dir(folder)?;
            }
            if shared.medium.take(output, &to)? {
                files.push(self.blobs.known(output, to)?);
            } else {
                // The loop goes on, so that `Store::share` learns of every damaged file at once.
                wrong.push(output.digest);
            }
        }
        if !wrong.is_empty() {
            shared.damaged().extend(wrong);
            return Ok(None);
        }
        self.publish_files(&workspace, &files, record.clone())?;
        Ok(Some(record))
    }

    /// Looks for lost and damaged outputs of a key in the shared store. [`Store::share`] then replaces them.
    /// [`Store::adopt`] finds them too.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn inspect_shared(&self, key: &Key) -> Result<(), StoreError> {
        let Some(shared) = &self.shared else { return Ok(()) };
        for output in shared.outputs(key)?.unwrap_or_default() {
            if !shared.medium.is_sound(&output)? {
                shared.damaged().insert(output.digest);
            }
        }
        Ok(())
    }

    /// Offers the outputs of a key to the shared store, if there is one and it lacks them. Returns true if
    /// it had them.
    ///
    /// # Errors
    /// It cannot be read or written, or it has other outputs of this key.
    pub fn share(&self, key: &Key) -> Result<bool, StoreError> {
        let Some(shared) = &self.shared else { return Ok(false) };
        let Some(local) = self.full_record(key)? else { return Ok(false) };
        match shared.offer(&local, &|digest| self.path_of(digest))? {
            Offer::Known(first) | Offer::Repaired(first) if first.outputs != local.outputs => {
                let shared = shared.medium.place();
                Err(StoreError::SharedMismatch(Box::new(SharedMismatch { shared, first, local })))
            }
            offer => Ok(matches!(offer, Offer::Known(_))),
        }
    }

    /// The record of a key in the shared store. Its files may be lost or damaged there: only
    /// [`Store::adopt`] reads them.
    ///
    /// # Errors
    /// The record exists but cannot be read.
    pub fn shared_record(&self, key: &Key) -> Result<Option<RecordSummary>, StoreError> {
        let Some(shared) = &self.shared else { return Ok(None) };
        Ok(shared.record(key)?.map(|record| record.brief()))
    }
}
