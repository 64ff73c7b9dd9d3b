//! Log files of programs: the command first, then all output.

use crate as files;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Lines that a message shows of a failed program.
const LAST_LINES: usize = 20;
/// Bytes that are read for these lines.
const LAST_BYTES: u64 = 1 << 14;
/// Bytes at the start of the output in which a version is looked for.
const MAX_VERSION_BYTES: u64 = 1 << 20;

/// Length of the log, bytes; 0 if it does not exist.
#[must_use]
pub fn length(log: &Path) -> u64 {
    std::fs::metadata(log).map_or(0, |about| about.len())
}

/// At most `limit` bytes of the log, from byte `from` on.
fn said(log: &Path, from: u64, limit: u64) -> String {
    let open = || {
        let mut file = files::open(log)?;
        file.seek(SeekFrom::Start(from))?;
        io::Result::Ok(file)
    };
    open().map(|file| read_text(file, limit)).unwrap_or_default()
}

/// At most `limit` bytes of the output of a program.
pub(super) fn read_text(from: impl Read, limit: u64) -> String {
    let mut bytes = Vec::new();
    // Text that was read before an error is still worth showing.
    let _ = from.take(limit).read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Returns true if the output of the command that begins at byte `from` contains this version, and
/// not only a longer one.
#[must_use]
pub fn says(log: &Path, from: u64, version: &str) -> bool {
    let text = said(log, from, MAX_VERSION_BYTES);
    // The first line is the command, which may contain the version itself.
    text.split_once('\n').is_some_and(|(_, said)| holds(said, version))
}

fn holds(said: &str, version: &str) -> bool {
    let digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
    said.match_indices(version).any(|(at, _)| {
        let (before, after) = (&said[..at], &said[at + version.len()..]);
        let mut before = before.chars().rev();
        // A dot belongs to a version number only with a digit on its other side: it may end a
        // sentence.
        let goes_before = match before.next() {
            Some('.') => digit(before.next()),
            c => digit(c),
        };
        let mut after = after.chars();
        let goes_after = match after.next() {
            Some('.') => digit(after.next()),
            c => digit(c),
        };
        !goes_before && !goes_after
    })
}

/// The last lines of the log after byte `from`. In a line that was overwritten, like a progress
/// bar, the last text counts.
#[must_use]
pub fn last_lines(log: &Path, from: u64) -> Vec<String> {
    files::open(log).map(|log| last_lines_in(log, from)).unwrap_or_default()
}

/// As [`last_lines`], of an open log.
#[must_use]
pub fn last_lines_in(mut log: File, from: u64) -> Vec<String> {
    // A log may be large, and its end is enough for a message.
    let length = log.metadata().map_or(0, |about| about.len());
    let from = from.max(length.saturating_sub(LAST_BYTES));
    let text = log.seek(SeekFrom::Start(from)).map(|_| read_text(log, LAST_BYTES)).unwrap_or_default();
    let shown = |line: &str| {
        let line = line.trim_end().rsplit('\r').next().unwrap_or_default();
        line.chars().filter(|c| *c == '\t' || !c.is_control()).collect::<String>()
    };
    let mut lines: Vec<String> =
        text.lines().rev().map(shown).filter(|line| !line.trim().is_empty()).take(LAST_LINES).collect();
    lines.reverse();
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_told_from_a_longer_one() {
        let t = |said: &str, version: &str, wanted: bool| assert_eq!(holds(said, version), wanted, "{said}");
        t("1.1.4", "1.1.4", true);
        t("opensplat v1.1.4 (git commit 1a2b3c)\n", "1.1.4", true);
        t("gsplat-1.1.4.", "1.1.4", true);
        t("1.1.45", "1.1.4", false);
        t("1.1.4.2", "1.1.4", false);
        t("11.1.4", "1.1.4", false);
        t("0.1.1.4", "1.1.4", false);
        t("1.1.45, not 1.1.4", "1.1.4", true);
        t("", "1.1.4", false);
    }
}
