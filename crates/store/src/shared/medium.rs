//! Where the files of a shared store are: in a folder, or in a bucket.

use crate::record::{StepRecord, StoredOutput};
use crate::{Key, StoreError};
use std::collections::BTreeSet;
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

/// Largest file that can be a record, bytes: one of 100,000 outputs has about 20 MB.
pub(super) const MAX_RECORD: u64 = 64 << 20;

/// Files by their names, such as `ac/3f/3fa9….json`. They appear whole, and the first writer wins.
pub(super) trait SharedMedium: fmt::Debug + Send + Sync {
    /// The bytes of a record; `None` if it is absent, or cannot be one.
    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError>;

    /// Copies a blob to a new file of this machine. Returns `false` if it is absent, or has other bytes than
    /// its name says. Part of the bytes may then have been copied.
    fn take(&self, blob: &StoredOutput, to: &Path) -> Result<bool, StoreError>;

    /// Creates a file. Returns `false` if the name is taken.
    fn publish(&self, bytes: SharedBytes<'_>, name: &str) -> Result<bool, StoreError>;

    /// Creates or replaces a file.
    fn replace(&self, bytes: SharedBytes<'_>, name: &str) -> Result<(), StoreError>;

    /// Returns true if the blob is there, as far as can be known without a copy of it.
    fn is_sound(&self, blob: &StoredOutput) -> Result<bool, StoreError>;

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
    Ok(record.filter(|record| can_be_written(&record.outputs)))
}

/// Returns true if files with these names can lie side by side in a folder. Other names were not written by
/// this program.
fn can_be_written(outputs: &[StoredOutput]) -> bool {
    let names: BTreeSet<&Path> = outputs.iter().map(|output| Path::new(&output.name)).collect();
    let is_below_another = |name: &&Path| name.ancestors().skip(1).any(|folder| names.contains(folder));
    names.len() == outputs.len()
        && outputs.iter().all(|output| stays_inside(&output.name))
        && !names.iter().any(is_below_another)
}

/// Returns true for a name of a file below a folder.
fn stays_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}
