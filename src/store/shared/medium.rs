//! Where the files of a shared store are: in a folder, or in a bucket.

use crate::store::record::{StepRecord, StoredOutput};
use crate::store::{Digest, Key, StoreError};
use std::fmt;
use std::path::{Component, Path};

/// The bytes of a new file.
#[derive(Debug, Clone, Copy)]
pub(super) enum SharedBytes<'a> {
    /// Those of a file of this machine.
    File(&'a Path),
    /// These.
    Memory(&'a [u8]),
}

/// Files by their names, such as `ac/3f/3fa9….json`. They appear whole, and the first writer wins.
pub(super) trait SharedMedium: fmt::Debug + Send + Sync {
    /// The bytes of a small file; `None` if it is absent.
    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError>;

    /// Copies a file of `size` bytes to a new file of this machine. Returns `false` if it is absent, or visibly
    /// not that file.
    fn take(&self, name: &str, size: u64, to: &Path) -> Result<bool, StoreError>;

    /// Creates a file. Returns `false` if the name is taken.
    fn publish(&self, bytes: SharedBytes<'_>, name: &str) -> Result<bool, StoreError>;

    /// Creates or replaces a file.
    fn replace(&self, bytes: SharedBytes<'_>, name: &str) -> Result<(), StoreError>;

    /// Returns true if the file is there, as far as can be known without a copy of it.
    fn is_sound(&self, name: &str, digest: &Digest, size: u64) -> Result<bool, StoreError>;

    /// Returns true if a collection has removed the file since it was seen.
    fn is_gone(&self, name: &str) -> Result<bool, StoreError>;

    /// Notes that a record is in use, for a collection by age.
    fn mark_used(&self, name: &str) -> Result<(), StoreError>;

    /// The place, for messages.
    fn place(&self) -> String;
}

/// The record of a key; `None` if there is no sound one.
pub(super) fn read_record(medium: &dyn SharedMedium, key: &Key) -> Result<Option<StepRecord>, StoreError> {
    let bytes = medium.read(&StepRecord::record_name(key))?;
    let record = bytes.and_then(|bytes| StepRecord::parse_of(&bytes, key));
    // A name that leads out of a folder was not written by this program.
    let stays = |output: &StoredOutput| stays_inside(&output.name);
    Ok(record.filter(|record| record.outputs.iter().all(stays)))
}

/// Returns true for a name of a file below a folder.
fn stays_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}
