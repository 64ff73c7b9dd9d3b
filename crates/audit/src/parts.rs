//! An audit in parts: several processes each hash and open a share of the files, and one verdict follows from
//! what they found.
//!
//! A part has the files of some scenes, with a folder that has a `scene.json` as a scene, and the first part
//! also those of no scene. Every process lists the tree and finds the same parts, with about the same number
//! of bytes. A part holds the hashes of its files, and the faults of their contents. The verdict compares the
//! hashes with all lists. A file that came or went since is noticed, but not one that was altered.

use super::bytes::{self, Bytes};
use super::fault::AuditFault;
use super::trusted::TrustedTree;
use super::{claims, contents, sums, walk};
use gs2e_release::checksum::FileHashes;
use gs2e_release::scene::SceneRecord;
use gs2e_release::{checksum, layout};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::Path;

/// Format of a part. One of another format is refused.
const FORMAT: u32 = 1;

/// The result of one process, for its share of a tree.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AuditPart {
    format: u32,
    /// Number of this part, from 1.
    pub number: u32,
    /// Number of parts.
    pub of: u32,
    /// SHA-256 of `SHA256SUMS`; empty if it could not be read.
    sums: String,
    /// The hashes of its files; `None` if a file could not be read.
    files: BTreeMap<String, Option<FileHashes>>,
    /// Faults of the contents of its scenes, by scene.
    contents: BTreeMap<String, Vec<AuditFault>>,
}

/// Reason why parts give no verdict.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PartsError {
    /// A part is not there.
    #[error("part {number} of {of} is missing")]
    Missing {
        /// Its number.
        number: u32,
        /// Number of parts.
        of: u32,
    },
    /// There is no part.
    #[error("there is no part of an audit")]
    Empty,
    /// Parts that do not belong together.
    #[error("part {number} is {because}")]
    Unlike {
        /// Its number.
        number: u32,
        /// The difference.
        because: &'static str,
    },
}

impl AuditPart {
    /// Hashes and opens the files of a part.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn audit(dir: &Path, number: u32, of: u32) -> io::Result<Self> {
        let listed = walk::walk_tree(dir)?.files;
        let own = files_of_part(dir, &listed, number, of);
        let files = bytes::hash_files(dir, &own);
        // Faults of the lists are those of the verdict.
        let stated = sums::read_sums(dir, &mut Vec::new()).unwrap_or_default();
        let composed = BTreeSet::new();
        let tree = TrustedTree { dir, intact: bytes::intact_files(&files, &stated), composed: &composed };
        let scenes: Vec<&str> = own.iter().filter_map(|path| scene_of(path)).collect();
        let audited = scenes.into_par_iter().filter_map(|id| {
            let path = format!("{id}/{}", layout::SCENE);
            // A scene that cannot be read has its fault in the verdict.
            let record: SceneRecord =
                tree.has(&path).then(|| claims::parse_claims(&tree, &path, &mut Vec::new()))??;
            let faults = contents::audit_scene(&tree, &record);
            Some((record.id, faults))
        });
        let sums = checksum::sha256_of_file(&dir.join(checksum::NAME)).unwrap_or_default();
        Ok(Self { format: FORMAT, number, of, sums, contents: audited.collect(), files })
    }

    /// Number of its files, and of their bytes.
    #[must_use]
    pub fn size(&self) -> (usize, u64) {
        (self.files.len(), self.files.values().flatten().map(|hashes| hashes.size).sum())
    }
}

/// All parts of one tree.
#[derive(Debug, Default)]
pub(super) struct PartsFound {
    files: Bytes,
    contents: BTreeMap<String, Vec<AuditFault>>,
}

impl PartsFound {
    /// Joins the parts of the tree in `dir`.
    pub(super) fn join(dir: &Path, parts: Vec<AuditPart>) -> Result<Self, PartsError> {
        let of = parts.first().ok_or(PartsError::Empty)?.of;
        let sums = checksum::sha256_of_file(&dir.join(checksum::NAME)).unwrap_or_default();
        let mut seen = BTreeSet::new();
        let mut joined = Self::default();
        for part in parts {
            let unlike = |because| Err(PartsError::Unlike { number: part.number, because });
            if part.format != FORMAT {
                return unlike("of another version of gs2e");
            }
            if part.of != of {
                return unlike("of another number of parts than the others");
            }
            if part.sums != sums {
                return unlike("of another release, or of an earlier state of this one");
            }
            if !(1..=of).contains(&part.number) {
                return unlike("not one of its number of parts");
            }
            if !seen.insert(part.number) {
                return unlike("there twice");
            }
            joined.files.extend(part.files);
            joined.contents.extend(part.contents);
        }
        // No list of all numbers: the number of parts is what a file says.
        match (1..=of).find(|number| !seen.contains(number)) {
            Some(number) => Err(PartsError::Missing { number, of }),
            None => Ok(joined),
        }
    }

    /// The hashes of the files that are there now. Files that no part has are read.
    pub(super) fn bytes(&mut self, dir: &Path, listed: &BTreeSet<String>) -> Bytes {
        let (known, new): (Vec<&String>, Vec<&String>) =
            listed.iter().partition(|path| self.files.contains_key(*path));
        let mut found = bytes::hash_files(dir, &new.into_iter().cloned().collect());
        found.extend(known.into_iter().filter_map(|path| self.files.remove_entry(path)));
        found
    }

    /// The faults that a part found in the contents of a scene; `None` if no part opened it.
    pub(super) fn contents(&self, scene: &str) -> Option<&[AuditFault]> {
        self.contents.get(scene).map(Vec::as_slice)
    }
}

/// The scene whose description a path is.
fn scene_of(path: &str) -> Option<&str> {
    path.strip_suffix(layout::SCENE)?.strip_suffix('/')
}

/// The files of a part. The largest scene goes first, each to the part with the fewest bytes.
fn files_of_part(dir: &Path, listed: &BTreeSet<String>, number: u32, of: u32) -> BTreeSet<String> {
    let scenes: BTreeSet<&str> = listed.iter().filter_map(|path| scene_of(path)).collect();
    let mut units: BTreeMap<&str, (u64, Vec<&String>)> = BTreeMap::new();
    for path in listed {
        let mut folders = path.match_indices('/').map(|(at, _)| &path[..at]).rev();
        let scene = folders.find(|folder| scenes.contains(folder)).unwrap_or_default();
        let unit = units.entry(scene).or_default();
        unit.0 += dir.join(path).symlink_metadata().map_or(0, |meta| meta.len());
        unit.1.push(path);
    }
    let mut own: BTreeSet<String> = BTreeSet::new();
    // With more parts than scenes, the last ones are empty.
    let mut shares = vec![0_u64; (units.len() + 1).min(of as usize)];
    // The files of no scene are those of the first part.
    if let Some((size, files)) = units.remove("") {
        shares[0] = size;
        own.extend(files.into_iter().filter(|_| number == 1).cloned());
    }
    let mut units: Vec<(&str, (u64, Vec<&String>))> = units.into_iter().collect();
    // Ties go by the id, because every process of an audit must come to the same parts.
    units.sort_by_key(|(scene, (size, _))| (Reverse(*size), *scene));
    for (_, (size, files)) in units {
        let least = (0..shares.len()).min_by_key(|&part| shares[part]).unwrap_or(0);
        shares[least] += size;
        own.extend(files.into_iter().filter(|_| least + 1 == number as usize).cloned());
    }
    own
}
