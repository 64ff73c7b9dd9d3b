//! The exchange of a finished tree with the tree that it replaces, and the note for interrupted runs.

use super::FORMAT;
use crate::removal::remove_ours;
use crate::standing::StandingTree;
use gs2e_files as files;
use gs2e_files::{LinkRule, MAX_DOCUMENT};
use gs2e_release::checksum;
use gs2e_store::Digest;
use rustix::fs::{CWD, RenameFlags};
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File, Metadata};
use std::io::{self, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Content of the file `placing`.
pub(super) struct SwapNote {
    /// Device and inode of the folder that is to become the release.
    pub(super) tree: [u64; 2],
    /// The sound files of what stands at the target, by their paths.
    pub(super) sound: BTreeMap<String, Digest>,
}

impl SwapNote {
    /// The last line: without it the text was cut off, and the swap has not begun.
    const END: &str = "end\n";

    pub(super) fn before_swap(tree: &Path, stood: Option<&StandingTree>) -> io::Result<Self> {
        let sound = stood.map(|stood| stood.sums().map(|(path, sum)| (path.to_owned(), sum)).collect());
        Ok(Self { tree: identity(tree)?, sound: sound.unwrap_or_default() })
    }

    /// Device and inode on the first line, then one line per file with its BLAKE3 and its path.
    pub(super) fn text(&self) -> String {
        let [device, inode] = self.tree;
        let mut text = format!("{device} {inode}\n");
        for (path, sum) in &self.sound {
            writeln!(text, "{sum} {path}").expect("a String takes any text");
        }
        text + Self::END
    }

    fn parse(text: &str) -> Option<Self> {
        let mut lines = text.strip_suffix(Self::END)?.strip_suffix('\n')?.lines();
        let (device, inode) = lines.next()?.split_once(' ')?;
        let file = |line: &str| {
            let (sum, path) = line.split_once(' ')?;
            Some((path.to_owned(), sum.parse().ok()?))
        };
        let sound = lines.map(file).collect::<Option<_>>()?;
        Some(Self { tree: [device.parse().ok()?, inode.parse().ok()?], sound })
    }

    /// Reads the file; `None` if the swap has not begun.
    pub(super) fn read(path: &Path) -> io::Result<Option<Self>> {
        match files::read_with(path, LinkRule::Refuse, MAX_DOCUMENT) {
            // A text that was cut off means the same as no text, since it is on disk before the
            // swap.
            Ok(bytes) => Ok(str::from_utf8(&bytes).ok().and_then(Self::parse)),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// Returns true if this folder is the new release, which has not been put in place.
    pub(super) fn is_the_new(&self, folder: &Path) -> io::Result<bool> {
        Ok(identity(folder)? == self.tree)
    }

    /// Removes the sound files at `folder` and returns true if the folder is gone.
    pub(super) fn remove_at(&self, folder: &Path, cancel: &AtomicBool) -> io::Result<bool> {
        let is_ours = |path: &str, _: &Metadata| {
            // The user may have changed the file since the swap, so its bytes decide.
            let hashed =
                || checksum::hash_file(&folder.join(path)).is_ok_and(|it| it.blake3 == self.sound[path]);
            self.sound.contains_key(path) && !cancel.load(Ordering::Relaxed) && hashed()
        };
        let gone = remove_ours(folder, self.sound.keys().map(String::as_str), &is_ours)?;
        // Once cancelled, sound files stay as well and must not be taken for files of the user.
        if cancel.load(Ordering::Relaxed) { Err(io::ErrorKind::Interrupted.into()) } else { Ok(gone) }
    }
}

/// Device and inode of a folder, which a rename keeps.
pub(super) fn identity(folder: &Path) -> io::Result<[u64; 2]> {
    let about = fs::symlink_metadata(folder)?;
    Ok([about.dev(), about.ino()])
}

/// The text of `about`: the format, then one line per file with its largest size and its path.
pub(super) fn listing(files: &BTreeMap<String, u64>) -> String {
    files.iter().fold(FORMAT.to_owned(), |mut text, (path, size)| {
        writeln!(text, "{size} {path}").expect("a String takes any text");
        text
    })
}

/// The files that an `about` lists; `None` if this program did not write it. One that was cut off
/// while it was written lists fewer files, and then none of the files exists yet.
pub(super) fn parse_listing(text: &str) -> Option<BTreeMap<String, u64>> {
    let Some(lines) = text.strip_prefix(FORMAT) else {
        // The text was cut off within its first line.
        return FORMAT.starts_with(text).then(BTreeMap::new);
    };
    let line = |line: &str| {
        let (size, path) = line.split_once(' ')?;
        Some((path.to_owned(), size.parse().ok()?))
    };
    Some(lines.lines().map_while(line).collect())
}

/// Writes a new file and syncs it to disk.
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Moves a folder to a name that must be free.
pub(super) fn move_to_free(from: &Path, to: &Path) -> io::Result<()> {
    match rustix::fs::renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        // A rename of a folder replaces nothing but an empty folder.
        Err(e) if is_unsupported(e) => fs::rename(from, to),
        other => other.map_err(io::Error::from),
    }
}

/// Swaps `tree` with `target`, so that what stood at the target is at `old`. Where the file system
/// cannot swap in one step, the old one is moved first, and moved back if the second step fails.
pub(super) fn exchange(tree: &Path, target: &Path, old: &Path) -> io::Result<()> {
    match rustix::fs::renameat_with(CWD, tree, CWD, target, RenameFlags::EXCHANGE) {
        // If this rename does not happen, `clear` finds the old folder at `tree` by its inode.
        Ok(()) => fs::rename(tree, old),
        Err(e) if is_unsupported(e) => {
            fs::rename(target, old)?;
            move_to_free(tree, target).inspect_err(|_| {
                // If this fails too, the next release to this target moves it back.
                let _ = move_to_free(old, target);
            })
        }
        Err(e) => Err(e.into()),
    }
}

fn is_unsupported(error: Errno) -> bool {
    [Errno::INVAL, Errno::NOSYS, Errno::NOTSUP, Errno::OPNOTSUPP].contains(&error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_about_that_was_cut_off_is_known() {
        let whole = listing(&[("a".to_owned(), 1), ("b".to_owned(), 22)].into());
        for n in 0..=whole.len() {
            assert!(parse_listing(&whole[..n]).is_some(), "cut at {n}");
        }
        assert_eq!(parse_listing("thesis"), None);
    }

    #[test]
    fn a_list_that_was_cut_off_is_none() {
        let sound =
            [("end".to_owned(), Digest::of_bytes(b"")), ("x y".to_owned(), Digest::of_bytes(b"1"))].into();
        let text = SwapNote { tree: [1, 2], sound }.text();
        assert!((0..text.len()).all(|n| SwapNote::parse(&text[..n]).is_none()));
        assert_eq!(SwapNote::parse(&text).unwrap().text(), text);
    }
}
