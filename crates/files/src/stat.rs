//! Stat fields of files, by which a build without changes reads no files.
//!
//! Equal fields mean equal bytes only if device, inode, size, mtime and ctime all agree, and both times are
//! older than the observation by two seconds: a file as new as its entry may have changed within
//! the resolution of the clock. Programs cannot set the ctime, so an edit that restores the mtime
//! is noticed.

use serde::{Deserialize, Serialize};
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::time::{SystemTime, UNIX_EPOCH};

/// The stat fields of a file at one moment. Two equal values for one path mean that the file was
/// not written in between, within the resolution of the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStat {
    /// Device.
    pub dev: u64,
    /// Inode.
    pub ino: u64,
    /// Length in bytes.
    pub size: u64,
    /// Last change of the bytes, ns since the epoch.
    pub mtime_ns: i64,
    /// Last change of the bytes or of the inode, ns since the epoch. Programs cannot set it.
    pub ctime_ns: i64,
}

impl From<&fs::Metadata> for FileStat {
    fn from(m: &fs::Metadata) -> Self {
        let ns = |s: i64, n: i64| s.saturating_mul(1_000_000_000).saturating_add(n);
        Self {
            dev: m.dev(),
            ino: m.ino(),
            size: m.size(),
            mtime_ns: ns(m.mtime(), m.mtime_nsec()),
            ctime_ns: ns(m.ctime(), m.ctime_nsec()),
        }
    }
}

/// Stat fields and the time of their observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatSighting {
    /// The fields.
    pub stat: FileStat,
    /// Time of the observation, ns of the local clock; `SETTLED` if no older content can hide
    /// behind the fields.
    observed_ns: i64,
}

/// Marks a file that this program wrote itself under a new name.
const SETTLED: i64 = i64::MAX;

/// Age at observation, ns, below which the file may have changed since with the same fields.
const RACY_NS: i64 = 2_000_000_000;

impl StatSighting {
    /// Observes fields now. Call it before the file is read.
    #[must_use]
    pub fn observed_now(stat: FileStat) -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // The largest number is `SETTLED`, which no clock may reach.
        Self { stat, observed_ns: i64::try_from(since.as_nanos()).unwrap_or(i64::MAX - 1) }
    }

    /// Fields of a file that this program has just written or linked.
    pub fn settled_file(stat: FileStat) -> Self {
        Self { stat, observed_ns: SETTLED }
    }

    /// Returns true if equal fields at a later time mean equal bytes.
    #[must_use]
    pub fn is_firm(&self) -> bool {
        let oldest = self.observed_ns.saturating_sub(RACY_NS);
        self.observed_ns == SETTLED || (self.stat.mtime_ns < oldest && self.stat.ctime_ns < oldest)
    }

    /// Returns true if a file with the fields `now` still has its observed bytes.
    #[must_use]
    pub fn holds_for(&self, now: &FileStat) -> bool {
        // Equal fields are not enough: a file that was young when seen may have other bytes by now.
        self.stat == *now && self.is_firm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stat(mtime_ns: i64, ctime_ns: i64) -> FileStat {
        FileStat { dev: 1, ino: 2, size: 3, mtime_ns, ctime_ns }
    }

    #[test]
    fn fields_hold_if_they_agree_and_were_old_when_seen() {
        let t = |sighting: StatSighting, now: FileStat, holds: bool| {
            assert_eq!(sighting.holds_for(&now), holds, "{sighting:?} {now:?}")
        };
        let old = stat(0, 0);
        let seen = |stat: FileStat, observed_ns: i64| StatSighting { stat, observed_ns };
        t(seen(old, 2 * RACY_NS), old, true);
        t(seen(old, RACY_NS), old, false);
        t(seen(stat(0, RACY_NS), 2 * RACY_NS), stat(0, RACY_NS), false);
        t(seen(stat(RACY_NS, 0), 2 * RACY_NS), stat(RACY_NS, 0), false);
        t(StatSighting::settled_file(stat(5, 5)), stat(5, 5), true);
        for moved in [
            FileStat { dev: 9, ..old },
            FileStat { ino: 9, ..old },
            FileStat { size: 9, ..old },
            FileStat { mtime_ns: 9, ..old },
            FileStat { ctime_ns: 9, ..old },
        ] {
            t(seen(old, 2 * RACY_NS), moved, false);
            t(StatSighting::settled_file(old), moved, false);
        }
    }
}
