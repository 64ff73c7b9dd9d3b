//! Digests of files by their stat fields, so that a build that has nothing to do reads nothing.
//!
//! A digest is reused only if device, inode, size, mtime and ctime all agree and both times are older than the
//! moment of observation by two seconds: a file as new as its entry may have changed within the clock's grain.
//! ctime cannot be set by a program, so an edit that puts the mtime back is seen.

use super::{Digest, disk};
use std::collections::BTreeMap;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// A file at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stat {
    pub(super) dev: u64,
    pub(super) ino: u64,
    pub(super) size: u64,
    pub(super) mtime_ns: i64,
    pub(super) ctime_ns: i64,
}

impl Stat {
    fn of(path: &Path) -> io::Result<Self> {
        let m = std::fs::metadata(path)?;
        let ns = |s: i64, n: i64| s.saturating_mul(1_000_000_000).saturating_add(n);
        Ok(Self {
            dev: m.dev(),
            ino: m.ino(),
            size: m.size(),
            mtime_ns: ns(m.mtime(), m.mtime_nsec()),
            ctime_ns: ns(m.ctime(), m.ctime_nsec()),
        })
    }
}

/// What was seen of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) stat: Stat,
    pub(super) digest: Digest,
    /// When, in nanoseconds of the local clock; `SETTLED` where no older content can hide behind the fields.
    pub(super) observed_ns: i64,
}

/// A blob that this program published itself: nobody knew its name before.
const SETTLED: i64 = i64::MAX;

/// Younger than this at observation, and the file is read again.
const RACY_NS: i64 = 2_000_000_000;

#[derive(Debug)]
pub(super) struct StatCache {
    entries: BTreeMap<PathBuf, Entry>,
    changed: Vec<PathBuf>,
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

impl StatCache {
    pub(super) fn new(entries: BTreeMap<PathBuf, Entry>) -> Self {
        Self { entries, changed: Vec::new() }
    }

    /// The digest of a file's bytes.
    pub(super) fn digest_of(&mut self, path: &Path) -> io::Result<Digest> {
        let stat = Stat::of(path)?;
        if let Some(entry) = self.entries.get(path) {
            let oldest = entry.observed_ns.saturating_sub(RACY_NS);
            let settled = entry.observed_ns == SETTLED || (stat.mtime_ns < oldest && stat.ctime_ns < oldest);
            if entry.stat == stat && settled {
                return Ok(entry.digest);
            }
        }
        let observed_ns = now_ns();
        let digest = disk::digest(path)?;
        self.enter(path, Entry { stat, digest, observed_ns });
        Ok(digest)
    }

    /// Enters a file whose bytes this program just wrote or linked itself.
    pub(super) fn settle(&mut self, path: &Path, digest: Digest) {
        if let Ok(stat) = Stat::of(path) {
            self.enter(path, Entry { stat, digest, observed_ns: SETTLED });
        }
    }

    fn enter(&mut self, path: &Path, entry: Entry) {
        if self.entries.insert(path.to_owned(), entry) != Some(entry) {
            self.changed.push(path.to_owned());
        }
    }

    /// The entries that are new since the last call.
    pub(super) fn take_changes(&mut self) -> Vec<(PathBuf, Entry)> {
        let changed = std::mem::take(&mut self.changed);
        changed.into_iter().filter_map(|path| self.entries.get(&path).map(|e| (path.clone(), *e))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_that_restores_size_and_mtime_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"one").unwrap();
        let mut cache = StatCache::new(BTreeMap::new());
        cache.settle(&path, Digest::of(b"one"));
        assert_eq!(cache.digest_of(&path).unwrap(), Digest::of(b"one"));
        let before = std::fs::metadata(&path).unwrap().modified().unwrap();
        // The clock's grain: without a pause both ctimes may be the same tick.
        std::thread::sleep(std::time::Duration::from_millis(20));
        std::fs::write(&path, b"two").unwrap();
        std::fs::File::options().write(true).open(&path).unwrap().set_modified(before).unwrap();
        assert_eq!(cache.digest_of(&path).unwrap(), Digest::of(b"two"));
    }

    #[test]
    fn a_young_entry_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"one").unwrap();
        let stat = Stat::of(&path).unwrap();
        // An entry that claims other bytes for the same stat fields: a racy edit looks exactly so.
        let wrong = Entry { stat, digest: Digest::of(b"two"), observed_ns: stat.mtime_ns + RACY_NS / 2 };
        let mut cache = StatCache::new(BTreeMap::from([(path.clone(), wrong)]));
        assert_eq!(cache.digest_of(&path).unwrap(), Digest::of(b"one"));
        let old = Entry { stat, digest: Digest::of(b"two"), observed_ns: stat.ctime_ns + 2 * RACY_NS };
        let mut cache = StatCache::new(BTreeMap::from([(path.clone(), old)]));
        assert_eq!(cache.digest_of(&path).unwrap(), Digest::of(b"two"));
    }
}
