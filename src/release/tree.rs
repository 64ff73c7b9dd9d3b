//! A tree of files on its way to disk: written aside, synced, audited, and put in place by one rename.
//!
//! The audit is told the takedown list, so that no release is put in place that holds what it lists.

use super::manifest::ManifestFile;
use super::{Options, ReleaseError, audit, checksum, manifest};
use crate::recipe::Takedown;
use crate::store::{Digest, Store};
use rayon::prelude::*;
use rustix::fs::{CWD, RenameFlags};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Where a file's bytes come from.
#[derive(Debug)]
pub(super) enum Content {
    /// Made for the release.
    Bytes(Vec<u8>),
    /// A blob of the store.
    Blob { path: PathBuf, digest: Digest, size: u64 },
}

impl Content {
    /// A JSON document: indented, with a final newline.
    pub(super) fn json<T: serde::Serialize>(value: &T) -> Self {
        Self::Bytes(Self::json_bytes(value))
    }

    /// The bytes of a JSON document.
    pub(super) fn json_bytes<T: serde::Serialize>(value: &T) -> Vec<u8> {
        let mut bytes = serde_json::to_vec_pretty(value).expect("release files are plain data");
        bytes.push(b'\n');
        bytes
    }
}

/// Files by path, `/`-separated, below the release folder.
#[derive(Debug, Default)]
pub(super) struct Tree {
    files: BTreeMap<String, Content>,
}

impl Tree {
    /// Adds a file. Recipes are refused where two scenes would write one path, so a path is new.
    pub(super) fn add(&mut self, path: String, content: Content) {
        let before = self.files.insert(path, content);
        assert!(before.is_none(), "scene ids and trajectory names do not clash in valid recipes");
    }

    pub(super) fn extend(&mut self, other: Self) {
        other.files.into_iter().for_each(|(path, content)| self.add(path, content));
    }

    /// The paths, sorted.
    pub(super) fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    /// The file in the store that a file of the tree is.
    pub(super) fn place(&self, path: &str) -> Option<&Path> {
        match self.files.get(path)? {
            Content::Blob { path, .. } => Some(path),
            Content::Bytes(_) => None,
        }
    }

    /// The files with their contents, sorted by path.
    pub(super) fn into_files(self) -> BTreeMap<String, Content> {
        self.files
    }

    /// The files with sizes and digests, sorted by path.
    pub(super) fn listing(&self) -> Vec<ManifestFile> {
        let list = self.files.iter().map(|(path, content)| {
            let (size, blake3) = match content {
                Content::Bytes(bytes) => (bytes.len() as u64, Digest::of(bytes)),
                Content::Blob { digest, size, .. } => (*size, *digest),
            };
            ManifestFile { path: path.clone(), size, blake3 }
        });
        list.collect()
    }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> ReleaseError {
    let path = path.to_owned();
    move |source| ReleaseError::Io { path, source }
}

/// Writes the tree and its sums, and puts it in place. Returns the number of files and their bytes.
pub(super) fn write(
    to: &Path,
    tree: &Tree,
    (store, takedown): (&Store, &Takedown),
    options: Options,
) -> Result<(usize, u64), ReleaseError> {
    let existing = existing(to, options)?;
    let partial = beside(to, "partial")?;
    if partial.exists() {
        fs::remove_dir_all(&partial).map_err(failed(&partial))?;
    }
    fs::create_dir_all(&partial).map_err(failed(&partial))?;
    let folders: BTreeSet<&Path> = tree.files.keys().filter_map(|path| Path::new(path).parent()).collect();
    for folder in folders {
        let folder = partial.join(folder);
        fs::create_dir_all(&folder).map_err(failed(&folder))?;
    }
    let mut written: BTreeMap<&str, checksum::Hashes> = tree
        .files
        .par_iter()
        .map(|(path, content)| {
            Ok((path.as_str(), place(&partial.join(path), path, content, store, options)?))
        })
        .collect::<Result<_, ReleaseError>>()?;
    sync(&partial)?;
    seal(&partial, &mut written)?;
    let report = audit::audit_against(&partial, Some(takedown)).map_err(failed(&partial))?;
    if !report.faults.is_empty() {
        return Err(ReleaseError::Audit(report.faults));
    }
    put_in_place(&partial, to, existing)?;
    Ok((written.len(), written.values().map(|hashes| hashes.size).sum()))
}

/// Writes the sums, `B3SUMS` first as `SHA256SUMS` covers it, and adds them to what was written.
fn seal(partial: &Path, written: &mut BTreeMap<&str, checksum::Hashes>) -> Result<(), ReleaseError> {
    for name in [checksum::B3_NAME, checksum::NAME] {
        let sum = |of: &checksum::Hashes| match name {
            checksum::B3_NAME => of.blake3.to_string(),
            _ => of.sha256.clone(),
        };
        let text = checksum::text(written.iter().map(|(path, hashes)| (*path, sum(hashes))));
        let path = partial.join(name);
        write_synced(&path, text.as_bytes()).map_err(failed(&path))?;
        written.insert(name, checksum::Hashes::of(text.as_bytes()));
    }
    Ok(())
}

/// The path beside `to` with a suffix: on the same file system, so that a rename is enough.
fn beside(to: &Path, suffix: &str) -> Result<PathBuf, ReleaseError> {
    let name = to.file_name().ok_or_else(|| ReleaseError::Foreign {
        path: to.to_owned(),
        because: "is no name for a release folder".into(),
    })?;
    let mut name = name.to_owned();
    name.push(".");
    name.push(suffix);
    Ok(to.with_file_name(name))
}

/// Whether there is a folder to be replaced; refuses one that is not ours unless the user insists.
fn existing(to: &Path, options: Options) -> Result<bool, ReleaseError> {
    if fs::symlink_metadata(to).is_err() {
        return Ok(false);
    }
    let foreign = |because: &str| ReleaseError::Foreign { path: to.to_owned(), because: because.to_owned() };
    if !fs::symlink_metadata(to).map_err(failed(to))?.is_dir() {
        return Err(foreign("is no folder"));
    }
    if fs::read_dir(to).map_err(failed(to))?.next().is_none() || options.replace {
        return Ok(true);
    }
    if !to.join(manifest::NAME).is_file() || !to.join(checksum::NAME).is_file() {
        return Err(foreign("is not empty, and no release: --replace would delete it"));
    }
    match audit::unlisted(to).map_err(failed(to))?.first() {
        Some(path) => Err(foreign(&format!("holds `{path}`, which the release there does not list"))),
        None => Ok(true),
    }
}

/// Brings one file to its place and hashes what lies there.
fn place(
    path: &Path,
    name: &str,
    content: &Content,
    store: &Store,
    options: Options,
) -> Result<checksum::Hashes, ReleaseError> {
    match content {
        Content::Bytes(bytes) => fs::write(path, bytes).map_err(failed(path))?,
        Content::Blob { path: blob, .. } => materialise(blob, path, options.copy).map_err(failed(path))?,
    }
    let hashes = checksum::both(path).map_err(failed(path))?;
    if let Content::Blob { digest, .. } = content {
        if hashes.blake3 != *digest {
            return Err(ReleaseError::Altered { path: name.to_owned() });
        }
        store.settle(digest)?;
    }
    Ok(hashes)
}

/// Reflink, else hard link of the read-only blob, else copy.
fn materialise(blob: &Path, path: &Path, copy: bool) -> io::Result<()> {
    let cloned = File::open(blob).and_then(|from| {
        let to = File::create_new(path)?;
        rustix::fs::ioctl_ficlone(&to, &from).map_err(io::Error::from)
    });
    if cloned.is_ok() {
        return Ok(());
    }
    fs::remove_file(path)?;
    if !copy && fs::hard_link(blob, path).is_ok() {
        return Ok(());
    }
    io::copy(&mut File::open(blob)?, &mut File::create_new(path)?).map(drop)
}

fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Has everything that was written to this file system on disk before the sums say so.
fn sync(folder: &Path) -> Result<(), ReleaseError> {
    let synced = File::open(folder).and_then(|file| rustix::fs::syncfs(&file).map_err(io::Error::from));
    synced.map_err(failed(folder))
}

fn put_in_place(partial: &Path, to: &Path, existing: bool) -> Result<(), ReleaseError> {
    let parent = match to.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if existing {
        exchange(partial, to).map_err(failed(to))?;
        fs::remove_dir_all(partial).map_err(failed(partial))?;
    } else {
        fs::rename(partial, to).map_err(failed(to))?;
    }
    File::open(parent).and_then(|folder| folder.sync_all()).map_err(failed(parent))
}

/// Swaps two folders in one step where the file system can; elsewhere the old one is moved aside first.
fn exchange(partial: &Path, to: &Path) -> io::Result<()> {
    if rustix::fs::renameat_with(CWD, partial, CWD, to, RenameFlags::EXCHANGE).is_ok() {
        return Ok(());
    }
    let aside = partial.with_extension("old");
    fs::rename(to, &aside)?;
    fs::rename(partial, to)?;
    fs::rename(&aside, partial)
}
