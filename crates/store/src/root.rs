//! Roots: steps that stay in the store although no recipe refers to them any more. One file per
//! release, in `roots/`.

use super::disk::disk_error;
use super::{Digest, Key, Store, StoreError, TMP};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A release and the keys of its steps.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReleaseRoot {
    /// Its folder, absolute.
    #[serde(with = "folder")]
    pub release: PathBuf,
    /// The keys of its steps.
    pub keys: Vec<Key>,
}

/// Folder of roots.
pub(super) const FOLDER: &str = "roots";

impl Store {
    /// Keeps the steps of a release, and replaces the previous root of its folder.
    ///
    /// # Errors
    /// The root cannot be written.
    pub fn write_root(&self, root: &ReleaseRoot) -> Result<(), StoreError> {
        let path = self.path_of_root(root);
        let bytes = serde_json::to_vec(root).map_err(|e| disk_error("writing", &path)(e.into()))?;
        self.disk.create_dir(&self.root.join(FOLDER))?;
        self.disk.write_atomically(&path, &self.blobs.fresh(TMP), &bytes)
    }

    /// The roots, sorted by file name.
    ///
    /// # Errors
    /// A root cannot be read: the steps that it keeps are then unknown.
    pub fn roots(&self) -> Result<Vec<ReleaseRoot>, StoreError> {
        let mut roots = Vec::new();
        for (_, path) in self.files_of(FOLDER)? {
            // A reader holds no lock, so another process may remove a root between the listing and this line.
            let Some(bytes) = self.disk.read_optional(&path)? else { continue };
            let root = serde_json::from_slice(&bytes).map_err(|e| disk_error("reading", &path)(e.into()))?;
            roots.push(root);
        }
        Ok(roots)
    }

    /// Removes a root. Steps that only it keeps may then be collected.
    ///
    /// # Errors
    /// It exists but cannot be removed.
    pub fn remove_root(&self, root: &ReleaseRoot) -> Result<(), StoreError> {
        self.disk.remove(&self.path_of_root(root))
    }

    /// The name of a root is a function of its folder, so that the next release replaces it.
    fn path_of_root(&self, root: &ReleaseRoot) -> PathBuf {
        let name = Digest::of_bytes(root.release.as_os_str().as_encoded_bytes());
        self.root.join(FOLDER).join(format!("{name}.json"))
    }
}

/// A folder in JSON: text, or a list of bytes where its name is not UTF-8.
mod folder {
    use serde::{Deserialize, Deserializer, Serialize as _, Serializer};
    use std::ffi::OsString;
    use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
    use std::path::{Path, PathBuf};

    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Written {
        Text(String),
        Bytes(Vec<u8>),
    }

    pub(super) fn serialize<S: Serializer>(folder: &Path, serializer: S) -> Result<S::Ok, S::Error> {
        match folder.to_str() {
            Some(text) => text.serialize(serializer),
            None => folder.as_os_str().as_bytes().serialize(serializer),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<PathBuf, D::Error> {
        Ok(match Written::deserialize(deserializer)? {
            Written::Text(text) => text.into(),
            Written::Bytes(bytes) => OsString::from_vec(bytes).into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;
    use std::path::Path;

    #[test]
    fn folders_keep_their_names_in_json() {
        for (name, wanted) in [(&b"/a/b"[..], "\"/a/b\""), (b"/x\xff", "[47,120,255]")] {
            let root =
                ReleaseRoot { release: Path::new(OsStr::from_bytes(name)).to_owned(), keys: Vec::new() };
            let text = serde_json::to_string(&root).unwrap();
            assert_eq!(text, format!("{{\"release\":{wanted},\"keys\":[]}}"));
            assert_eq!(serde_json::from_str::<ReleaseRoot>(&text).unwrap(), root);
        }
    }
}
