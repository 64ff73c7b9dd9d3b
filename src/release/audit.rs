//! The audit of a release tree, which must be whole, lawful and consistent.
//!
//! The audit needs no network and no store, and it trusts no stat cache. It reads every byte once
//! for both hashes, with the files in parallel. It opens events, poses, pictures and reports a
//! second time. The result is a sorted list of faults, each with a code, the file or scene, and a
//! remedy. [`AuditReport::covers`] is the whole list of what the audit covers.

mod again;
mod bytes;
mod claims;
mod contents;
pub(super) mod contradictions;
mod croissant;
mod index;
mod names;
pub mod rebuilt;
mod splits;
mod steps;
mod sums;
mod takedown;
mod terms;
mod trusted;
mod walk;

use super::layout;
use super::manifest::{FileOwners, ManifestScene, ReleaseManifest};
use super::published::PublishedScene;
use super::scene::SceneRecord;
use super::signature::{self, PublisherKey, ReleaseSignature};
use crate::recipe::TakedownList;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::path::Path;
use trusted::TrustedTree;

/// Kind of a fault. Codes are stable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultCode {
    /// A listed file is not there.
    Missing,
    /// Bytes that no list states; or a sums file that is not in its one form.
    Altered,
    /// A file that no list names, or a link, a special file or an empty folder.
    Unlisted,
    /// A path that would lead out of the tree, or that tools cannot carry.
    UnsafePath,
    /// `SHA256SUMS`, `B3SUMS`, `manifest.json` and the bytes do not agree on a file.
    SumsDisagree,
    /// Files that say the same thing say different things.
    ClaimsDisagree,
    /// Parts of the tree are of different program versions.
    VersionDisagrees,
    /// A scene states no terms.
    LicenceMissing,
    /// A scene states terms that are not a licence expression, or its source is of no known kind.
    LicenceInvalid,
    /// Terms or files that the scene's source does not allow.
    LicenceForbidden,
    /// A licence in use has no text in `LICENSES/`.
    LicenceTextMissing,
    /// A text in `LICENSES/` belongs to no licence in use.
    LicenceUnused,
    /// A scene is there that is on the takedown list.
    Takedown,
    /// A scene is not in the split that the rule of the release gives, or two splits share
    /// something.
    SplitLeak,
    /// The card states other terms than the scenes do.
    CardLicence,
    /// A field that `croissant.json` must have is absent, or has an impossible value.
    CroissantField,
    /// `croissant.json` has a field that its vocabulary does not define.
    CroissantUnknown,
    /// `croissant.json` states other terms than the scenes do.
    CroissantLicence,
    /// A file that `croissant.json` names is absent, or its size or SHA-256 differs.
    CroissantSum,
    /// A set of files in `croissant.json` is empty.
    CroissantFiles,
    /// An id in `croissant.json` names nothing, or names two things.
    CroissantReference,
    /// A column or path that `croissant.json` names does not exist, or holds another type.
    CroissantColumn,
    /// A file that the release format does not have.
    Stray,
    /// A file is not what this program composes from the other files.
    NotComposed,
    /// A step's key, inputs or outputs do not fit each other or the files.
    StepDisagrees,
    /// A scene lacks a file that its own description asks for.
    SceneIncomplete,
    /// A check failed, and no waiver says why that is accepted.
    CheckFailedUnwaived,
    /// A file does not hold what its format prescribes.
    Unreadable,
    /// A scene that is made again from its recipe has other bytes.
    RebuiltDiffers,
    /// The signature is absent, is not by the given key, or does not fit `SHA256SUMS`.
    SignatureInvalid,
}

impl FaultCode {
    /// Returns the name of the code.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Altered => "altered",
            Self::Unlisted => "unlisted",
            Self::UnsafePath => "unsafe-path",
            Self::SumsDisagree => "sums-disagree",
            Self::ClaimsDisagree => "claims-disagree",
            Self::VersionDisagrees => "version-disagrees",
            Self::LicenceMissing => "licence-missing",
            Self::LicenceInvalid => "licence-invalid",
            Self::LicenceForbidden => "licence-forbidden",
            Self::LicenceTextMissing => "licence-text-missing",
            Self::LicenceUnused => "licence-unused",
            Self::Takedown => "takedown",
            Self::SplitLeak => "split-leak",
            Self::CardLicence => "card-licence",
            Self::CroissantField => "croissant-field",
            Self::CroissantUnknown => "croissant-unknown",
            Self::CroissantLicence => "croissant-licence",
            Self::CroissantSum => "croissant-sum",
            Self::CroissantFiles => "croissant-files",
            Self::CroissantReference => "croissant-reference",
            Self::CroissantColumn => "croissant-column",
            Self::Stray => "stray",
            Self::NotComposed => "not-composed",
            Self::StepDisagrees => "step-disagrees",
            Self::SceneIncomplete => "scene-incomplete",
            Self::CheckFailedUnwaived => "check-failed-unwaived",
            Self::Unreadable => "unreadable",
            Self::RebuiltDiffers => "rebuilt-differs",
            Self::SignatureInvalid => "signature-invalid",
        }
    }

    fn help(self) -> &'static str {
        match self {
            Self::Unlisted | Self::Stray => "remove it, or keep it outside the release",
            Self::LicenceMissing | Self::LicenceInvalid | Self::LicenceForbidden => {
                "correct `licence:` or the source in the recipe, and release again"
            }
            Self::RebuiltDiffers => {
                "release it again; if all keys are the same, the program or the machine is not deterministic: report it"
            }
            Self::SignatureInvalid => {
                "ask the publisher for the public key, or for an intact copy; gs2e release --sign KEY signs a release"
            }
            Self::Takedown => {
                "release again with the list next to the recipes, and withdraw published copies"
            }
            Self::CheckFailedUnwaived => "fix the scene, or waive the check with a reason in its recipe",
            _ => {
                "copy the release again from an intact copy, or write it again: gs2e release --to DIR --replace"
            }
        }
    }
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct AuditFault {
    /// The kind of fault.
    pub code: FaultCode,
    /// Path below the release folder, if the fault concerns one file.
    pub file: Option<String>,
    /// Scene id, if the fault concerns one scene.
    pub scene: Option<String>,
    /// The found and the wanted content.
    pub message: String,
    /// The remedy.
    pub help: &'static str,
}

impl AuditFault {
    fn of_file(code: FaultCode, file: &str, message: impl Into<String>) -> Self {
        Self { code, file: Some(file.to_owned()), scene: None, message: message.into(), help: code.help() }
    }

    fn of_scene(code: FaultCode, scene: &str, message: impl Into<String>) -> Self {
        Self { code, file: None, scene: Some(scene.to_owned()), message: message.into(), help: code.help() }
    }

    fn in_scene(self, scene: &str) -> Self {
        Self { scene: Some(scene.to_owned()), ..self }
    }

    /// Returns true if the fault concerns a scene or one of its files.
    fn concerns(&self, scene: &str, owners: &FileOwners<'_>) -> bool {
        let is_owner = |file: &String| owners.of(file).is_some_and(|owner| owner.id == scene);
        self.scene.as_deref() == Some(scene) || self.file.as_ref().is_some_and(is_owner)
    }

    /// Returns the fault with the scene that its file belongs to: the longest id that the path
    /// begins with.
    fn placed(self, owners: &FileOwners<'_>) -> Self {
        let Some(file) = self.file.as_deref().filter(|_| self.scene.is_none()) else { return self };
        let scene = owners.of(file).map(|scene| scene.id.clone());
        Self { scene, ..self }
    }
}

impl fmt::Display for AuditFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = self.file.as_ref().or(self.scene.as_ref()).map_or("the release", String::as_str);
        write!(f, "{}: {place}: {}; help: {}", self.code.name(), self.message, self.help)
    }
}

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
    pub made_again: usize,
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
        if !self.faults.is_empty() {
            return vec!["The tree is damaged or inconsistent.".into()];
        }
        let mut proved = vec!["The tree is intact and consistent.".to_owned()];
        let signer = self.signed_by.as_ref().filter(|_| self.verified);
        proved.extend(signer.map(|key| format!("It is signed with the key {key}.")));
        proved.extend(self.written_by.as_ref().map(|tool| {
            format!(
                "It was written by {tool}, and this is {}: the files that program composed were not compared.",
                super::TOOL
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
        vec![match (self.made_again, self.scenes) {
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
    audit_against(dir, None)
}

/// Audits the release in `dir`, and looks for scenes of a takedown list.
///
/// # Errors
/// As [`audit_release`].
pub fn audit_against(dir: &Path, takedown: Option<&TakedownList>) -> io::Result<AuditReport> {
    let tree = walk::walk_tree(dir)?;
    let bytes = bytes::hash_files(dir, &tree.files);
    let (mut faults, mut written_by, mut scenes) = (tree.oddities, None, 0);
    let signed_by = read_signature(dir, &mut faults);
    // Without `SHA256SUMS` no file can be trusted, so none is opened.
    if let Some(sums) = sums::read_sums(dir, &mut faults) {
        let tree = TrustedTree { dir, intact: bytes::intact_files(&bytes, &sums) };
        let manifest: Option<ReleaseManifest> =
            claims::parse_claims(&tree, super::manifest::NAME, &mut faults);
        let b3 = sums::read_b3(&tree, &sums, &mut faults);
        bytes::compare_bytes(
            &bytes,
            &bytes::StatedBytes::new(&sums, b3.as_ref(), manifest.as_ref()),
            &mut faults,
        );
        if let Some(manifest) = &manifest {
            written_by = Some(manifest.tool.clone()).filter(|tool| tool != super::TOOL);
            scenes = manifest.scenes.len();
            faults.extend(audit_scenes(&tree, manifest, takedown));
            let owners = FileOwners::new(manifest);
            faults = faults.into_iter().map(|fault| fault.placed(&owners)).collect();
        } else if !tree.has(super::manifest::NAME) {
            let message = "every release has this file; it is missing or damaged";
            faults.push(AuditFault::of_file(FaultCode::Missing, super::manifest::NAME, message));
        }
    }
    let mut faults = without_echoes(faults);
    faults.sort();
    faults.dedup();
    let read = bytes.values().flatten();
    let covers = COVERS.into_iter().chain(takedown.map(|_| "scenes against the takedown list")).collect();
    let size = read.map(|hashes| hashes.size).sum();
    let (made_again, verified) = (0, false);
    let files = bytes.len();
    Ok(AuditReport {
        faults,
        files,
        bytes: size,
        covers,
        written_by,
        scenes,
        made_again,
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
    takedown: Option<&TakedownList>,
) -> Vec<AuditFault> {
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
            faults.extend(contents::audit_scene(tree, &scene));
            faults.extend(steps::audit(manifest, listed, &scene));
            scenes.push(scene);
        }
        // A listed scene is found by its id even if its own description cannot be read.
        faults.extend(takedown.and_then(|list| takedown::takedown_fault(list, listed, scenes.get(known))));
    }
    faults.extend(splits::audit_splits(manifest, &scenes));
    faults.extend(names::audit(tree, manifest, &scenes));
    // After the other checks, since it skips every scene that has a fault by now.
    let published = published(tree, manifest, &scenes, &mut faults);
    faults.extend(top(tree, manifest, &scenes));
    faults.extend(composed(tree, manifest, published.as_deref(), &faults));
    faults
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
    if manifest.tool != super::TOOL {
        return None;
    }
    let scenes: BTreeMap<&str, &SceneRecord> =
        scenes.iter().map(|scene| (scene.id.as_str(), scene)).collect();
    let owners = &FileOwners::new(manifest);
    let read = |listed: &ManifestScene| -> (Option<PublishedScene>, Vec<AuditFault>) {
        let sound = faults.iter().all(|fault| !fault.concerns(&listed.id, owners));
        let Some(scene) = scenes.get(listed.id.as_str()).filter(|_| sound) else { return (None, Vec::new()) };
        let mut found = Vec::new();
        let read = again::read(tree, listed, scene, &mut found);
        found.extend(read.iter().flat_map(|scene| again::scene(tree, listed, scene)));
        (read.filter(|_| found.is_empty()), found)
    };
    let (read, found): (Vec<Option<PublishedScene>>, Vec<Vec<AuditFault>>) =
        manifest.scenes.par_iter().map(read).unzip();
    faults.extend(found.into_iter().flatten());
    // Terms of no scenes cannot be composed.
    read.into_iter().collect::<Option<Vec<_>>>().filter(|scenes| !scenes.is_empty())
}

/// Faults of the files at the top that each file shows by itself.
fn top(tree: &TrustedTree<'_>, manifest: &ReleaseManifest, scenes: &[SceneRecord]) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let index = index::read_index(tree, &mut faults);
    // The index repeats every scene, so it is compared only if all of them could be read.
    let compared = index.iter().filter(|_| scenes.len() == manifest.scenes.len());
    faults.extend(compared.flat_map(|table| index::compare_index(tree, table, scenes)));
    faults.extend(croissant::audit_croissant(&croissant::CroissantSubject {
        tree,
        manifest,
        index: index.as_ref(),
        scenes,
    }));
    faults.extend(terms::text_faults(manifest, tree));
    faults.extend(terms::card_fault(tree, manifest));
    faults.extend(terms::reuse_faults(tree, manifest, scenes));
    faults
}

/// Faults of files that differ from what this version composes, if it wrote the release.
fn composed(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: Option<&[PublishedScene]>,
    known: &[AuditFault],
) -> Vec<AuditFault> {
    if manifest.tool != super::TOOL {
        return Vec::new();
    }
    // The loader and the licence texts do not depend on the scenes, so they are always compared.
    let mut found = again::constants(tree);
    // Card and report follow from the manifest too, so its faults would show up again in them.
    let sound = known.iter().all(|fault| fault.file.as_deref() != Some(super::manifest::NAME));
    found.extend(scenes.iter().filter(|_| sound).flat_map(|scenes| again::top(tree, manifest, scenes)));
    found
}

/// Removes [`FaultCode::NotComposed`] from files that have a more specific fault.
fn without_echoes(faults: Vec<AuditFault>) -> Vec<AuditFault> {
    let told: BTreeSet<String> = faults
        .iter()
        .filter(|fault| fault.code != FaultCode::NotComposed)
        .filter_map(|fault| fault.file.clone())
        .collect();
    let is_echo = |fault: &AuditFault| {
        fault.code == FaultCode::NotComposed && fault.file.as_ref().is_some_and(|file| told.contains(file))
    };
    faults.into_iter().filter(|fault| !is_echo(fault)).collect()
}
