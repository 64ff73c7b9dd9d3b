//! The files of a release in memory: paths, with the sources of their bytes.

use super::manifest::ManifestFile;
use gs2e_store::Digest;
use gs2e_tree::ListedFile;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Source of a file's bytes.
#[derive(Debug)]
pub enum FileContent {
    /// Bytes made for the release.
    Bytes(Vec<u8>),
    /// A blob of the store.
    Blob {
        /// Its file.
        path: PathBuf,
        /// Its name in the store.
        digest: Digest,
        /// Bytes.
        size: u64,
    },
}

impl FileContent {
    /// A JSON document: indented, with a final newline.
    pub fn json<T: serde::Serialize>(value: &T) -> Self {
        Self::Bytes(Self::json_bytes(value))
    }

    /// The bytes of a JSON document.
    pub fn json_bytes<T: serde::Serialize>(value: &T) -> Vec<u8> {
        let mut bytes = serde_json::to_vec_pretty(value).expect("release files are plain data");
        bytes.push(b'\n');
        bytes
    }
}

/// Files by path, `/`-separated, below the release folder.
#[derive(Debug, Default)]
pub struct ReleaseTree {
    files: BTreeMap<String, FileContent>,
}

impl ReleaseTree {
    /// Adds a file. Its path is new, because recipes are refused if two scenes would write the same
    /// path.
    pub fn add(&mut self, path: String, content: FileContent) {
        let before = self.files.insert(path, content);
        assert!(before.is_none(), "scene ids and trajectory names do not clash in valid recipes");
    }

    /// Adds the files of another tree.
    pub fn extend(&mut self, other: Self) {
        other.files.into_iter().for_each(|(path, content)| self.add(path, content));
    }

    /// The paths, sorted.
    pub(super) fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    /// The paths with their contents, sorted.
    pub fn contents(&self) -> impl Iterator<Item = (&str, &FileContent)> {
        self.files.iter().map(|(path, content)| (path.as_str(), content))
    }

    /// The same, for several threads.
    pub fn par_contents(&self) -> impl ParallelIterator<Item = (&str, &FileContent)> {
        self.files.par_iter().map(|(path, content)| (path.as_str(), content))
    }

    /// The content of the file at a path.
    pub fn content(&self, path: &str) -> Option<&FileContent> {
        self.files.get(path)
    }

    /// The file in the store with the content of a file of the tree.
    pub fn place(&self, path: &str) -> Option<&Path> {
        match self.files.get(path)? {
            FileContent::Blob { path, .. } => Some(path),
            FileContent::Bytes(_) => None,
        }
    }

    /// The files as readers of releases take them.
    pub fn listed(&self) -> BTreeMap<String, ListedFile> {
        let file = |content: &FileContent| match content {
            FileContent::Bytes(bytes) => ListedFile::Bytes(bytes.clone()),
            FileContent::Blob { path, .. } => ListedFile::Stored(path.clone()),
        };
        self.files.iter().map(|(path, content)| (path.clone(), file(content))).collect()
    }

    /// The files with their contents, sorted by path.
    pub fn into_files(self) -> BTreeMap<String, FileContent> {
        self.files
    }

    /// The files with sizes and digests, sorted by path.
    pub fn listing(&self) -> Vec<ManifestFile> {
        let list = self.files.iter().map(|(path, content)| {
            let (size, blake3) = match content {
                FileContent::Bytes(bytes) => (bytes.len() as u64, Digest::of_bytes(bytes)),
                FileContent::Blob { digest, size, .. } => (*size, *digest),
            };
            ManifestFile { path: path.clone(), size, blake3 }
        });
        list.collect()
    }
}
