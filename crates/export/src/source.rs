//! The files of a release that an export reads: in a folder, or composed and not yet written.

use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_release::include::{ComposedFile, ComposedScene};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The files of a release by their paths in it, `/`-separated.
#[derive(Debug)]
pub(super) enum SubjectFiles {
    /// The folder of a release. Nothing outside of it is opened.
    Folder(PathBuf),
    /// A scene of a release that is not written yet.
    Composed(Arc<ComposedScene>),
    /// No files: the subject is one that a recipe promises.
    Promised,
}

impl SubjectFiles {
    /// Returns true if a file or a folder has this path.
    pub(super) fn has(&self, path: &str) -> bool {
        match self {
            Self::Folder(dir) => files::is_there(&dir.join(path)),
            Self::Composed(scene) => scene.file(path).is_some() || scene.has_folder(path),
            Self::Promised => false,
        }
    }

    /// The path of a file, for messages.
    pub(super) fn shown(&self, path: &str) -> PathBuf {
        match self {
            Self::Folder(dir) => dir.join(path),
            Self::Composed(_) | Self::Promised => PathBuf::from(path),
        }
    }

    /// Reads a file of at most `limit` bytes.
    pub(super) fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>> {
        match self {
            Self::Folder(dir) => files::read_below(dir, Path::new(path), limit),
            Self::Composed(scene) => match scene.file(path) {
                Some(ComposedFile::Bytes(bytes)) => Ok(bytes.clone()),
                Some(ComposedFile::Stored(stored)) => files::read_with(stored, LinkRule::Refuse, limit),
                None => Err(absent()),
            },
            Self::Promised => Err(absent()),
        }
    }

    /// The place of a file on disk, for readers that open it themselves. It was opened once without
    /// following a link.
    pub(super) fn open(&self, path: &str) -> io::Result<PathBuf> {
        match self {
            Self::Folder(dir) => files::open_below(dir, Path::new(path)).map(|_| dir.join(path)),
            Self::Composed(scene) => match scene.file(path) {
                Some(ComposedFile::Stored(stored)) => {
                    files::open_with(stored, LinkRule::Refuse).map(|_| stored.clone())
                }
                Some(ComposedFile::Bytes(_)) => {
                    Err(io::Error::new(io::ErrorKind::Unsupported, "it is not on disk yet"))
                }
                None => Err(absent()),
            },
            Self::Promised => Err(absent()),
        }
    }
}

fn absent() -> io::Error {
    io::Error::new(io::ErrorKind::NotFound, "the release has no such file")
}
