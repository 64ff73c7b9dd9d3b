//! The only place where the program deletes anything. `tests/it/tidy/removal.rs` lists the callers.
//!
//! Names are resolved below a folder, and links on the way are refused. A folder that someone else swaps for
//! a link meanwhile therefore leads nowhere.

use super::{folder_below, invalid, type_at};
use crate::rename::parent_folder;
use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags, unlinkat};
use std::ffi::OsStr;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

/// The kind of thing to remove.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removal {
    /// A file or a link. A link is removed itself.
    File,
    /// A folder without content.
    EmptyFolder,
    /// A file, a link, or a folder with its content. Links in it are removed, and not followed.
    Tree,
}

/// Removes a file or folder. Links in the folders before the last name are followed.
///
/// # Errors
/// The same as [`remove_below`].
pub fn remove(path: &Path, what: Removal) -> io::Result<()> {
    let name = path.file_name().ok_or_else(|| invalid("the path has no last name"))?;
    remove_below(parent_folder(path), Path::new(name), what)
}

/// Removes a file or folder below a folder. `below` is relative to `root`.
///
/// # Errors
/// `NotFound` if it does not exist; `InvalidInput` if a part of `below` is `..`, or a part before the last
/// one is a link; any other error of the file system, for example for a folder that is not empty.
pub fn remove_below(root: &Path, below: &Path, what: Removal) -> io::Result<()> {
    let (folder, name) = folder_below(root, below)?;
    match what {
        Removal::File => unlinkat(&folder, name, AtFlags::empty())?,
        Removal::EmptyFolder => unlinkat(&folder, name, AtFlags::REMOVEDIR)?,
        Removal::Tree => remove_tree(folder.as_fd(), name)?,
    }
    Ok(())
}

/// Removes a file or a link in an open folder.
pub(super) fn remove_file_at(folder: impl AsFd, name: &str) -> io::Result<()> {
    Ok(unlinkat(folder, name, AtFlags::empty())?)
}

fn remove_tree(folder: BorrowedFd<'_>, name: &OsStr) -> io::Result<()> {
    // The type of the entry itself: a link to a folder is removed as a link.
    if type_at(folder, Path::new(name))? != FileType::Directory {
        return Ok(unlinkat(folder, name, AtFlags::empty())?);
    }
    // `NOFOLLOW` refuses a link that took the folder's place after its type was read.
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let inner = rustix::fs::openat(folder, name, flags, Mode::empty())?;
    for entry in Dir::read_from(&inner)? {
        let entry = entry?;
        let name = OsStr::from_bytes(entry.file_name().to_bytes());
        if name == "." || name == ".." {
            continue;
        }
        match remove_tree(inner.as_fd(), name) {
            // Another process removes the same folder.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            removed => removed?,
        }
    }
    Ok(unlinkat(folder, name, AtFlags::REMOVEDIR)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::ErrorKind;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_tree_is_removed_and_the_targets_of_its_links_stay() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::create_dir_all(at("tree/deep/er")).unwrap();
        fs::create_dir(at("outside")).unwrap();
        fs::write(at("outside/thesis"), "mine").unwrap();
        fs::write(at("tree/deep/file"), "ours").unwrap();
        symlink(at("outside"), at("tree/deep/link")).unwrap();
        remove(&at("tree"), Removal::Tree).unwrap();
        assert!(!at("tree").exists());
        assert_eq!(fs::read_to_string(at("outside/thesis")).unwrap(), "mine");
    }

    #[test]
    fn links_on_the_way_are_refused_and_last_ones_removed() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        fs::create_dir_all(at("outside/folder")).unwrap();
        fs::create_dir(at("root")).unwrap();
        symlink("../outside", at("root/link")).unwrap();
        let t = |below: &str, what| remove_below(&at("root"), Path::new(below), what).unwrap_err().kind();
        assert_eq!(t("link/folder", Removal::Tree), ErrorKind::InvalidInput);
        assert_eq!(t("../outside", Removal::Tree), ErrorKind::InvalidInput);
        assert_eq!(t("", Removal::Tree), ErrorKind::InvalidInput);
        assert_eq!(t("absent", Removal::Tree), ErrorKind::NotFound);
        assert!(at("outside/folder").is_dir());
        remove_below(&at("root"), Path::new("link"), Removal::Tree).unwrap();
        assert!(at("outside/folder").is_dir() && !at("root/link").is_symlink());
    }

    #[test]
    fn a_folder_is_not_removed_as_a_file_and_a_full_one_not_as_an_empty_one() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("folder");
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("file"), "").unwrap();
        assert_eq!(remove(&folder, Removal::File).unwrap_err().kind(), ErrorKind::IsADirectory);
        assert_eq!(remove(&folder, Removal::EmptyFolder).unwrap_err().kind(), ErrorKind::DirectoryNotEmpty);
        remove(&folder.join("file"), Removal::File).unwrap();
        remove(&folder, Removal::EmptyFolder).unwrap();
        assert!(!folder.exists());
    }
}
