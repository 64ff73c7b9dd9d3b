//! The audit of a release tree, which must be whole, lawful and consistent.
//!
//! The audit needs no network and no store, and it trusts no stat cache. It reads every byte once
//! for both hashes, with the files in parallel. It opens events, poses, pictures and reports a
//! second time. The result is a sorted list of faults, each with a code, the file or scene, and a
//! remedy. [`AuditReport::covers`] is the whole list of what the audit covers.
//!
//! `gs2e-release` composes the files again, from the recipes of `gs2e-recipe` and in the types of
//! `gs2e-build`. `gs2e-check` judges the data again: events of `gs2e-event`, pictures of `gs2e-image`,
//! poses of `gs2e-trajectory` and cameras of `gs2e-scene`, with the rules of `gs2e-sensor`,
//! `gs2e-sampling` and `gs2e-render`. Terms come from `gs2e-source`, digests from `gs2e-store`, units
//! from `gs2e-num`, and files are opened with `gs2e-files`. `gs2e-publish` audits every tree before it
//! is put in place.
//!
//! # Examples
//!
//! ```
//! use gs2e_audit::{FaultCode, audit_release};
//!
//! let folder = tempfile::tempdir()?;
//! std::fs::write(folder.path().join("events.h5"), "no release")?;
//! let report = audit_release(folder.path())?;
//! // Without the list of sums, no file can be trusted.
//! let fault = report.faults.first().ok_or("no fault")?;
//! assert_eq!((fault.code, fault.file.as_deref()), (FaultCode::Missing, Some("SHA256SUMS")));
//! assert_eq!(report.proved(), ["The tree is damaged or inconsistent."]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bytes;
mod claims;
mod contents;
pub(crate) mod contradictions;
mod croissant;
mod exports;
mod fault;
mod index;
mod names;
mod parts;
pub mod rebuilt;
pub mod recheck;
mod recompose;
mod splits;
mod steps;
mod sums;
mod takedown;
mod terms;
mod trusted;
mod walk;

pub use fault::{AuditFault, FaultCode};
pub use parts::{AuditPart, PartsError};

use gs2e_recipe::TakedownList;
use gs2e_release::include::ReleaseExporter;
use gs2e_release::manifest::{FileOwners, ManifestScene, ReleaseManifest};
use gs2e_release::published::PublishedScene;
use gs2e_release::scene::SceneRecord;
use gs2e_release::signature::{PublisherKey, ReleaseSignature};
use gs2e_release::{layout, signature};
use parts::PartsFound;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::Path;
use trusted::TrustedTree;

/// Outcome of an audit.
#[derive(Debug, Clone)]
pub struct AuditReport {
    /// The faults, sorted by code, file and scene.
    pub faults: Vec<AuditFault>,
    /// Number of files that were read.
    pub files: usize,
    /// Their size in bytes.
    pub bytes: u64,
    /// Everything that was examined.
    pub covers: Vec<&'static str>,
    /// The program that wrote the release, if it is not this version. The contents of files are
    /// then not compared with what this program composes.
    pub written_by: Option<String>,
    /// Number of scenes of the release.
    pub scenes: usize,
    /// Number of scenes that were made again from their recipes and compared.
    pub rebuilt_scenes: usize,
    /// Identifier of the key that the release is signed with, as the signature states it.
    pub signed_by: Option<String>,
    /// True if [`AuditReport::verify`] found the signature to be right.
    pub verified: bool,
}

impl AuditReport {
    /// Verifies the signature of the release in `dir`, and adds a fault if it is absent or wrong.
    pub fn verify(&mut self, dir: &Path, key: &PublisherKey) {
        self.covers.push("the signature of SHA256SUMS");
        match key.verify_release(dir) {
            Ok(()) => self.verified = true,
            Err(because) => {
                self.faults.push(AuditFault::of_file(FaultCode::SignatureInvalid, signature::NAME, because));
                self.faults.sort();
                self.faults.dedup();
            }
        }
    }

    /// Returns the statements that the audit has proved, one sentence each.
    #[must_use]
    pub fn proved(&self) -> Vec<String> {
        if self.faults.iter().any(|fault| fault.code != FaultCode::SignatureInvalid) {
            return vec!["The tree is damaged or inconsistent.".into()];
        }
        if !self.faults.is_empty() {
            return vec!["The tree is intact and consistent, but not signed as required.".into()];
        }
        let mut proved = vec!["The tree is intact and consistent.".to_owned()];
        let signer = self.signed_by.as_ref().filter(|_| self.verified);
        proved.extend(signer.map(|key| format!("It is signed with the key {key}.")));
        proved.extend(self.written_by.as_ref().map(|tool| {
            format!(
                "It was written by {tool}, and this is {}: the files that program composed were not compared.",
                gs2e_release::TOOL
            )
        }));
        proved
    }

    /// Returns the statements that no audit of a tree alone can prove, one sentence each.
    #[must_use]
    pub fn unproved(&self) -> Vec<String> {
        let publisher = match &self.signed_by {
            _ if self.verified => {
                "The signature shows who released it, not that the data are right:".to_owned()
            }
            Some(key) => format!(
                "It claims a signature with the key {key}, which --public-key verifies: the publisher is unknown, and"
            ),
            None => "It is not signed: the publisher is unknown, and".to_owned(),
        };
        vec![match (self.rebuilt_scenes, self.scenes) {
            (0, _) => format!(
                "{publisher} a consistent forgery is found only by `gs2e audit --rebuild` from the \
                 recipes; `gs2e check --tree` judges the events, frames and poses."
            ),
            (made, all) if made < all => format!(
                "{publisher} a consistent forgery of the {} scenes that were not rebuilt is found only by `gs2e audit \
                 --rebuild {all}`.",
                all - made
            ),
            _ => format!("{publisher} the recipes used for the comparison were not verified."),
        }]
    }
}

const COVERS: [&str; 13] = [
    "every byte against SHA256SUMS, B3SUMS and manifest.json",
    "nothing missing, nothing unlisted",
    "paths",
    "scene.json against manifest.json and its own recipe",
    "index.parquet against scene.json, speed.json and checks.json",
    "croissant.json: its fields, and its statements about files, columns and terms",
    "licence expressions, their texts and evidence, the demands of sources; REUSE.toml and DATASHEET.md against them",
    "splits: each scene is where the rule puts it, and no two splits share a group, a photo or Gaussians",
    "files outside the release format",
    "loader, card, datasheet, report, index, catalogue entry, terms, and files that follow from poses: composed again, byte for byte",
    "keys of steps against their ingredients, inputs against outputs, and files against outputs",
    "failed checks",
    "events, poses, time stamps, transforms and pictures: readable, and in agreement",
];

/// Audits the release in `dir`.
///
/// Only files with the bytes that the sums state are opened, because the content of an altered file
/// is no claim of the release.
///
/// # Errors
/// The folder cannot be listed. A file that cannot be read is a fault.
pub fn audit_release(dir: &Path) -> io::Result<AuditReport> {
    audit_against(dir, AuditOptions::default())
}

/// The choices of an audit.
#[derive(Debug, Clone, Copy, Default)]
pub struct AuditOptions<'a> {
    /// Scenes that may not be in the release.
    pub takedown: Option<&'a TakedownList>,
    /// Makes the exports of the release once more. Without it, they are judged by their names and their
    /// descriptions alone.
    pub exporter: Option<&'a dyn ReleaseExporter>,
    /// Pictures whose files are known to be what this program writes for them. They are not decoded.
    pub composed: Option<&'a BTreeSet<String>>,
}

/// Audits the release in `dir` by these choices.
///
/// # Errors
/// As [`audit_release`].
pub fn audit_against(dir: &Path, options: AuditOptions<'_>) -> io::Result<AuditReport> {
    audit_all(dir, options, PartsFound::default())
}

/// Audits the release in `dir`. With parts, the files were hashed and opened in these, and only what is left
/// is read.
///
/// # Errors
/// As [`audit_release`]; the parts are not all parts of this tree; or an export cannot be written to the
/// folder of temporary files.
pub fn audit_with(
    dir: &Path,
    options: AuditOptions<'_>,
    parts: Option<Vec<AuditPart>>,
) -> Result<io::Result<AuditReport>, PartsError> {
    let parts = parts.map_or(Ok(PartsFound::default()), |parts| PartsFound::join(dir, parts))?;
    Ok(audit_all(dir, options, parts))
}

fn audit_all(dir: &Path, options: AuditOptions<'_>, mut parts: PartsFound) -> io::Result<AuditReport> {
    let tree = walk::walk_tree(dir)?;
    let bytes = parts.bytes(dir, &tree.files);
    let (mut faults, mut written_by, mut scenes) = (tree.oddities, None, 0);
    let mut exports = None;
    let signed_by = read_signature(dir, &mut faults);
    // Without `SHA256SUMS` no file can be trusted, so none is opened.
    if let Some(sums) = sums::read_sums(dir, &mut faults) {
        let unknown = BTreeSet::new();
        let composed = options.composed.unwrap_or(&unknown);
        let tree = TrustedTree { dir, intact: bytes::intact_files(&bytes, &sums), composed };
        let manifest: Option<ReleaseManifest> =
            claims::parse_claims(&tree, gs2e_release::manifest::NAME, &mut faults);
        let b3 = sums::read_b3(&tree, &sums, &mut faults);
        bytes::compare_bytes(
            &bytes,
            &bytes::StatedBytes::new(&sums, b3.as_ref(), manifest.as_ref()),
            &mut faults,
        );
        if let Some(manifest) = &manifest {
            written_by = Some(manifest.tool.clone()).filter(|tool| tool != gs2e_release::TOOL);
            scenes = manifest.scenes.len();
            exports = exports::covered(manifest, options.exporter);
            faults.extend(audit_scenes(&tree, manifest, options, &parts)?);
            let owners = FileOwners::new(manifest);
            faults = faults.into_iter().map(|fault| fault.placed(&owners)).collect();
        } else if !tree.has(gs2e_release::manifest::NAME) {
            let message = "every release has this file; it is missing or damaged";
            faults.push(AuditFault::of_file(FaultCode::Missing, gs2e_release::manifest::NAME, message));
        }
    }
    let faults = sorted_faults(faults);
    let read = bytes.values().flatten();
    let listed = options.takedown.map(|_| "scenes against the takedown list");
    let covers = COVERS.into_iter().chain(exports).chain(listed).collect();
    let size = read.map(|hashes| hashes.size).sum();
    let (rebuilt_scenes, verified) = (0, false);
    let files = bytes.len();
    Ok(AuditReport {
        faults,
        files,
        bytes: size,
        covers,
        written_by,
        scenes,
        rebuilt_scenes,
        signed_by,
        verified,
    })
}

/// The key that the signature of the release names, if there is a signature.
fn read_signature(dir: &Path, faults: &mut Vec<AuditFault>) -> Option<String> {
    let because = match ReleaseSignature::read(dir).transpose()? {
        Ok(Ok(signature)) => return Some(signature.key_id()),
        Ok(Err(because)) => because,
        Err(error) => error.to_string(),
    };
    faults.push(AuditFault::of_file(FaultCode::SignatureInvalid, signature::NAME, because));
    None
}

/// Reads and hashes every byte below `dir`, and returns the number of bytes. This is the first of
/// the audit's two passes.
///
/// # Errors
/// The folder cannot be listed, or a file cannot be read.
pub fn read_tree(dir: &Path) -> io::Result<u64> {
    let tree = walk::walk_tree(dir)?;
    let unreadable = || io::Error::other("a file cannot be read");
    bytes::hash_files(dir, &tree.files)
        .into_values()
        .map(|hashes| Ok(hashes.ok_or_else(unreadable)?.size))
        .sum()
}

fn audit_scenes(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    options: AuditOptions<'_>,
    parts: &PartsFound,
) -> io::Result<Vec<AuditFault>> {
    let (mut faults, mut scenes) = (Vec::new(), Vec::new());
    let owners = &FileOwners::new(manifest);
    for listed in &manifest.scenes {
        let path = format!("{}/{}", listed.id, layout::SCENE);
        // Index of this scene in `scenes`, which it enters only if it can be read.
        let known = scenes.len();
        if !tree.has(&path) {
            faults.push(AuditFault::of_scene(
                FaultCode::SceneIncomplete,
                &listed.id,
                "its scene.json is missing or damaged",
            ));
        } else if let Some(scene) = claims::parse_claims::<SceneRecord>(tree, &path, &mut faults) {
            faults.extend(claims::audit_scene(manifest, listed, &scene));
            faults.extend(terms::scene_terms(&scene, tree, owners));
            match parts.contents(&scene.id) {
                Some(found) => faults.extend_from_slice(found),
                None => faults.extend(contents::audit_scene(tree, &scene)),
            }
            faults.extend(steps::audit(manifest, listed, &scene));
            scenes.push(scene);
        }
        // A listed scene is found by its id even if its own description cannot be read.
        faults.extend(
            options.takedown.and_then(|list| takedown::takedown_fault(list, listed, scenes.get(known))),
        );
    }
    faults.extend(splits::audit_splits(manifest, &scenes));
    faults.extend(names::audit(tree, manifest, &scenes));
    faults.extend(exports::audit(tree, manifest, &scenes));
    // After the other checks, since it skips every scene that has a fault by now.
    let published = published(tree, manifest, &scenes, &mut faults);
    if let Some(exporter) = options.exporter {
        faults.extend(exports::compare_reexports(tree, manifest, published.as_deref(), exporter)?);
    }
    faults.extend(top(tree, manifest, &scenes, published.as_deref(), &faults));
    Ok(faults)
}

/// Reads the scenes back from their files, and adds the faults of files that follow from others.
/// Returns `None` if another version wrote the release or if a scene has any fault: files that
/// follow from that scene would only repeat the fault.
fn published(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
    faults: &mut Vec<AuditFault>,
) -> Option<Vec<PublishedScene>> {
    // Another version composes other bytes, so a difference would prove nothing.
    if manifest.tool != gs2e_release::TOOL {
        return None;
    }
    let scenes: BTreeMap<&str, &SceneRecord> =
        scenes.iter().map(|scene| (scene.id.as_str(), scene)).collect();
    let owners = &FileOwners::new(manifest);
    let read = |listed: &ManifestScene| -> (Option<PublishedScene>, Vec<AuditFault>) {
        let sound = faults.iter().all(|fault| !fault.concerns(&listed.id, owners));
        let Some(scene) = scenes.get(listed.id.as_str()).filter(|_| sound) else { return (None, Vec::new()) };
        let mut found = Vec::new();
        let read = recompose::read(tree, listed, scene, &mut found);
        found.extend(read.iter().flat_map(|scene| recompose::scene(tree, listed, scene)));
        (read.filter(|_| found.is_empty()), found)
    };
    let (read, found): (Vec<Option<PublishedScene>>, Vec<Vec<AuditFault>>) =
        manifest.scenes.par_iter().map(read).unzip();
    faults.extend(found.into_iter().flatten());
    // Terms of no scenes cannot be composed.
    read.into_iter().collect::<Option<Vec<_>>>().filter(|scenes| !scenes.is_empty())
}

/// Faults of the files at the top. They are composed again from `published`. Where that is not possible, or
/// some bytes differ, they are judged by the statements that they share with other files.
fn top(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
    published: Option<&[PublishedScene]>,
    known: &[AuditFault],
) -> Vec<AuditFault> {
    let mut faults = terms::text_faults(manifest, tree);
    // The loader and the licence texts do not depend on the scenes, so they are always compared.
    if manifest.tool == gs2e_release::TOOL {
        faults.extend(recompose::constants(tree));
    }
    // Card and report follow from the manifest too, so its faults would show up again in them.
    let is_of_manifest = |fault: &AuditFault| fault.file.as_deref() == Some(gs2e_release::manifest::NAME);
    let is_sound = !known.iter().chain(&faults).any(is_of_manifest);
    let composed = published.filter(|_| is_sound).map(|scenes| recompose::top(tree, manifest, scenes));
    let is_composed = composed.as_ref().is_some_and(Vec::is_empty);
    faults.extend(composed.into_iter().flatten());
    if !is_composed {
        let index = index::read_index(tree, &mut faults);
        // The index repeats every scene, so it is compared only if all of them could be read.
        let compared = index.iter().filter(|_| scenes.len() == manifest.scenes.len());
        faults.extend(compared.flat_map(|table| index::compare_index(tree, table, scenes)));
        faults.extend(croissant::audit_croissant(tree, manifest, index.as_ref(), scenes));
        faults.extend(terms::repeated_terms(tree, manifest, scenes));
    }
    faults
}

/// Sorts faults, each once, without [`FaultCode::NotComposed`] of files that have a more specific fault.
fn sorted_faults(mut faults: Vec<AuditFault>) -> Vec<AuditFault> {
    let reported: BTreeSet<String> = faults
        .iter()
        .filter(|fault| fault.code != FaultCode::NotComposed)
        .filter_map(|fault| fault.file.clone())
        .collect();
    let is_echo = |fault: &AuditFault| {
        fault.code == FaultCode::NotComposed
            && fault.file.as_ref().is_some_and(|file| reported.contains(file))
    };
    faults.retain(|fault| !is_echo(fault));
    faults.sort();
    faults.dedup();
    faults
}
