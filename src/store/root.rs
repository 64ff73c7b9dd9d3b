//! Roots: what stays in the store although no recipe asks for it any more. One file a release, in `roots/`.

use super::disk::failed;
use super::{Digest, Key, Store, StoreError};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A release and the steps that it was made from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Root {
    /// Its folder, absolute.
    pub release: PathBuf,
    /// The keys of its steps.
    pub keys: Vec<Key>,
}

const FOLDER: &str = "roots";

impl Store {
    /// Keeps what a release was made from, in place of what was kept for that folder before.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_root(&self, root: &Root) -> Result<(), StoreError> {
        let path = self.path_of_root(root);
        // A folder whose name is not UTF-8 has no place in JSON.
        let bytes = serde_json::to_vec(root).map_err(|e| failed("writing", &path)(e.into()))?;
        self.disk.create_dir(&self.root.join(FOLDER))?;
        self.disk.write_atomically(&path, &self.blobs.fresh("tmp"), &bytes)
    }

    /// The roots, sorted by the names of their files.
    ///
    /// # Errors
    /// When one cannot be read: what it keeps is not known then.
    pub fn roots(&self) -> Result<Vec<Root>, StoreError> {
        let mut roots = Vec::new();
        for (_, path) in self.files_of(FOLDER)? {
            let Some(bytes) = self.disk.read_optional(&path)? else { continue };
            let root = serde_json::from_slice(&bytes).map_err(|e| failed("reading", &path)(e.into()))?;
            roots.push(root);
        }
        Ok(roots)
    }

    /// Removes a root: what only it keeps may go.
    ///
    /// # Errors
    /// When it is there and cannot be removed.
    pub fn remove_root(&self, root: &Root) -> Result<(), StoreError> {
        self.disk.remove(&self.path_of_root(root))
    }

    /// A folder has one name, so that its next release replaces its root.
    fn path_of_root(&self, root: &Root) -> PathBuf {
        let name = Digest::of(root.release.as_os_str().as_encoded_bytes());
        self.root.join(FOLDER).join(format!("{name}.json"))
    }
}
