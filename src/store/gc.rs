//! The sweep: deletes what nobody marked and what is old enough that nobody may be about to.
//!
//! Order makes it safe to kill at any moment: rows of the index, then records, then blobs, so that nothing that is left
//! names what is gone. Each file is first renamed into `trash/`, where the next sweep finds it if this one ends early.

use super::disk::failed;
use super::fs::Stat;
use super::state::Table;
use super::{Digest, Key, LOG, LOGS, Store, StoreError};
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::PathBuf;

/// What a sweep may take.
#[derive(Debug, Clone, Copy)]
pub struct Sweep {
    /// Files written later stay, in nanoseconds since the epoch.
    pub until_ns: i64,
    /// Only say what would go.
    pub dry_run: bool,
}

/// What a sweep took, or would take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Swept {
    /// Records.
    pub records: usize,
    /// Blobs.
    pub blobs: usize,
    /// Bytes of the blobs. Those that a release is linked to stay on disk until it goes.
    pub bytes: u64,
    /// Blobs that stay.
    pub kept_blobs: usize,
    /// Bytes of the blobs that stay.
    pub kept_bytes: u64,
    /// Files in `trash/` from before, and what programs said in steps that nobody marked.
    pub trash: usize,
    /// Bytes of those.
    pub trash_bytes: u64,
}

/// A file of `cas/` or `ac/`.
struct Stored {
    name: Digest,
    path: PathBuf,
    stat: Stat,
}

/// What a sweep calls its own files in `trash/`.
const OWN: &str = "gc.";

impl Store {
    /// Deletes every record that is neither marked nor young, then every blob that no record left names and that is
    /// not young, then old trash. Files of other names are left alone.
    ///
    /// # Errors
    /// When the disk or the database refuses. What was marked is whole then too.
    pub fn sweep(&self, marked: &BTreeSet<Key>, sweep: Sweep) -> Result<Swept, StoreError> {
        let is_old = |stat: &Stat| stat.mtime_ns <= sweep.until_ns;
        let (gone, kept): (Vec<_>, Vec<_>) = self
            .stored("ac", ".json")?
            .into_iter()
            .partition(|record| !marked.contains(&Key(record.name)) && is_old(&record.stat));
        let keys = kept.iter().map(|record| Key(record.name)).chain(marked.iter().copied());
        let mut named = BTreeSet::new();
        for key in keys {
            // A record that cannot be read now may be read later: what it names must not be gone then.
            let outputs = self.record(&key)?.map(|record| record.outputs);
            named.extend(outputs.into_iter().flatten().map(|output| output.digest));
        }
        let (blobs, kept): (Vec<_>, Vec<_>) = self
            .stored("cas", "")?
            .into_iter()
            .partition(|blob| !named.contains(&blob.name) && is_old(&blob.stat));
        let mut trash = self.old_trash(sweep.until_ns)?;
        trash.extend(self.old_logs(marked, sweep.until_ns)?);
        let bytes = |files: &[Stored]| files.iter().map(|file| file.stat.size).sum();
        let swept = Swept {
            records: gone.len(),
            blobs: blobs.len(),
            bytes: bytes(&blobs),
            kept_blobs: kept.len(),
            kept_bytes: bytes(&kept),
            trash: trash.len(),
            trash_bytes: trash.iter().map(|(_, bytes)| bytes).sum(),
        };
        if !sweep.dry_run {
            self.forget(&gone, &blobs)?;
            self.delete(gone.iter().chain(&blobs))?;
            trash.iter().try_for_each(|(path, _)| self.disk.remove(path))?;
        }
        Ok(swept)
    }

    /// The files of a folder of the store, by their names there; none where the folder is absent.
    pub(super) fn files_of(&self, folder: &str) -> Result<Vec<(String, PathBuf)>, StoreError> {
        let folder = self.root.join(folder);
        match self.disk.stat(&folder) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(Vec::new()),
            _ => self.disk.files_below(&folder),
        }
    }

    /// The files of a folder that are named as this program names them.
    fn stored(&self, folder: &str, suffix: &str) -> Result<Vec<Stored>, StoreError> {
        let mut stored = Vec::new();
        for (name, path) in self.files_of(folder)? {
            let digest = name.strip_suffix(suffix).and_then(|name| name.split_once('/'));
            let digest =
                digest.filter(|(head, name)| name.starts_with(head)).and_then(|(_, d)| d.parse().ok());
            let Some(name) = digest else { continue };
            match self.disk.stat(&path) {
                Ok(stat) => stored.push(Stored { name, path, stat }),
                // A look without the lock may see a file go.
                Err(e) if e.kind() == ErrorKind::NotFound => {}
                Err(e) => return Err(failed("reading", &path)(e)),
            }
        }
        Ok(stored)
    }

    /// What lies in `trash/` from before: what earlier sweeps left, and what was moved there long enough ago.
    fn old_trash(&self, until_ns: i64) -> Result<Vec<(PathBuf, u64)>, StoreError> {
        let mut old = Vec::new();
        for (name, path) in self.files_of("trash")? {
            // ctime says when it was moved; its bytes may be of any age.
            if let Ok(stat) = self.disk.stat(&path)
                && (name.starts_with(OWN) || stat.ctime_ns <= until_ns)
            {
                old.push((path, stat.size));
            }
        }
        Ok(old)
    }

    /// What programs said for keys that nobody marked, long enough ago.
    fn old_logs(&self, marked: &BTreeSet<Key>, until_ns: i64) -> Result<Vec<(PathBuf, u64)>, StoreError> {
        let mut old = Vec::new();
        for (name, path) in self.files_of(LOGS)? {
            let key = name.strip_suffix(LOG).and_then(|name| name.parse().ok()).map(Key);
            if key.is_some_and(|key| !marked.contains(&key))
                && let Ok(stat) = self.disk.stat(&path)
                && stat.mtime_ns <= until_ns
            {
                old.push((path, stat.size));
            }
        }
        Ok(old)
    }

    /// Takes what will go out of the index, and has that on disk: a row must not outlive its record.
    fn forget(&self, records: &[Stored], blobs: &[Stored]) -> Result<(), StoreError> {
        if records.is_empty() && blobs.is_empty() {
            return Ok(());
        }
        {
            let mut state = self.state();
            for record in records {
                state.delete(Table::Record, &record.name.to_string());
            }
            for path in blobs.iter().filter_map(|blob| blob.path.to_str()) {
                state.delete(Table::Stat, path);
            }
            // A memo may rest on blobs that stay and on a record that goes.
            for memo in state.all(Table::Memo).into_keys() {
                state.delete(Table::Memo, &memo);
            }
        }
        self.flush()
    }

    fn delete<'a>(&self, files: impl Iterator<Item = &'a Stored>) -> Result<(), StoreError> {
        let mut moved = Vec::new();
        for (number, file) in files.enumerate() {
            let to = self.root.join("trash").join(format!("{OWN}{}.{number}", std::process::id()));
            self.disk.rename(&file.path, &to)?;
            moved.push(to);
        }
        moved.iter().try_for_each(|path| self.disk.remove(path))
    }
}
