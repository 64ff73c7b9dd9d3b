//! The files of a release: in a folder that another party may have made, or not written yet.

use super::{RecheckError, unreadable_file};
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_release::composed::{FileContent, ReleaseTree};
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// The place of the files.
#[derive(Debug, Clone, Copy)]
pub(super) enum TreeFiles<'a> {
    /// A folder. Nothing outside of it is read.
    Folder(&'a Path),
    /// The files that a release is going to write, with their bytes in the store or in memory.
    Unwritten {
        files: &'a ReleaseTree,
        /// Reading fails from the moment at which it is true.
        cancel: &'a AtomicBool,
    },
}

impl TreeFiles<'_> {
    fn read(self, name: &str, limit: u64) -> io::Result<Vec<u8>> {
        match self {
            Self::Folder(dir) => files::read_below(dir, Path::new(name), limit),
            Self::Unwritten { cancel, .. } if cancel.load(Ordering::Relaxed) => {
                Err(io::ErrorKind::Interrupted.into())
            }
            Self::Unwritten { files, .. } => match files.content(name) {
                Some(FileContent::Bytes(bytes)) => Ok(bytes.clone()),
                Some(FileContent::Blob { path, .. }) => files::read_with(path, LinkRule::Refuse, limit),
                None => Err(io::ErrorKind::NotFound.into()),
            },
        }
    }
}

/// A release tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct AuditedTree<'a> {
    pub(super) files: TreeFiles<'a>,
    /// Names of the pictures whose files are what this program writes for them. Each was decoded for
    /// the passes, and need not be decoded again for its form.
    pub(super) composed: &'a Mutex<BTreeSet<String>>,
}

impl AuditedTree<'_> {
    /// The path of a file that readers open by its path.
    pub(super) fn path_of(self, name: &str) -> PathBuf {
        match self.files {
            TreeFiles::Folder(dir) => dir.join(name),
            TreeFiles::Unwritten { files, .. } => files.place(name).unwrap_or(Path::new(name)).to_owned(),
        }
    }

    /// Reads a file. Its name may come from another file of the tree.
    pub(super) fn read(self, name: &str) -> Result<Vec<u8>, RecheckError> {
        self.files.read(name, files::MAX_DOCUMENT).map_err(|e| self.refusal(name, e))
    }

    pub(super) fn json<T: DeserializeOwned>(self, name: &str) -> Result<T, RecheckError> {
        serde_json::from_slice(&self.read(name)?).map_err(|e| self.refusal(name, e))
    }

    /// The bytes of a picture; `None` if there is nothing of this name.
    pub(super) fn picture(self, name: &str) -> Result<Option<Vec<u8>>, RecheckError> {
        match self.files.read(name, files::MAX_PICTURE) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(self.refusal(name, e)),
        }
    }

    /// Returns true for a regular file, and false if there is nothing of this name. Everything else is
    /// an error.
    pub(super) fn has(self, name: &str) -> Result<bool, RecheckError> {
        let dir = match self.files {
            TreeFiles::Folder(dir) => dir,
            TreeFiles::Unwritten { files, .. } => return Ok(files.content(name).is_some()),
        };
        match files::open_below(dir, Path::new(name)) {
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
