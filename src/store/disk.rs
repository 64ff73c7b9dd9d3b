//! Every file operation of the store, so that there is one place to count, fail and record them.

use super::{Digest, StoreError};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

pub(super) fn failed(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::Io { doing, path, source }
}

pub(super) fn create_dir(path: &Path) -> Result<(), StoreError> {
    fs::create_dir_all(path).map_err(failed("creating", path))
}

/// Removes everything in a folder, and keeps the folder.
pub(super) fn empty_dir(path: &Path) -> Result<(), StoreError> {
    for entry in fs::read_dir(path).map_err(failed("listing", path))? {
        let entry = entry.map_err(failed("listing", path))?.path();
        let removed = if entry.is_dir() { fs::remove_dir_all(&entry) } else { fs::remove_file(&entry) };
        removed.map_err(failed("removing", &entry))?;
    }
    Ok(())
}

/// Holds the folder's `VERSION` against the format that this program knows; writes it into a new folder.
pub(super) fn check_format(root: &Path, known: u32, write: bool) -> Result<(), StoreError> {
    let path = root.join("VERSION");
    match fs::read_to_string(&path) {
        Ok(text) => match text.trim().parse::<u32>() {
            Ok(found) if found <= known => Ok(()),
            _ => Err(StoreError::Newer { path: root.to_owned(), found: text.trim().to_owned(), known }),
        },
        Err(e) if e.kind() == io::ErrorKind::NotFound && write => {
            write_atomically(&path, &root.join("VERSION.new"), format!("{known}\n").as_bytes())
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(failed("reading", &path)(e)),
    }
}

/// Writes a file under a temporary name and renames it: it is there whole, or not at all.
pub(super) fn write_atomically(path: &Path, temporary: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let write = || -> io::Result<()> {
        let mut file = File::create(temporary)?;
        file.write_all(bytes)?;
        drop(file);
        fs::rename(temporary, path)
    };
    write().map_err(failed("writing", path))
}

/// Publishes a finished file under its final name, first writer wins. `false`: the name was taken.
pub(super) fn link_new(from: &Path, to: &Path) -> Result<bool, StoreError> {
    match fs::hard_link(from, to) {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(e) => Err(failed("publishing", to)(e)),
    }
}

pub(super) fn make_read_only(path: &Path) -> Result<(), StoreError> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(0o444)).map_err(failed("protecting", path))
}

pub(super) fn rename(from: &Path, to: &Path) -> Result<(), StoreError> {
    fs::rename(from, to).map_err(failed("renaming", from))
}

/// The files below a folder as relative `/`-joined names, sorted.
pub(super) fn files_below(root: &Path) -> Result<Vec<(String, PathBuf)>, StoreError> {
    let mut files = Vec::new();
    for entry in walkdir::WalkDir::new(root).sort_by_file_name() {
        let entry = entry.map_err(|e| failed("listing", root)(e.into()))?;
        if entry.file_type().is_file() {
            let below = entry.path().strip_prefix(root).expect("the walk starts at the root");
            let name: Vec<_> = below.iter().map(|part| part.to_string_lossy().into_owned()).collect();
            files.push((name.join("/"), entry.into_path()));
        }
    }
    files.sort();
    Ok(files)
}

/// Reads a whole file; `None` where it is absent.
pub(super) fn read_optional(path: &Path) -> Result<Option<Vec<u8>>, StoreError> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(failed("reading", path)(e)),
    }
}

/// BLAKE3 of a file's bytes.
pub(super) fn digest(path: &Path) -> io::Result<Digest> {
    Digest::of_file(path)
}
