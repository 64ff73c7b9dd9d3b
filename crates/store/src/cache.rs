//! A bound on the size of a store in front of a shared one: files that the shared store has make room.
//!
//! Each record holds its files. One that no step of the build needs any more is idle, and the record that is
//! idle longest gives up its files first, if the shared store has the same outputs. A file stays as long as
//! another record holds it. The records stay, so the next build finds out which files to copy again.

use super::disk::{disk_error, is_absent};
use super::record::{RecordSummary, StepRecord, StoredOutput};
use super::shared::SharedStore;
use super::state::StateTable;
use super::{Digest, Key, Store, StoreError};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};

/// Size below which a file stays, bytes: the records of thousands of scenes need little space, and commands
/// read them after a build.
const SMALL: u64 = 64 << 10;

/// The files of a store with a bound.
#[derive(Debug)]
pub(super) struct StoreCache {
    /// Bytes that the files may take.
    limit: u64,
    held: Mutex<HeldFiles>,
}

/// Number and bytes of files that were removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EvictedFiles {
    /// Number of files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

#[derive(Debug, Default)]
struct HeldFiles {
    /// Bytes of all files.
    bytes: u64,
    files: BTreeMap<Digest, HeldFile>,
    records: BTreeMap<Key, HoldingRecord>,
    /// Idle records by the turn at which they became idle.
    idle: BTreeMap<u64, Key>,
    turns: u64,
    evicted: EvictedFiles,
}

#[derive(Debug)]
struct HeldFile {
    size: u64,
    /// Number of records that hold it.
    holders: usize,
}

#[derive(Debug)]
struct HoldingRecord {
    outputs: Vec<StoredOutput>,
    /// Its turn among the idle ones; `None` while a step of the build needs it.
    turn: Option<u64>,
}

impl HeldFiles {
    /// Marks a record as needed.
    fn hold(&mut self, key: Key, outputs: &[StoredOutput]) {
        if let Some(record) = self.records.get_mut(&key) {
            if let Some(turn) = record.turn.take() {
                self.idle.remove(&turn);
            }
            if record.outputs == outputs {
                return;
            }
            // A step that was made again, with other bytes.
            self.remove(&key);
        }
        for StoredOutput { digest, size, .. } in outputs {
            // Records may share a file, and it takes its space on the disk once.
            let file = self.files.entry(*digest).or_insert_with(|| {
                self.bytes += size;
                HeldFile { size: *size, holders: 0 }
            });
            file.holders += 1;
        }
        self.records.insert(key, HoldingRecord { outputs: outputs.to_owned(), turn: None });
    }

    /// Marks a record as idle.
    fn let_go(&mut self, key: &Key) {
        let Some(record) = self.records.get_mut(key).filter(|record| record.turn.is_none()) else { return };
        record.turn = Some(self.turns);
        self.idle.insert(self.turns, *key);
        self.turns += 1;
    }

    /// Removes a record. Returns its files that no other record holds.
    fn remove(&mut self, key: &Key) -> Vec<Digest> {
        let outputs = self.records.remove(key).map(|record| record.outputs).unwrap_or_default();
        let mut free = Vec::new();
        for StoredOutput { digest, .. } in outputs {
            let Some(file) = self.files.get_mut(&digest) else { continue };
            file.holders -= 1;
            if file.holders == 0 {
                self.bytes -= file.size;
                self.files.remove(&digest);
                free.push(digest);
            }
        }
        free
    }
}

impl StoreCache {
    fn held(&self) -> MutexGuard<'_, HeldFiles> {
        self.held.lock().expect("no holder panics")
    }
}

/// The outputs that can make room.
fn large(outputs: &[StoredOutput]) -> Vec<StoredOutput> {
    outputs.iter().filter(|output| output.size >= SMALL).cloned().collect()
}

impl Store {
    /// Bounds the size of this store.
    pub(super) fn bound(&mut self, limit: u64) -> Result<(), StoreError> {
        let mut found = Vec::new();
        for (key, summary) in self.keyed_records() {
            let is_there = |output: &StoredOutput| self.disk.stat(&self.path_of(&output.digest)).is_ok();
            let outputs = large(&summary.outputs);
            // A record whose files gave way earlier holds none of them.
            if outputs.iter().all(is_there) {
                let stat = self.disk.stat(&StepRecord::record_path(&self.root, &key));
                found.push((stat.map_or(i64::MIN, |stat| stat.mtime_ns), key, outputs));
            }
        }
        // No use is recorded, so the oldest files go first.
        found.sort();
        let mut held = HeldFiles::default();
        for (_, key, outputs) in found {
            held.hold(key, &outputs);
            held.let_go(&key);
        }
        self.cache = Some(StoreCache { limit, held: Mutex::new(held) });
        Ok(())
    }

    /// Keeps the outputs of a key, because a step of this build needs them.
    pub fn hold(&self, key: &Key, outputs: &[StoredOutput]) {
        if let Some(cache) = &self.cache {
            cache.held().hold(*key, &large(outputs));
        }
    }

    /// Notes that this build needs the outputs of a key no longer, and makes room. The next flush reports an
    /// error.
    pub fn let_go(&self, key: &Key) {
        let Some(cache) = &self.cache else { return };
        cache.held().let_go(key);
        self.make_room();
    }

    /// Removes files until the store is within its bound, as far as they are idle and the shared store has
    /// them.
    pub fn make_room(&self) {
        let (Some(cache), Some(shared)) = (&self.cache, &self.shared) else { return };
        let mut held = cache.held();
        // One lock for the whole loop: a step that calls `hold` meanwhile waits, and does not lose its files.
        while held.bytes > cache.limit
            && let Some((_, key)) = held.idle.pop_first()
        {
            if let Err(error) = self.give_up(&key, &mut held, shared) {
                self.failed.lock().expect("no holder panics").get_or_insert(error);
                return;
            }
        }
    }

    /// Removes the files of a record, if the shared store has it.
    fn give_up(&self, key: &Key, held: &mut HeldFiles, shared: &SharedStore) -> Result<(), StoreError> {
        // A record that stays has no turn, so it is not asked for again.
        held.records.get_mut(key).into_iter().for_each(|record| record.turn = None);
        let local = held.records.get(key).map(|record| &record.outputs);
        // Files that the shared store lacks, or has with other bytes, could not be copied back.
        if shared.outputs(key)?.map(|outputs| large(&outputs)).as_ref() != local {
            return Ok(());
        }
        for digest in held.remove(key) {
            let path = self.path_of(&digest);
            let size = match self.disk.stat(&path) {
                Ok(stat) => stat.size,
                Err(e) if is_absent(&e) => continue,
                Err(e) => return Err(disk_error("reading", &path)(e)),
            };
            self.disk.remove(&path)?;
            if let Some(name) = path.to_str() {
                self.state().delete(StateTable::Stat, name);
            }
            held.evicted.files += 1;
            held.evicted.bytes += size;
        }
        Ok(())
    }

    /// The files that were removed because the shared store has them.
    #[must_use]
    pub fn evicted(&self) -> EvictedFiles {
        self.cache.as_ref().map(|cache| cache.held().evicted).unwrap_or_default()
    }

    /// Every record of the index, with its key.
    fn keyed_records(&self) -> Vec<(Key, RecordSummary)> {
        let rows = self.state().all(StateTable::Record).into_iter();
        rows.filter_map(|(name, row)| Some((Key(name.parse().ok()?), serde_json::from_slice(&row).ok()?)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(n: u8) -> Key {
        Key(Digest::of_bytes(&[n]))
    }

    fn output(n: u8) -> StoredOutput {
        StoredOutput { name: format!("{n}"), digest: Digest::of_bytes(&[n]), size: 100 }
    }

    #[test]
    fn a_file_of_two_records_is_free_when_both_gave_it_up() {
        let mut held = HeldFiles::default();
        held.hold(key(1), &[output(1), output(2)]);
        held.hold(key(2), &[output(2), output(3)]);
        assert_eq!(held.bytes, 300);
        assert_eq!(held.remove(&key(1)), [output(1).digest]);
        assert_eq!(held.bytes, 200);
        assert_eq!(held.remove(&key(2)), [output(2).digest, output(3).digest]);
        assert_eq!((held.bytes, held.files.len(), held.records.len()), (0, 0, 0));
    }

    #[test]
    fn records_take_turns_in_the_order_in_which_they_became_idle() {
        let mut held = HeldFiles::default();
        for n in [1, 2, 3] {
            held.hold(key(n), &[output(n)]);
            held.let_go(&key(n));
        }
        // The second is needed again, and becomes idle last.
        held.hold(key(2), &[output(2)]);
        assert_eq!(held.idle.values().copied().collect::<Vec<_>>(), [key(1), key(3)]);
        held.let_go(&key(2));
        // A second end of the same need changes nothing.
        held.let_go(&key(1));
        assert_eq!(held.idle.values().copied().collect::<Vec<_>>(), [key(1), key(3), key(2)]);
        assert_eq!(held.bytes, 300);
    }

    #[test]
    fn other_outputs_of_a_key_take_the_place_of_the_first() {
        let mut held = HeldFiles::default();
        held.hold(key(1), &[output(1), output(2)]);
        held.let_go(&key(1));
        held.hold(key(1), &[output(3)]);
        assert_eq!((held.bytes, held.idle.len()), (100, 0));
        assert_eq!(held.remove(&key(1)), [output(3).digest]);
    }
}
