//! Every byte, against both lists.

use super::sums::Sums;
use super::walk::unsafe_because;
use super::{Code, Fault};
use crate::release::checksum::{self, Hashes};
use crate::release::manifest::{self, Manifest, ManifestFile};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Hashes of the tree's files by path, the sums file included; `None` where a file could not be read.
pub(super) type Bytes = BTreeMap<String, Option<Hashes>>;

/// Reads all files, in parallel.
pub(super) fn hash(dir: &Path, files: &BTreeSet<String>) -> Bytes {
    files.par_iter().map(|path| (path.clone(), checksum::both(&dir.join(path)).ok())).collect()
}

/// The files whose bytes are those of the sums, with their SHA-256.
pub(super) fn intact<'a>(bytes: &'a Bytes, sums: &'a Sums) -> BTreeMap<&'a str, &'a str> {
    let same = |(path, sum): (&'a String, &'a String)| {
        let found = bytes.get(path)?.as_ref()?;
        (found.sha256 == *sum).then_some((path.as_str(), sum.as_str()))
    };
    sums.iter().filter_map(same).collect()
}

/// Holds the files that are there, the sums, and the manifest against each other.
pub(super) fn compare(bytes: &Bytes, sums: &Sums, manifest: Option<&Manifest>, faults: &mut Vec<Fault>) {
    let listed = manifest.map(listing);
    if let Some(listed) = &listed {
        faults.extend(compare_lists(sums, listed));
    }
    for path in sums.keys().filter(|path| !bytes.contains_key(*path)) {
        faults.push(Fault::of_file(Code::Missing, path, "SHA256SUMS lists it, and it is not there"));
    }
    for (path, hashes) in bytes.iter().filter(|(path, _)| *path != checksum::NAME) {
        let Some(hashes) = hashes else {
            faults.push(Fault::of_file(Code::Unreadable, path, "it cannot be read"));
            continue;
        };
        let Some(sum) = sums.get(path) else {
            faults.push(Fault::of_file(Code::Unlisted, path, "SHA256SUMS does not list it"));
            continue;
        };
        let stated = listed.as_ref().and_then(|listed| listed.get(path.as_str()));
        faults.extend(compare_file(path, hashes, sum, stated.copied()));
    }
}

/// All files that the manifest lists.
fn listing(manifest: &Manifest) -> BTreeMap<&str, &ManifestFile> {
    let scenes = manifest.scenes.iter().flat_map(|scene| &scene.files);
    manifest.files.iter().chain(scenes).map(|file| (file.path.as_str(), file)).collect()
}

fn compare_lists(sums: &Sums, listed: &BTreeMap<&str, &ManifestFile>) -> Vec<Fault> {
    let mut faults = Vec::new();
    for path in listed.keys() {
        if let Some(because) = unsafe_because(path) {
            faults.push(Fault::of_file(Code::UnsafePath, path, because));
        } else if !sums.contains_key(*path) {
            let message = "manifest.json lists it, SHA256SUMS does not";
            faults.push(Fault::of_file(Code::SumsDisagree, path, message));
        }
    }
    let unknown = sums.keys().filter(|path| *path != manifest::NAME && !listed.contains_key(path.as_str()));
    faults.extend(
        unknown.map(|path| {
            Fault::of_file(Code::SumsDisagree, path, "SHA256SUMS lists it, manifest.json does not")
        }),
    );
    faults
}

fn compare_file(path: &str, found: &Hashes, sum: &str, stated: Option<&ManifestFile>) -> Option<Fault> {
    let as_summed = found.sha256 == *sum;
    let as_stated = stated.is_none_or(|s| s.blake3 == found.blake3 && s.size == found.size);
    match (as_summed, as_stated, stated) {
        (true, true, _) => None,
        (false, true, Some(_)) => {
            let message = "its bytes are what manifest.json states, SHA256SUMS says otherwise";
            Some(Fault::of_file(Code::SumsDisagree, path, message))
        }
        (true, false, _) => {
            let message = "its bytes are what SHA256SUMS states, manifest.json says otherwise";
            Some(Fault::of_file(Code::SumsDisagree, path, message))
        }
        (false, ..) => {
            let message = format!("its SHA-256 is {}, SHA256SUMS says {sum}", found.sha256);
            Some(Fault::of_file(Code::Altered, path, message))
        }
    }
}
