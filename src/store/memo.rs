//! Memos: facts that hold as long as some files and blobs have not moved.
//!
//! What a build of two thousand scenes would otherwise work out anew each time (that a recipe still asks for the very
//! steps that are there) is worked out once and kept with the stat fields of every file that it was made from. While
//! they all agree, nothing is read, parsed or hashed. A memo is only written where equal fields mean equal bytes.

use super::disk::{Disk, failed, is_absent};
use super::fs::Stat;
use super::stat_cache::Sighting;
use super::{Digest, StoreError};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A fact with its grounds.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Memo<T> {
    /// What else the fact depends on: the program itself, and its options.
    pub(super) tag: Digest,
    /// Files outside the store.
    pub(super) files: Vec<(String, Stat)>,
    /// Blobs.
    pub(super) blobs: Vec<(Digest, Stat)>,
    pub(super) fact: T,
}

impl<T> Memo<T> {
    /// Whether every file is as it was; `path_of` says where a blob lies.
    pub(super) fn holds(
        &self,
        tag: &Digest,
        disk: &Disk,
        path_of: &impl Fn(&Digest) -> PathBuf,
    ) -> Result<bool, StoreError> {
        let is = |path: &Path, then: &Stat| match disk.stat(path) {
            Ok(now) => Ok(now == *then),
            Err(e) if is_absent(&e) => Ok(false),
            Err(e) => Err(failed("reading", path)(e)),
        };
        if self.tag != *tag {
            return Ok(false);
        }
        for (path, then) in &self.files {
            if !is(Path::new(path), then)? {
                return Ok(false);
            }
        }
        for (digest, then) in &self.blobs {
            if !is(&path_of(digest), then)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Files as a memo keeps them; `None` where one of them may change without showing it, or has no name in UTF-8.
pub(super) fn firm(files: &[(PathBuf, Sighting)]) -> Option<Vec<(String, Stat)>> {
    let firm = |(path, seen): &(PathBuf, Sighting)| {
        seen.is_firm().then_some(()).and_then(|()| Some((path.to_str()?.to_owned(), seen.stat)))
    };
    files.iter().map(firm).collect()
}
