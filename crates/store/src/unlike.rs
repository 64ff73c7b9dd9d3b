//! Different bytes for one key: both records, and the first difference of their files.

use super::Digest;
use super::record::{StepRecord, content_digest};
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// The outputs of a key before and now.
#[derive(Debug)]
pub struct OutputMismatch {
    /// The recorded outputs.
    pub before: StepRecord,
    /// The outputs made now.
    pub now: StepRecord,
    /// True if the first bytes were lost and replaced by these.
    pub replaced: bool,
    /// The first file that differs, and the offset, as far as its bytes can be read.
    pub first: Option<String>,
}

impl fmt::Display for OutputMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [before, now] = [&self.before, &self.now].map(|record| content_digest(&record.outputs));
        write!(f, "key {} produced {before} before and {now} now", self.now.key)
    }
}

/// The first file, by name, that one side lacks or has with other bytes. The earlier files are at
/// `path_of`, the new ones in `workspace`.
pub(super) fn first_difference(
    before: &StepRecord,
    now: &StepRecord,
    path_of: &dyn Fn(&Digest) -> PathBuf,
    workspace: &Path,
) -> Option<String> {
    let find = |record: &StepRecord, name: &str| {
        record.outputs.iter().find(|output| output.name == name).map(|output| output.digest)
    };
    let mut names: Vec<&str> = before.outputs.iter().chain(&now.outputs).map(|o| o.name.as_str()).collect();
    names.sort_unstable();
    let name = names.into_iter().find(|name| find(before, name) != find(now, name))?;
    Some(match (find(before, name), find(now, name)) {
        (Some(before), Some(_)) => match first_offset(&path_of(&before), &workspace.join(name)) {
            Ok(offset) => format!("{name} at byte {offset}"),
            Err(e) => format!("{name}, at an unknown byte: {e}"),
        },
        (Some(_), None) => format!("{name}, missing now"),
        _ => format!("{name}, missing before"),
    })
}

/// The offset of the first different byte, or the length of the shorter file if it is the beginning
/// of the other.
fn first_offset(before: &Path, now: &Path) -> io::Result<u64> {
    let open = |path: &Path| File::open(path).map(|file| BufReader::new(file).bytes());
    let [mut before, mut now] = [open(before)?, open(now)?];
    let mut offset = 0;
    loop {
        match (before.next().transpose()?, now.next().transpose()?) {
            (Some(a), Some(b)) if a == b => offset += 1,
            _ => return Ok(offset),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Key;
    use crate::record::{StepProvenance, StoredOutput};

    #[test]
    fn the_first_difference_is_told_by_file_and_byte() {
        let folder = tempfile::tempdir().unwrap();
        let record = |files: &[(&str, &str)]| {
            let key = Key(Digest::of_bytes(b"key"));
            let mut record = StepRecord::new(key, "test", Vec::new(), StepProvenance::default());
            for (name, text) in files {
                let digest = Digest::of_bytes(text.as_bytes());
                std::fs::write(folder.path().join(digest.to_string()), text).unwrap();
                std::fs::write(folder.path().join(name), text).unwrap();
                record.outputs.push(StoredOutput { name: (*name).into(), digest, size: text.len() as u64 });
            }
            record
        };
        let path_of = |digest: &Digest| folder.path().join(digest.to_string());
        let t = |before: &[(&str, &str)], now: &[(&str, &str)], wanted: Option<&str>| {
            // The new files are named last.
            let (before, now) = (record(before), record(now));
            let found = first_difference(&before, &now, &path_of, folder.path());
            assert_eq!(found.as_deref(), wanted);
        };
        t(&[("a", "one"), ("b", "two")], &[("a", "one"), ("b", "twin")], Some("b at byte 2"));
        t(&[("a", "one")], &[("a", "one more")], Some("a at byte 3"));
        t(&[("a", "one"), ("b", "x")], &[("a", "one")], Some("b, missing now"));
        t(&[("b", "x")], &[("a", "one"), ("b", "x")], Some("a, missing before"));
        t(&[("a", "one")], &[("a", "one")], None);
    }
}
