//! The files of a release that another party may have made.

use super::{RecheckError, unreadable_file};
use crate::files;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A release tree. Nothing outside its folder is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct AuditedTree<'a> {
    pub(super) dir: &'a Path,
    /// Names of the pictures whose files are what this program writes for them. Each was decoded for
    /// the passes, and need not be decoded again for its form.
    pub(super) composed: &'a Mutex<BTreeSet<String>>,
}

impl AuditedTree<'_> {
    pub(super) fn path_of(self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Reads a file. Its name may come from another file of the tree.
    pub(super) fn read(self, name: &str) -> Result<Vec<u8>, RecheckError> {
        files::read_below(self.dir, Path::new(name), files::MAX_DOCUMENT).map_err(|e| self.refusal(name, e))
    }

    pub(super) fn json<T: DeserializeOwned>(self, name: &str) -> Result<T, RecheckError> {
        serde_json::from_slice(&self.read(name)?).map_err(|e| self.refusal(name, e))
    }

    /// The bytes of a picture; `None` if there is nothing of this name.
    pub(super) fn picture(self, name: &str) -> Result<Option<Vec<u8>>, RecheckError> {
        match files::read_below(self.dir, Path::new(name), files::MAX_PICTURE) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(self.refusal(name, e)),
        }
    }

    /// Returns true for a regular file, and false if there is nothing of this name. Everything else is
    /// an error.
    pub(super) fn has(self, name: &str) -> Result<bool, RecheckError> {
        match files::open_below(self.dir, Path::new(name)) {
            Ok(_) => Ok(true),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(e) => Err(self.refusal(name, e)),
        }
    }

    /// Notes a picture whose file is what this program writes for it.
    pub(super) fn note_composed(self, name: String) {
        self.composed.lock().expect("no thread panics while it holds the names").insert(name);
    }

    pub(super) fn refusal(self, name: &str, because: impl std::fmt::Display) -> RecheckError {
        unreadable_file(&self.path_of(name), because)
    }
}
