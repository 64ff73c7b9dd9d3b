//! Listing of the tree.

use super::{AuditFault, FaultCode};
use std::collections::BTreeSet;
use std::io;
use std::path::Path;
use walkdir::WalkDir;

/// The files of the tree, and entries that have no place in a release.
#[derive(Debug)]
pub(super) struct TreeListing {
    /// Paths of regular files, `/`-separated.
    pub(super) files: BTreeSet<String>,
    /// Links, special files, empty folders, and names that are not UTF-8.
    pub(super) oddities: Vec<AuditFault>,
}

/// Lists the tree below `dir`.
pub(super) fn walk_tree(dir: &Path) -> io::Result<TreeListing> {
    let mut listing = TreeListing { files: BTreeSet::new(), oddities: Vec::new() };
    // The walk follows no links, so it does not leave the tree.
    for entry in WalkDir::new(dir).min_depth(1).sort_by_file_name() {
        let entry = entry?;
        let below = entry.path().strip_prefix(dir).expect("a walk stays below its root");
        let mut odd = |what: &str| {
            listing.oddities.push(AuditFault::of_file(FaultCode::Unlisted, &below.to_string_lossy(), what));
        };
        let kind = entry.file_type();
        match below.to_str() {
            None => odd("its name is not UTF-8 text"),
            Some(_) if kind.is_symlink() => odd("it is a link; releases hold files and folders only"),
            Some(_) if kind.is_dir() => {
                // The sums list files only and would not notice an empty folder.
                if entry.path().read_dir()?.next().is_none() {
                    odd("it is an empty folder");
                }
            }
            Some(path) if kind.is_file() => {
                listing.files.insert(path.to_owned());
            }
            Some(_) => odd("it is neither a file nor a folder"),
        }
    }
    Ok(listing)
}

/// The reason why a path has no place in a release; `None` if it may stay.
pub(super) fn unsafe_because(path: &str) -> Option<&'static str> {
    if path.starts_with('/') {
        Some("it is absolute")
    } else if path.split('/').any(|part| part == "..") {
        Some("it leads out of its folder")
    } else if path.split('/').any(|part| part.is_empty() || part == ".") {
        Some("it has an empty part")
    } else if path.contains(|c: char| c.is_control() || c == '\\') {
        // Sums have one line per path, and some systems take a backslash for a separator.
        Some("it holds a control character or a backslash")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_lead_astray_are_unsafe() {
        for path in ["/etc/passwd", "../x", "a/../b", "a//b", "./a", "a/", "", "a\\b", "a\nb"] {
            assert!(unsafe_because(path).is_some(), "{path:?}");
        }
        for path in ["a", "a/b.c", "sharp/000000.png", "..a/b..", "é/日本"] {
            assert_eq!(unsafe_because(path), None, "{path:?}");
        }
    }
}
