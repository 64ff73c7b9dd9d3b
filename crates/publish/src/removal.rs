//! Removal of files that this program wrote, and of nothing else.

use gs2e_files as files;
use gs2e_files::Removal;
use std::collections::BTreeSet;
use std::fs::{self, Metadata};
use std::io;
use std::path::Path;
use walkdir::WalkDir;

/// Removes the regular files below `root` for which `is_ours` is true, then the folders of `paths`
/// and `root` if nothing is left in them. Links are not followed. Returns true if `root` is gone.
///
/// # Errors
/// A folder cannot be listed, or a file or folder cannot be removed.
pub(super) fn remove_ours<'a>(
    root: &Path,
    paths: impl Iterator<Item = &'a str>,
    is_ours: &dyn Fn(&str, &Metadata) -> bool,
) -> io::Result<bool> {
    let folders: BTreeSet<&Path> = paths.flat_map(|path| Path::new(path).ancestors().skip(1)).collect();
    // Sorted, so that each folder is listed in full before anything in it goes.
    for entry in WalkDir::new(root).contents_first(true).sort_by_file_name() {
        let entry = entry?;
        let below = entry.path().strip_prefix(root).expect("a walk stays below its root");
        if entry.file_type().is_dir() {
            // Empty folders of the user stay: only those that can have held a listed file go.
            if folders.contains(below) || below.as_os_str().is_empty() {
                remove_if_empty(entry.path())?;
            }
        } else if entry.file_type().is_file()
            && let Some(path) = below.to_str()
            && is_ours(path, &entry.metadata()?)
        {
            files::remove_below(root, below, Removal::File)?;
        }
    }
    Ok(!is_there(root))
}

/// Removes a folder, unless something is in it.
pub(super) fn remove_if_empty(folder: &Path) -> io::Result<()> {
    match files::remove(folder, Removal::EmptyFolder) {
        Err(e) if e.kind() == io::ErrorKind::DirectoryNotEmpty => Ok(()),
        other => other,
    }
}

/// Returns true if anything lies at `path`, including a link to nothing.
pub(super) fn is_there(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn what_is_not_ours_stays_with_its_folders() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().join("root");
        let ours = ["a/b/one", "a/two", "c/three", "d/four"];
        for path in ours.iter().chain(&["a/b/thesis"]) {
            fs::create_dir_all(root.join(path).parent().unwrap()).unwrap();
            fs::write(root.join(path), path).unwrap();
        }
        fs::create_dir(root.join("empty")).unwrap();
        // A folder that was replaced by a link leads out of the tree.
        fs::rename(root.join("d"), place.path().join("outside")).unwrap();
        symlink("../outside", root.join("d")).unwrap();
        let is_ours = |path: &str, _: &Metadata| ours.contains(&path);
        assert!(!remove_ours(&root, ours.iter().copied(), &is_ours).unwrap());
        let left = WalkDir::new(&root)
            .sort_by_file_name()
            .into_iter()
            .map(|entry| entry.unwrap().path().strip_prefix(&root).unwrap().to_str().unwrap().to_owned());
        assert_eq!(left.collect::<Vec<_>>(), ["", "a", "a/b", "a/b/thesis", "d", "empty"]);
        assert!(place.path().join("outside/four").exists());
    }
}
