//! Digests of files by their stat fields, so that a build without changes reads no files.
//!
//! A digest is reused only if device, inode, size, mtime and ctime all agree, and both times are
//! older than the observation by two seconds: a file as new as its entry may have changed within
//! the resolution of the clock. Programs cannot set the ctime, so an edit that restores the mtime
//! is noticed.

use super::Digest;
use super::fs::Stat;
use serde::{Deserialize, Serialize};
use std::time::{SystemTime, UNIX_EPOCH};

/// Stat fields and the time of their observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sighting {
    /// The fields.
    pub stat: Stat,
    /// Time of the observation, ns of the local clock; `SETTLED` if no older content can hide
    /// behind the fields.
    observed_ns: i64,
}

/// Marks a file that this program wrote itself under a new name.
const SETTLED: i64 = i64::MAX;

/// Age at observation, ns, below which the file may have changed since with the same fields.
const RACY_NS: i64 = 2_000_000_000;

impl Sighting {
    /// Observes fields now. Call it before the file is read.
    #[must_use]
    pub fn seen_now(stat: Stat) -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { stat, observed_ns: i64::try_from(since.as_nanos()).unwrap_or(i64::MAX - 1) }
    }

    /// Fields of a file that this program has just written or linked.
    pub(super) fn settled_file(stat: Stat) -> Self {
        Self { stat, observed_ns: SETTLED }
    }

    /// Whether equal fields at a later time mean equal bytes.
    #[must_use]
    pub fn is_firm(&self) -> bool {
        let oldest = self.observed_ns.saturating_sub(RACY_NS);
        self.observed_ns == SETTLED || (self.stat.mtime_ns < oldest && self.stat.ctime_ns < oldest)
    }

    /// Whether a file with the fields `now` still has its observed bytes.
    #[must_use]
    pub fn holds_for(&self, now: &Stat) -> bool {
        self.stat == *now && self.is_firm()
    }
}

/// The cached digest of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// The observation of the file.
    pub seen: Sighting,
    /// Digest of its bytes.
    pub digest: Digest,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stat(mtime_ns: i64, ctime_ns: i64) -> Stat {
        Stat { dev: 1, ino: 2, size: 3, mtime_ns, ctime_ns }
    }

    #[test]
    fn fields_hold_if_they_agree_and_were_old_when_seen() {
        let t = |seen: Sighting, now: Stat, holds: bool| {
            assert_eq!(seen.holds_for(&now), holds, "{seen:?} {now:?}")
        };
        let old = stat(0, 0);
        let seen = |stat: Stat, observed_ns: i64| Sighting { stat, observed_ns };
        t(seen(old, 2 * RACY_NS), old, true);
        t(seen(old, RACY_NS), old, false);
        t(seen(stat(0, RACY_NS), 2 * RACY_NS), stat(0, RACY_NS), false);
        t(seen(stat(RACY_NS, 0), 2 * RACY_NS), stat(RACY_NS, 0), false);
        t(Sighting::settled_file(stat(5, 5)), stat(5, 5), true);
        for moved in [
            Stat { dev: 9, ..old },
            Stat { ino: 9, ..old },
            Stat { size: 9, ..old },
            Stat { mtime_ns: 9, ..old },
            Stat { ctime_ns: 9, ..old },
        ] {
            t(seen(old, 2 * RACY_NS), moved, false);
            t(Sighting::settled_file(old), moved, false);
        }
    }
}
