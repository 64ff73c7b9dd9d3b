//! Roots: steps that stay in the store although no recipe refers to them any more. One file per
//! release, in `roots/`.

use super::disk::failed;
use super::{Digest, Key, Store, StoreError};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A release and the keys of its steps.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Root {
    /// Its folder, absolute.
    pub release: PathBuf,
    /// The keys of its steps.
    pub keys: Vec<Key>,
}

const FOLDER: &str = "roots";

impl Store {
    /// Keeps the steps of a release, and replaces the previous root of its folder.
    ///
    /// # Errors
    /// The root cannot be written.
    pub fn write_root(&self, root: &Root) -> Result<(), StoreError> {
        let path = self.path_of_root(root);
        // A folder whose name is not UTF-8 cannot be stored in JSON.
        let bytes = serde_json::to_vec(root).map_err(|e| failed("writing", &path)(e.into()))?;
        self.disk.create_dir(&self.root.join(FOLDER))?;
        self.disk.write_atomically(&path, &self.blobs.fresh("tmp"), &bytes)
    }

    /// The roots, sorted by file name.
    ///
    /// # Errors
    /// A root cannot be read: the steps that it keeps are then unknown.
    pub fn roots(&self) -> Result<Vec<Root>, StoreError> {
        let mut roots = Vec::new();
        for (_, path) in self.files_of(FOLDER)? {
            let Some(bytes) = self.disk.read_optional(&path)? else { continue };
            let root = serde_json::from_slice(&bytes).map_err(|e| failed("reading", &path)(e.into()))?;
            roots.push(root);
        }
        Ok(roots)
    }

    /// Removes a root. Steps that only it keeps may then be collected.
    ///
    /// # Errors
    /// It exists but cannot be removed.
    pub fn remove_root(&self, root: &Root) -> Result<(), StoreError> {
        self.disk.remove(&self.path_of_root(root))
    }

    /// The name of a root is a function of its folder, so that the next release replaces it.
    fn path_of_root(&self, root: &Root) -> PathBuf {
        let name = Digest::of(root.release.as_os_str().as_encoded_bytes());
        self.root.join(FOLDER).join(format!("{name}.json"))
    }
}
