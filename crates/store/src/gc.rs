//! The garbage collection: deletes files that are neither marked nor young.
//!
//! The order makes it safe to kill at any moment: rows of the index, then records, then blobs, so
//! that nothing that remains names something that is gone. Each file is first renamed into
//! the trash, where the next collection finds it if this one ends early.

use super::blob::{fresh_name, is_fresh_name};
use super::disk::disk_error;
use super::state::{StateTable, is_database_aside};
use super::{Digest, Key, LOG, LOGS, RESUME, Store, StoreError, TRASH};
use gs2e_files::stat::FileStat;
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::PathBuf;

/// Options of a garbage collection.
#[derive(Debug, Clone, Copy)]
pub struct GcSweep {
    /// Files written after this time stay, ns since the epoch.
    pub until_ns: i64,
    /// True if the collection only reports.
    pub dry_run: bool,
}

/// The result of a garbage collection, or of its dry run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct SweepSummary {
    /// Number of records deleted.
    pub records: usize,
    /// Number of blobs deleted.
    pub blobs: usize,
    /// Bytes of the deleted blobs. Blobs with a hard link from a release stay on disk until that is
    /// removed.
    pub bytes: u64,
    /// Number of blobs that stay.
    pub kept_blobs: usize,
    /// Bytes of the blobs that stay.
    pub kept_bytes: u64,
    /// Number of older files in the trash, and of logs and interrupted states for keys that are not
    /// marked.
    pub trash: usize,
    /// Bytes of those files.
    pub trash_bytes: u64,
}

/// A file of `cas/` or `ac/`.
struct SweepFile {
    name: Digest,
    path: PathBuf,
    stat: FileStat,
}

/// Prefix of a collection's own files in the trash.
const TRASH_PREFIX: &str = "gc.";

/// Returns true for a file in the trash with a name that this program gives. The file of a folder that had
/// a blob's name counts by the folder.
fn is_trash_name(name: &str) -> bool {
    let name = name.split('/').next().unwrap_or_default();
    is_database_aside(name) || is_fresh_name(name.strip_prefix(TRASH_PREFIX).unwrap_or(name).as_ref())
}

impl Store {
    /// Deletes every record that is neither marked nor young, then every blob that no remaining
    /// record names and that is not young, then old trash. Files with other names are ignored.
    ///
    /// # Errors
    /// The disk or the database fails. Everything marked is intact even then.
    pub fn sweep(&self, marked: &BTreeSet<Key>, sweep: GcSweep) -> Result<SweepSummary, StoreError> {
        let is_old = |stat: &FileStat| stat.mtime_ns <= sweep.until_ns;
        // Records come before blobs: the records that stay decide which blobs stay.
        let (gone, kept): (Vec<_>, Vec<_>) = self
            .stored("ac", ".json")?
            .into_iter()
            .partition(|record| !marked.contains(&Key(record.name)) && is_old(&record.stat));
        let keys = kept.iter().map(|record| Key(record.name)).chain(marked.iter().copied());
        let mut named = BTreeSet::new();
        for key in keys {
            // A record that cannot be read now may be readable later, and its blobs must exist
            // then.
            let outputs = self.record(&key)?.map(|record| record.outputs);
            named.extend(outputs.into_iter().flatten().map(|output| output.digest));
        }
        // Young blobs stay without a record: a build that runs now publishes its record after them.
        let (blobs, kept): (Vec<_>, Vec<_>) = self
            .stored("cas", "")?
            .into_iter()
            .partition(|blob| !named.contains(&blob.name) && is_old(&blob.stat));
        let mut trash = self.old_trash(sweep.until_ns)?;
        // Logs of external programs, and states of interrupted steps.
        trash.extend(self.old_of_keys(LOGS, |name| name.strip_suffix(LOG), marked, sweep.until_ns)?);
        trash.extend(self.old_of_keys(
            RESUME,
            |name| Some(name.split_once('/')?.0),
            marked,
            sweep.until_ns,
        )?);
        let bytes = |files: &[SweepFile]| files.iter().map(|file| file.stat.size).sum();
        let swept = SweepSummary {
            records: gone.len(),
            blobs: blobs.len(),
            bytes: bytes(&blobs),
            kept_blobs: kept.len(),
            kept_bytes: bytes(&kept),
            trash: trash.len(),
            trash_bytes: trash.iter().map(|(_, bytes)| bytes).sum(),
        };
        if !sweep.dry_run {
            // The index goes first. It may name less than there is, never more.
            self.forget(&gone, &blobs)?;
            self.delete(gone.iter().chain(&blobs))?;
            trash.iter().try_for_each(|(path, _)| self.disk.remove(path))?;
        }
        Ok(swept)
    }

    /// The files of a folder of the store, by name; empty if the folder is absent.
    pub(super) fn files_of(&self, folder: &str) -> Result<Vec<(String, PathBuf)>, StoreError> {
        let folder = self.root.join(folder);
        match self.disk.stat(&folder) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            // Listing the folder reports every other error.
            _ => self.disk.files_below(&folder),
        }
    }

    /// The files of a folder with names that this program gives.
    fn stored(&self, folder: &str, suffix: &str) -> Result<Vec<SweepFile>, StoreError> {
        let mut stored = Vec::new();
        for (name, path) in self.files_of(folder)? {
            let digest = name.strip_suffix(suffix).and_then(|name| name.split_once('/'));
            let digest =
                digest.filter(|(head, name)| name.starts_with(head)).and_then(|(_, d)| d.parse().ok());
            // A file with another name is not from this program, and is not deleted.
            let Some(name) = digest else { continue };
            match self.disk.stat(&path) {
                Ok(stat) => stored.push(SweepFile { name, path, stat }),
                // Without the lock, a file may vanish during the scan.
                Err(e) if e.kind() == ErrorKind::NotFound => {}
                Err(e) => return Err(disk_error("reading", &path)(e)),
            }
        }
        Ok(stored)
    }

    /// Old files in the trash: those of earlier collections, and those moved there long enough ago.
    fn old_trash(&self, until_ns: i64) -> Result<Vec<(PathBuf, u64)>, StoreError> {
        let mut old = Vec::new();
        for (name, path) in self.files_of(TRASH)?.into_iter().filter(|(name, _)| is_trash_name(name)) {
            // The ctime is the time of the move; the content may have any age.
            if let Ok(stat) = self.disk.stat(&path)
                // A collection judged its own files before it moved them, so they need no second wait.
                && (name.starts_with(TRASH_PREFIX) || stat.ctime_ns <= until_ns)
            {
                old.push((path, stat.size));
            }
        }
        Ok(old)
    }

    /// Old files of a folder for keys that are not marked. `key_of` finds the key in the name of a file.
    fn old_of_keys(
        &self,
        folder: &str,
        key_of: fn(&str) -> Option<&str>,
        marked: &BTreeSet<Key>,
        until_ns: i64,
    ) -> Result<Vec<(PathBuf, u64)>, StoreError> {
        let mut old = Vec::new();
        for (name, path) in self.files_of(folder)? {
            let key = key_of(&name).and_then(|key| key.parse().ok()).map(Key);
            if key.is_some_and(|key| !marked.contains(&key))
                && let Ok(stat) = self.disk.stat(&path)
                && stat.mtime_ns <= until_ns
            {
                old.push((path, stat.size));
            }
        }
        Ok(old)
    }

    /// Deletes rows from the index and syncs: a row must not outlive its record.
    fn forget(&self, records: &[SweepFile], blobs: &[SweepFile]) -> Result<(), StoreError> {
        if records.is_empty() && blobs.is_empty() {
            return Ok(());
        }
        {
            // The guard ends before `flush`, which locks the state itself.
            let mut state = self.state();
            // A record of the index that outlives its file would be taken for a product that is
            // there.
            for record in records {
                state.delete(StateTable::Record, &record.name.to_string());
            }
            for path in blobs.iter().filter_map(|blob| blob.path.to_str()) {
                state.delete(StateTable::Stat, path);
            }
            // A memo may depend on blobs that stay and on a record that is deleted.
            for memo in state.all(StateTable::Memo).into_keys() {
                state.delete(StateTable::Memo, &memo);
            }
        }
        self.flush()
    }

    fn delete<'a>(&self, files: impl Iterator<Item = &'a SweepFile>) -> Result<(), StoreError> {
        let mut moved = Vec::new();
        for (number, file) in files.enumerate() {
            // A killed collection leaves its files in the trash, where the next one removes them.
            let to = self.root.join(TRASH).join(format!("{TRASH_PREFIX}{}", fresh_name(number)));
            self.disk.rename(&file.path, &to)?;
            moved.push(to);
        }
        moved.iter().try_for_each(|path| self.disk.remove(path))
    }
}
