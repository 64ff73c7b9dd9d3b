//! Memos: facts that hold as long as certain files and blobs have not changed.
//!
//! A build of two thousand scenes would otherwise derive each time that a recipe still asks for the
//! steps that are there. This fact is derived once, and stored with the stat fields of every file
//! that it depends on. While they all agree, nothing is read, parsed or hashed. A memo is only
//! written where equal fields mean equal bytes.

use super::disk::{StoreDisk, disk_error, is_absent};
use super::stat_cache::StatEntry;
use super::state::StateTable;
use super::{Digest, Store, StoreError};
use gs2e_files::stat::{FileStat, StatSighting};
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// A fact with its dependencies.
#[derive(Debug, Serialize, Deserialize)]
struct StoredMemo<T> {
    /// Other dependencies of the fact: the program itself, and its options.
    tag: Digest,
    /// Files outside the store.
    files: Vec<(String, FileStat)>,
    /// Blobs.
    blobs: Vec<(Digest, FileStat)>,
    fact: T,
}

impl<T> StoredMemo<T> {
    /// Returns true if no file has changed; `path_of` maps a blob to its path.
    fn holds(
        &self,
        tag: &Digest,
        disk: &StoreDisk,
        path_of: &impl Fn(&Digest) -> PathBuf,
    ) -> Result<bool, StoreError> {
        let is = |path: &Path, then: &FileStat| match disk.stat(path) {
            Ok(now) => Ok(now == *then),
            Err(e) if is_absent(&e) => Ok(false),
            Err(e) => Err(disk_error("reading", path)(e)),
        };
        // The tag comes first, because it needs no look at a file.
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

/// The dependencies of a fact.
#[derive(Debug, Clone, Copy)]
pub struct MemoGround<'a> {
    /// The program itself, and its options.
    pub tag: Digest,
    /// Files outside the store, observed before they were read.
    pub files: &'a [(PathBuf, StatSighting)],
    /// Blobs.
    pub blobs: &'a [Digest],
}

impl Store {
    /// The facts stored under these names, if their files have not changed. Facts rely on stat
    /// fields, so a store that was opened to verify returns none.
    ///
    /// # Errors
    /// A file exists but its stat fields cannot be read.
    pub fn recall<T: DeserializeOwned + Send>(
        &self,
        names: &[String],
        tag: &Digest,
    ) -> Result<Vec<Option<T>>, StoreError> {
        /// Number of names below which looking each one up is cheaper than reading the table.
        const FEW: usize = 64;
        if self.verified.is_some() {
            return Ok(names.iter().map(|_| None).collect());
        }
        let rows: Vec<Option<Vec<u8>>> = if names.len() < FEW {
            names.iter().map(|name| self.state().get(StateTable::Memo, name)).collect()
        } else {
            let mut all = self.state().all(StateTable::Memo);
            names.iter().map(|name| all.remove(name)).collect()
        };
        let recall = |row: Option<Vec<u8>>| {
            let memo = row.and_then(|row| postcard::from_bytes::<StoredMemo<T>>(&row).ok());
            let Some(memo) = memo else { return Ok(None) };
            if !memo.holds(tag, &self.disk, &|digest| self.blobs.path(digest))? {
                return Ok(None);
            }
            self.counts.trusted.fetch_add(memo.files.len() + memo.blobs.len(), Ordering::Relaxed);
            Ok(Some(memo.fact))
        };
        rows.into_par_iter().map(recall).collect()
    }

    /// Stores a fact. If a file or blob that it depends on is so young that it could still change
    /// unnoticed, nothing is stored.
    pub fn remember<T: Serialize>(&self, name: &str, ground: MemoGround<'_>, fact: T) {
        let MemoGround { tag, files, blobs } = ground;
        let mut state = self.state();
        let known = |digest: &Digest| {
            // The fields of the time when the digest was found. If they have changed since, the
            // memo does not hold.
            let row = state.get(StateTable::Stat, self.blobs.path(digest).to_str()?)?;
            let entry: StatEntry = postcard::from_bytes(&row).ok()?;
            (entry.digest == *digest && entry.sighting.is_firm()).then_some((*digest, entry.sighting.stat))
        };
        let blobs: Option<Vec<_>> = blobs.iter().map(known).collect();
        let (Some(files), Some(blobs)) = (firm_files(files), blobs) else { return };
        let memo = StoredMemo { tag, files, blobs, fact };
        let row = postcard::to_stdvec(&memo).expect("a memo is plain data");
        state.put_new(StateTable::Memo, name, row);
    }
}

/// Files in the form of a memo; `None` if one of them may change unnoticed, or has a name that is
/// not UTF-8.
fn firm_files(files: &[(PathBuf, StatSighting)]) -> Option<Vec<(String, FileStat)>> {
    let firm = |(path, sighting): &(PathBuf, StatSighting)| {
        sighting.is_firm().then_some(()).and_then(|()| Some((path.to_str()?.to_owned(), sighting.stat)))
    };
    files.iter().map(firm).collect()
}
