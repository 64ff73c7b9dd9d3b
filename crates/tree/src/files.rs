//! The files of a release by their paths in it, `/`-separated.

use gs2e_files as files;
use gs2e_files::LinkRule;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// The files of a release, wherever they are.
pub trait ReleaseFiles: fmt::Debug + Send + Sync {
    /// Reads a file of at most `limit` bytes.
    ///
    /// # Errors
    /// `NotFound` if there is no such file; any other error of the file system.
    fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>>;

    /// The place of a file on disk, for readers that open it themselves.
    ///
    /// # Errors
    /// As [`ReleaseFiles::read`]; `Unsupported` for a file that is not on disk yet.
    fn place(&self, path: &str) -> io::Result<PathBuf>;

    /// Returns true if there is a file, and false if there is nothing of this name.
    ///
    /// # Errors
    /// There is something else, such as a link or a folder.
    fn has(&self, path: &str) -> io::Result<bool>;

    /// The path of a file in messages.
    fn display_path(&self, path: &str) -> PathBuf {
        path.into()
    }
}

/// The folder of a release, which anyone may have made. Nothing outside of it is opened.
#[derive(Debug, Clone)]
pub struct ReleaseFolder(pub PathBuf);

impl ReleaseFiles for ReleaseFolder {
    fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>> {
        files::read_below(&self.0, Path::new(path), limit)
    }

    fn place(&self, path: &str) -> io::Result<PathBuf> {
        // Opened to refuse links on the way and anything but a file; the caller opens it once more.
        files::open_below(&self.0, Path::new(path)).map(|_| self.0.join(path))
    }

    fn has(&self, path: &str) -> io::Result<bool> {
        match files::open_below(&self.0, Path::new(path)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            opened => opened.map(|_| true),
        }
    }

    fn display_path(&self, path: &str) -> PathBuf {
        self.0.join(path)
    }
}

/// Files of a release that do not lie in one folder, by path.
#[derive(Debug, Default)]
pub struct ListedFiles(pub BTreeMap<String, ListedFile>);

/// The bytes of a file.
#[derive(Debug)]
pub enum ListedFile {
    /// In memory.
    Bytes(Vec<u8>),
    /// In a file elsewhere.
    Stored(PathBuf),
}

impl ListedFiles {
    fn file(&self, path: &str) -> io::Result<&ListedFile> {
        self.0
            .get(path)
            .ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "the release has no such file"))
    }
}

impl ReleaseFiles for ListedFiles {
    fn read(&self, path: &str, limit: u64) -> io::Result<Vec<u8>> {
        match self.file(path)? {
            ListedFile::Bytes(bytes) => Ok(bytes.clone()),
            ListedFile::Stored(place) => files::read_with(place, LinkRule::Refuse, limit),
        }
    }

    fn place(&self, path: &str) -> io::Result<PathBuf> {
        match self.file(path)? {
            ListedFile::Bytes(_) => Err(io::Error::new(io::ErrorKind::Unsupported, "it is not on disk yet")),
            ListedFile::Stored(place) => files::open_with(place, LinkRule::Refuse).map(|_| place.clone()),
        }
    }

    fn has(&self, path: &str) -> io::Result<bool> {
        Ok(self.0.contains_key(path))
    }
}

/// Reads a JSON file of a release.
///
/// # Errors
/// It cannot be read, or has another form.
pub fn json_of<T: DeserializeOwned>(tree: &dyn ReleaseFiles, path: &str) -> Result<T, TreeError> {
    let failed = |because: &dyn fmt::Display| TreeError::new(tree.display_path(path), because);
    let bytes = tree.read(path, files::MAX_DOCUMENT).map_err(|e| failed(&e))?;
    serde_json::from_slice(&bytes).map_err(|e| failed(&e))
}

/// A file of a release that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {because}", path.display())]
pub struct TreeError {
    /// The file.
    pub path: PathBuf,
    /// The fault.
    pub because: String,
}

impl TreeError {
    /// The fault of a file.
    pub fn new(path: impl Into<PathBuf>, because: impl fmt::Display) -> Self {
        Self { path: path.into(), because: because.to_string() }
    }
}
