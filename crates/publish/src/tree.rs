//! Writes a tree of files: in a work folder, synced, audited, and put in place by one rename.
//!
//! The audit gets the takedown list, so that no release with a listed scene is put in place.

use super::standing::StandingTree;
use super::target::ReleaseTarget;
use super::work::{WorkFolder, write_new};
use super::{LinkMode, ReleaseError, failed};
use gs2e_audit as audit;
use gs2e_audit::AuditOptions;
use gs2e_files as files;
use gs2e_files::{LinkRule, Removal};
use gs2e_release::checksum;
use gs2e_release::composed::{FileContent, ReleaseTree};
use gs2e_release::manifest::ManifestFile;
use gs2e_store::Digest;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Summary of a written tree.
#[derive(Debug)]
pub(super) struct TreeOutcome {
    /// Number of files, including the sums.
    pub(super) files: usize,
    /// Their bytes.
    pub(super) bytes: u64,
    /// True if the same release was already at the target; then nothing was written.
    pub(super) stood: bool,
}

/// Writes the tree and its sums and puts it in place, unless it stands there already.
pub(super) fn write_tree(
    target: &mut ReleaseTarget,
    tree: &ReleaseTree,
    options: AuditOptions<'_>,
    link: LinkMode,
    cancel: &AtomicBool,
) -> Result<TreeOutcome, ReleaseError> {
    let listing = tree.listing();
    // A write to a release that shares files with something else would change that too.
    let shares = target.standing().is_some_and(StandingTree::shares_files);
    // `B3SUMS` covers all files but the sums, so an equal text means an equal release.
    if !shares && target.holds(&b3_sums(&listing))? {
        let (files, bytes) = target.standing().map(StandingTree::size).unwrap_or_default();
        return Ok(TreeOutcome { files, bytes, stood: true });
    }
    let work = WorkFolder::create(target.path(), &sizes(&listing))?;
    let root = work.tree();
    let placing = FilePlacing { root: &root, standing: target.standing(), link, cancel };
    let mut written: BTreeMap<&str, checksum::FileHashes> = tree
        .par_contents()
        .map(|(path, content)| Ok((path, placing.place(path, content)?)))
        .collect::<Result<_, ReleaseError>>()?;
    // Before the sums, which promise that all other files are whole.
    sync_tree(&root)?;
    write_sums(&root, &mut written)?;
    let report = audit::audit_against(&root, options).map_err(failed(&root))?;
    if !report.faults.is_empty() {
        return Err(ReleaseError::Audit(report.faults));
    }
    // The audit may take long, and the rename after it cannot be undone.
    placing.go_on()?;
    target.put(work)?;
    let bytes = written.values().map(|hashes| hashes.size).sum();
    Ok(TreeOutcome { files: written.len(), bytes, stood: false })
}

/// The text of `B3SUMS`, which follows from the listing alone.
fn b3_sums(listing: &[ManifestFile]) -> String {
    checksum::sums_text(listing.iter().map(|file| (file.path.as_str(), file.blake3.to_string())))
}

/// The size of every file, including the sums.
fn sizes(listing: &[ManifestFile]) -> BTreeMap<String, u64> {
    let b3 = b3_sums(listing).len();
    // SHA-256 sums are as long as BLAKE3 sums, and there is one more line.
    let sums =
        b3 + checksum::sums_text([(checksum::B3_NAME, Digest::of_bytes(b"").to_string())].into_iter()).len();
    let sums = [(checksum::B3_NAME, b3), (checksum::NAME, sums)];
    let sums = sums.map(|(name, size)| (name.to_owned(), size as u64));
    listing.iter().map(|file| (file.path.clone(), file.size)).chain(sums).collect()
}

/// Writes the sums and adds them to the written files. `B3SUMS` comes first, because `SHA256SUMS`
/// covers it.
fn write_sums(
    partial: &Path,
    written: &mut BTreeMap<&str, checksum::FileHashes>,
) -> Result<(), ReleaseError> {
    for name in [checksum::B3_NAME, checksum::NAME] {
        let sum = |of: &checksum::FileHashes| match name {
            checksum::B3_NAME => of.blake3.to_string(),
            _ => of.sha256.clone(),
        };
        let text = checksum::sums_text(written.iter().map(|(path, hashes)| (*path, sum(hashes))));
        let path = partial.join(name);
        write_new(&path, text.as_bytes()).map_err(failed(&path))?;
        written.insert(name, checksum::FileHashes::of_bytes(text.as_bytes()));
    }
    Ok(())
}

/// Creation of files in a new tree.
struct FilePlacing<'a> {
    root: &'a Path,
    /// The release that is about to be replaced.
    standing: Option<&'a StandingTree>,
    link: LinkMode,
    cancel: &'a AtomicBool,
}

impl FilePlacing<'_> {
    fn go_on(&self) -> Result<(), ReleaseError> {
        if self.cancel.load(Ordering::Relaxed) { Err(ReleaseError::Interrupted) } else { Ok(()) }
    }

    /// Creates one file and hashes it where it lies.
    fn place(&self, name: &str, content: &FileContent) -> Result<checksum::FileHashes, ReleaseError> {
        self.go_on()?;
        let path = self.root.join(name);
        // The written file is hashed instead of its source, so a copy that went wrong is found.
        let hash = || checksum::hash_file(&path).map_err(failed(&path));
        let (blob, digest) = match content {
            FileContent::Bytes(bytes) => {
                fs::write(&path, bytes).map_err(failed(&path))?;
                return hash();
            }
            FileContent::Blob { path, digest, .. } => (path, digest),
        };
        let remove = || files::remove(&path, Removal::File).map_err(failed(&path));
        if self.take_over(name, digest, &path) {
            match hash()? {
                hashes if hashes.blake3 == *digest => return Ok(hashes),
                _ => remove()?,
            }
        }
        materialise_blob(blob, &path, self.link).map_err(failed(&path))?;
        let hashes = hash()?;
        if hashes.blake3 == *digest {
            return Ok(hashes);
        }
        // It may be longer than the list in the work folder says, and would then be left there.
        remove()?;
        Err(ReleaseError::Altered { path: name.to_owned() })
    }

    /// Gives a file of the standing release a second name in the new tree, if it has the same
    /// content. The first name is removed when the tree is in place, so the new release shares the
    /// file with nothing.
    fn take_over(&self, name: &str, digest: &Digest, path: &Path) -> bool {
        let file = self.standing.and_then(|standing| standing.unshared(name, digest));
        file.is_some_and(|file| fs::hard_link(file, path).is_ok())
    }
}

/// Creates `path` with the content of a blob.
fn materialise_blob(blob: &Path, path: &Path, link: LinkMode) -> io::Result<()> {
    // It fails across file systems and at the limit of links; a copy serves as well.
    if link == LinkMode::Hard && fs::hard_link(blob, path).is_ok() {
        return Ok(());
    }
    let mut from = files::open_with(blob, LinkRule::Refuse)?;
    let mut to = File::create_new(path)?;
    if link != LinkMode::Copy && rustix::fs::ioctl_ficlone(&to, &from).is_ok() {
        return Ok(());
    }
    // A clone that fails writes nothing, so the copy begins at the first byte of both files.
    io::copy(&mut from, &mut to).map(drop)
}

/// Syncs everything that was written to this file system, before the sums are written.
fn sync_tree(folder: &Path) -> Result<(), ReleaseError> {
    let synced = File::open(folder).and_then(|file| rustix::fs::syncfs(&file).map_err(io::Error::from));
    synced.map_err(failed(folder))
}
