//! Comparison of every byte with all lists.

use super::sums::Sums;
use super::walk::unsafe_because;
use super::{AuditFault, FaultCode};
use gs2e_release::checksum::FileHashes;
use gs2e_release::manifest::{ManifestFile, ReleaseManifest};
use gs2e_release::{checksum, manifest, signature};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Hashes of the tree's files by path, including the sums file. `None` if a file could not be read.
pub(super) type Bytes = BTreeMap<String, Option<FileHashes>>;

/// Reads and hashes all files, in parallel.
pub(super) fn hash_files(dir: &Path, files: &BTreeSet<String>) -> Bytes {
    files.par_iter().map(|path| (path.clone(), checksum::hash_file(&dir.join(path)).ok())).collect()
}

/// Returns the files with the bytes that the sums state, and their SHA-256.
pub(super) fn intact_files<'a>(bytes: &'a Bytes, sums: &'a Sums) -> BTreeMap<&'a str, &'a str> {
    let same = |(path, sum): (&'a String, &'a String)| {
        let found = bytes.get(path)?.as_ref()?;
        (found.sha256 == *sum).then_some((path.as_str(), sum.as_str()))
    };
    sums.iter().filter_map(same).collect()
}

/// Statements of the tree about the bytes of its files.
#[derive(Debug)]
pub(super) struct StatedBytes<'a> {
    pub(super) sums: &'a Sums,
    /// `B3SUMS`, where it could be read.
    pub(super) b3: Option<&'a Sums>,
    /// The files that the manifest lists, if it could be read.
    listed: Option<BTreeMap<&'a str, &'a ManifestFile>>,
}

impl<'a> StatedBytes<'a> {
    pub(super) fn new(sums: &'a Sums, b3: Option<&'a Sums>, manifest: Option<&'a ReleaseManifest>) -> Self {
        Self { sums, b3, listed: manifest.map(manifest_listing) }
    }
}

/// Compares the files on disk, the sums and the manifest with each other.
pub(super) fn compare_bytes(bytes: &Bytes, stated: &StatedBytes<'_>, faults: &mut Vec<AuditFault>) {
    let sums = stated.sums;
    faults.extend(compare_lists(stated));
    for path in sums.keys().filter(|path| !bytes.contains_key(*path)) {
        faults.push(AuditFault::of_file(FaultCode::Missing, path, "SHA256SUMS lists it, but it is missing"));
    }
    // `SHA256SUMS` contains neither its own sum nor that of its signature.
    let unlisted = [checksum::NAME, signature::NAME];
    for (path, hashes) in bytes.iter().filter(|(path, _)| !unlisted.contains(&path.as_str())) {
        let Some(hashes) = hashes else {
            faults.push(AuditFault::of_file(FaultCode::Unreadable, path, "it cannot be read"));
            continue;
        };
        let Some(sum) = sums.get(path) else {
            faults.push(AuditFault::of_file(FaultCode::Unlisted, path, "SHA256SUMS does not list it"));
            continue;
        };
        faults.extend(compare_file(path, hashes, sum, &stated.others(path, hashes)));
    }
}

/// Returns all files that the manifest lists, by path.
fn manifest_listing(manifest: &ReleaseManifest) -> BTreeMap<&str, &ManifestFile> {
    let scenes = manifest.scenes.iter().flat_map(|scene| &scene.files);
    manifest.files.iter().chain(scenes).map(|file| (file.path.as_str(), file)).collect()
}

/// Checks that the lists name the same files, except for those that one of them cannot contain.
fn compare_lists(stated: &StatedBytes<'_>) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    // Name of each other list, its paths, and the paths that only `SHA256SUMS` can contain: a list
    // cannot contain its own sum, and `B3SUMS` is written after the manifest.
    let mut others: Vec<(&str, BTreeSet<&str>, &[&str])> = Vec::new();
    if let Some(listed) = &stated.listed {
        others.push((manifest::NAME, listed.keys().copied().collect(), &[manifest::NAME, checksum::B3_NAME]));
    }
    if let Some(b3) = stated.b3 {
        others.push((checksum::B3_NAME, b3.keys().map(String::as_str).collect(), &[checksum::B3_NAME]));
    }
    let all: BTreeSet<&str> = others.iter().flat_map(|(_, paths, _)| paths).copied().collect();
    for path in &all {
        // Unsafe paths of the sums were removed when they were read, so this one is the manifest's.
        if let Some(because) = unsafe_because(path) {
            faults.push(AuditFault::of_file(FaultCode::UnsafePath, path, because));
        } else if !stated.sums.contains_key(*path) {
            let who = others.iter().filter(|(_, paths, _)| paths.contains(path)).map(|(name, ..)| *name);
            let message = format!("{}, SHA256SUMS does not", sources_say(who, "lists it", "list it"));
            faults.push(AuditFault::of_file(FaultCode::SumsDisagree, path, message));
        }
    }
    for path in stated.sums.keys().map(String::as_str) {
        let lacks = |(_, paths, outside): &&(&str, BTreeSet<&str>, &[&str])| {
            !paths.contains(path) && !outside.contains(&path)
        };
        let who: Vec<&str> = others.iter().filter(lacks).map(|(name, ..)| *name).collect();
        if !who.is_empty() {
            let message =
                format!("SHA256SUMS lists it, {}", sources_say(who.into_iter(), "does not", "do not"));
            faults.push(AuditFault::of_file(FaultCode::SumsDisagree, path, message));
        }
    }
    faults
}

/// `A says so`, `A and B say so`.
fn sources_say<'a>(who: impl Iterator<Item = &'a str>, one: &str, several: &str) -> String {
    let who: Vec<&str> = who.collect();
    format!("{} {}", who.join(" and "), if who.len() == 1 { one } else { several })
}

impl StatedBytes<'_> {
    /// Returns the other lists that name a file, each with true if these bytes are those that it
    /// states.
    fn others(&self, path: &str, found: &FileHashes) -> Vec<(&'static str, bool)> {
        let listed = self.listed.as_ref().and_then(|listed| listed.get(path));
        let manifest = listed.map(|it| (manifest::NAME, it.blake3 == found.blake3 && it.size == found.size));
        let b3 = self.b3.and_then(|b3| b3.get(path));
        let b3 = b3.map(|sum| (checksum::B3_NAME, *sum == found.blake3.to_string()));
        manifest.into_iter().chain(b3).collect()
    }
}

fn compare_file(
    path: &str,
    found: &FileHashes,
    sum: &str,
    others: &[(&'static str, bool)],
) -> Option<AuditFault> {
    let saying = |so: bool| others.iter().filter(move |(_, agrees)| *agrees == so).map(|(name, _)| *name);
    let disagree = |message: String| Some(AuditFault::of_file(FaultCode::SumsDisagree, path, message));
    // If any list agrees with the bytes, the lists are at fault; if none does, the file is.
    match (found.sha256 == *sum, saying(true).next(), saying(false).next()) {
        (true, _, None) => None,
        (true, _, Some(_)) => {
            let otherwise = sources_say(saying(false), "says otherwise", "say otherwise");
            disagree(format!("its bytes match SHA256SUMS, {otherwise}"))
        }
        (false, Some(_), _) => {
            let states = sources_say(saying(true), "states", "state");
            disagree(format!("{states} its bytes, SHA256SUMS says otherwise"))
        }
        (false, None, _) => {
            let message = format!("its SHA-256 is {}, SHA256SUMS says {sum}", found.sha256);
            Some(AuditFault::of_file(FaultCode::Altered, path, message))
        }
    }
}
