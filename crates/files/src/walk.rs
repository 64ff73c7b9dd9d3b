//! Walks through folders, limited to one file system, a maximum depth and a maximum number of
//! entries.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use super::PathError;
use walkdir::{DirEntry, WalkDir};

/// Deepest entry of a walk, counted from its root.
pub const MAX_DEPTH: usize = 32;

/// Maximum entries of a walk: a path like `/` ends in an error, not in a scan of the machine.
pub const MAX_ENTRIES: usize = 1 << 20;

/// A walk through a folder, in the order of file names.
#[derive(Debug, Clone, Copy)]
pub struct FolderWalk<'a> {
    root: &'a Path,
    follows: bool,
    depth: usize,
}

impl<'a> FolderWalk<'a> {
    /// A walk through `root` that lists links and follows none.
    #[must_use]
    pub fn new(root: &'a Path) -> Self {
        Self { root, follows: false, depth: usize::MAX }
    }

    /// Follows links that stay inside its root, and links to files wherever they lie.
    #[must_use]
    pub fn following(self) -> Self {
        Self { follows: true, ..self }
    }

    /// Limits the walk to `depth` below its root.
    #[must_use]
    pub fn to_depth(self, depth: usize) -> Self {
        Self { depth, ..self }
    }

    /// The entries for which `keep` returns true, including the root. Nothing below a folder that
    /// is not kept is listed.
    ///
    /// # Errors
    /// Entries that cannot be read; folders on another file system, deeper than [`MAX_DEPTH`], or
    /// behind a link that leads out of the root; and the end of the walk after [`MAX_ENTRIES`].
    pub fn entries(
        self,
        keep: impl FnMut(&DirEntry) -> bool,
    ) -> impl Iterator<Item = Result<DirEntry, PathError>> {
        let bounds = WalkBounds::of(self.root);
        // File systems list entries in any order. Sorting makes everything that follows
        // reproducible.
        let walk = WalkDir::new(self.root).follow_links(self.follows).max_depth(self.depth);
        let mut walk = walk.sort_by_file_name().into_iter().filter_entry(keep);
        let mut left = MAX_ENTRIES;
        let root = self.root.to_owned();
        std::iter::from_fn(move || {
            // After the error below, the walk has ended: a caller that skips errors must not go on for ever.
            if left == 0 {
                return None;
            }
            let entry = match walk.next()? {
                Ok(entry) => entry,
                Err(error) => return Some(Err(unwalkable(&error, &root))),
            };
            left -= 1;
            if left == 0 {
                let because = io::Error::other(format!("more than {MAX_ENTRIES} entries"));
                return Some(Err(PathError::new(&root, because)));
            }
            let Err(because) = bounds.hold(&entry) else { return Some(Ok(entry)) };
            // Only folders are refused, so this skips the content of the entry and not its
            // siblings.
            walk.skip_current_dir();
            Some(Err(PathError::new(entry.into_path(), because)))
        })
    }
}

fn unwalkable(error: &walkdir::Error, root: &Path) -> PathError {
    let because = match error.io_error() {
        Some(error) => io::Error::new(error.kind(), error.to_string()),
        // Without an I/O error, the walk has found a loop.
        None => io::Error::other("a link leads back to its own folder"),
    };
    PathError::new(error.path().unwrap_or(root), because)
}

/// The bounds that the root of a walk sets.
struct WalkBounds {
    /// The file system of the root; `None` if the root cannot be read, which the walk itself
    /// reports.
    device: Option<u64>,
    root: Option<PathBuf>,
}

impl WalkBounds {
    fn of(root: &Path) -> Self {
        Self { device: fs::metadata(root).ok().map(|about| about.dev()), root: root.canonicalize().ok() }
    }

    /// Checks a folder against the bounds. Files need no check here: they are opened by functions
    /// of [`crate`].
    fn hold(&self, entry: &DirEntry) -> io::Result<()> {
        // The user named the root, so it may be a link.
        if !entry.file_type().is_dir() || entry.depth() == 0 {
            return Ok(());
        }
        if entry.depth() > MAX_DEPTH {
            return Err(io::Error::other(format!("more than {MAX_DEPTH} folders deep")));
        }
        if entry.path_is_symlink() && !self.holds_target(entry.path())? {
            return Err(io::Error::other("a link leads out of the given folder"));
        }
        if self.device.is_some_and(|device| device != device_of(entry)) {
            return Err(io::Error::other("a folder on another file system"));
        }
        Ok(())
    }

    fn holds_target(&self, link: &Path) -> io::Result<bool> {
        let target = link.canonicalize()?;
        Ok(self.root.as_ref().is_some_and(|root| target.starts_with(root)))
    }
}

/// The device of a folder; 0, which is no valid device, if it cannot be read.
fn device_of(entry: &DirEntry) -> u64 {
    entry.metadata().map_or(0, |about| about.dev())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    fn names(walk: FolderWalk<'_>) -> Vec<String> {
        let shown = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        walk.entries(|_| true)
            .map(|entry| match entry {
                Ok(entry) => shown(entry.path()),
                Err(error) => format!("{}: {}", shown(&error.path), error.source),
            })
            .skip(1)
            .collect()
    }

    #[test]
    fn links_are_followed_where_the_walk_says_so_and_never_to_a_folder_outside() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("root");
        fs::create_dir_all(root.join("b/sub")).unwrap();
        fs::create_dir(folder.path().join("outside")).unwrap();
        fs::write(folder.path().join("outside/file"), "").unwrap();
        fs::write(root.join("b/sub/deep"), "").unwrap();
        symlink("../outside", root.join("a-out")).unwrap();
        symlink("../outside/file", root.join("c-file")).unwrap();
        symlink("b/sub", root.join("d-in")).unwrap();
        assert_eq!(names(FolderWalk::new(&root)), ["a-out", "b", "sub", "deep", "c-file", "d-in"]);
        assert_eq!(names(FolderWalk::new(&root).to_depth(1)), ["a-out", "b", "c-file", "d-in"]);
        assert_eq!(
            names(FolderWalk::new(&root).following()),
            ["a-out: a link leads out of the given folder", "b", "sub", "deep", "c-file", "d-in", "deep"]
        );
        symlink("..", root.join("b/sub/up")).unwrap();
        let message = names(FolderWalk::new(&root).following());
        assert!(message.contains(&"up: a link leads back to its own folder".to_owned()), "{message:?}");
    }

    #[test]
    fn a_walk_ends_at_its_depth() {
        let folder = tempfile::tempdir().unwrap();
        let deep: PathBuf = (0..=MAX_DEPTH + 3).map(|_| "d").collect();
        fs::create_dir_all(folder.path().join(deep)).unwrap();
        let found = names(FolderWalk::new(folder.path()));
        assert_eq!(found.len(), MAX_DEPTH + 1);
        assert_eq!(found[MAX_DEPTH], "d: more than 32 folders deep");
    }

    #[test]
    fn another_file_system_is_not_walked() {
        let Ok(root) = fs::metadata("/") else { return };
        let other = fs::metadata("/proc").is_ok_and(|about| about.dev() != root.dev());
        if other {
            let found: Vec<String> = names(FolderWalk::new(Path::new("/")).to_depth(1));
            assert!(found.contains(&"proc: a folder on another file system".to_owned()), "{found:?}");
        }
    }
}
