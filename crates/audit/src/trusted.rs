//! The files of a tree that have the bytes of its sums.

use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_tree::ReleaseFiles;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::Bound;
use std::path::{Path, PathBuf};

/// The part of a tree that is known to be what was released.
#[derive(Debug)]
pub(super) struct TrustedTree<'a> {
    pub(super) dir: &'a Path,
    /// Files with the bytes that the sums state, and their SHA-256.
    pub(super) intact: BTreeMap<&'a str, &'a str>,
    /// Pictures whose files are known to be what this program writes for them.
    pub(super) composed: &'a BTreeSet<String>,
}

impl ReleaseFiles for &TrustedTree<'_> {
    fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>> {
        files::read_with(&self.place(path)?, LinkRule::Refuse, limit)
    }

    fn place(&self, path: &str) -> io::Result<PathBuf> {
        self.intact_path(path).ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn has(&self, path: &str) -> io::Result<bool> {
        Ok(self.intact.contains_key(path))
    }
}

impl TrustedTree<'_> {
    pub(super) fn has(&self, path: &str) -> bool {
        self.intact.contains_key(path)
    }

    /// Path of a file on disk, if the file is intact.
    pub(super) fn intact_path(&self, path: &str) -> Option<PathBuf> {
        self.has(path).then(|| self.path_of(path))
    }

    /// The intact files whose paths start with a prefix, sorted.
    pub(super) fn below<'t>(&'t self, prefix: &'t str) -> impl Iterator<Item = &'t str> {
        let from = self.intact.range::<str, _>((Bound::Included(prefix), Bound::Unbounded));
        from.map(|(path, _)| *path).take_while(move |path| path.starts_with(prefix))
    }

    /// Path of a file on disk, whether the file is intact or not.
    pub(super) fn path_of(&self, path: &str) -> PathBuf {
        self.dir.join(path)
    }
}
