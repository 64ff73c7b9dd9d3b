//! The audit of a release tree: is it whole, lawful and consistent?
//!
//! It needs no network and no store, trusts no stat cache, and reads every byte: once for both hashes, files in
//! parallel, and a second time what it opens (events, poses, pictures, reports). What it finds is a list of faults,
//! sorted, each with a code, the file or scene, and what to do. What it does not cover it says: [`Report::covers`]
//! is the whole list.

mod bytes;
mod claims;
mod contents;
mod croissant;
mod index;
pub mod rebuilt;
mod splits;
mod sums;
mod takedown;
mod terms;
mod walk;

use super::manifest::Manifest;
use super::scene::SceneFile;
use crate::recipe::Takedown;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// What kind of fault it is. Codes are stable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Code {
    /// A listed file is not there.
    Missing,
    /// Bytes that neither the sums nor the manifest state; or a sums file that is not in its one form.
    Altered,
    /// Something that no list names.
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
    /// What a scene states is no licence expression.
    LicenceInvalid,
    /// Terms that the scene's source does not allow.
    LicenceForbidden,
    /// A licence in use has no text in `LICENSES/`.
    LicenceTextMissing,
    /// A text in `LICENSES/` is of no licence in use.
    LicenceUnused,
    /// A scene is there that is on the takedown list.
    Takedown,
    /// A scene is in another split than the rule of the release puts it in, or two splits have something in common.
    SplitLeak,
    /// The card states other terms than the scenes do.
    CardLicence,
    /// A field that `croissant.json` must have is absent, or says what it cannot say.
    CroissantField,
    /// `croissant.json` has a field that its vocabulary has not.
    CroissantUnknown,
    /// `croissant.json` states other terms than the scenes do.
    CroissantLicence,
    /// A file that `croissant.json` names is not there, or not what it says.
    CroissantSum,
    /// A set of files in `croissant.json` is empty.
    CroissantFiles,
    /// An id in `croissant.json` names nothing, or two things.
    CroissantReference,
    /// A column or path that `croissant.json` names does not exist, or holds another type.
    CroissantColumn,
    /// A scene lacks a file that its own description asks for.
    SceneIncomplete,
    /// A check failed, and no waiver says why that is accepted.
    CheckFailedUnwaived,
    /// A file does not hold what its format prescribes.
    Unreadable,
    /// Made again from its recipe, a scene has other bytes.
    RebuiltDiffers,
}

impl Code {
    /// Its name.
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
            Self::SceneIncomplete => "scene-incomplete",
            Self::CheckFailedUnwaived => "check-failed-unwaived",
            Self::Unreadable => "unreadable",
            Self::RebuiltDiffers => "rebuilt-differs",
        }
    }

    fn help(self) -> &'static str {
        match self {
            Self::Unlisted => "remove it, or keep it outside the release",
            Self::LicenceMissing | Self::LicenceInvalid | Self::LicenceForbidden => {
                "correct `licence:` or the source in the recipe, and release again"
            }
            Self::RebuiltDiffers => {
                "release it again; where every key is the same, the program or the machine is not deterministic: report it"
            }
            Self::Takedown => {
                "release again with the list beside the recipes, and withdraw what was passed on"
            }
            Self::CheckFailedUnwaived => "mend the scene, or waive the check with a reason in its recipe",
            _ => {
                "copy the release again from where it is whole, or write it anew: gs2e release --to DIR --replace"
            }
        }
    }
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Fault {
    /// What kind it is.
    pub code: Code,
    /// Path below the release folder, where it is about one file.
    pub file: Option<String>,
    /// Scene id, where it is about one scene.
    pub scene: Option<String>,
    /// What was found and what was wanted.
    pub message: String,
    /// What to do.
    pub help: &'static str,
}

impl Fault {
    fn of_file(code: Code, file: &str, message: impl Into<String>) -> Self {
        Self { code, file: Some(file.to_owned()), scene: None, message: message.into(), help: code.help() }
    }

    fn of_scene(code: Code, scene: &str, message: impl Into<String>) -> Self {
        Self { code, file: None, scene: Some(scene.to_owned()), message: message.into(), help: code.help() }
    }

    fn in_scene(self, scene: &str) -> Self {
        Self { scene: Some(scene.to_owned()), ..self }
    }

    /// With the scene that its file belongs to: the longest id that the path begins with.
    fn placed(self, manifest: &Manifest) -> Self {
        let Some(file) = self.file.as_deref().filter(|_| self.scene.is_none()) else { return self };
        let below = |id: &str| file.strip_prefix(id).is_some_and(|rest| rest.starts_with('/'));
        let ids = manifest.scenes.iter().map(|scene| scene.id.as_str()).filter(|id| below(id));
        let scene = ids.max_by_key(|id| id.len()).map(str::to_owned);
        Self { scene, ..self }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = self.file.as_ref().or(self.scene.as_ref()).map_or("the release", String::as_str);
        write!(f, "{}: {place}: {}; help: {}", self.code.name(), self.message, self.help)
    }
}

/// What an audit found.
#[derive(Debug, Clone)]
pub struct Report {
    /// The faults, sorted by code, file and scene.
    pub faults: Vec<Fault>,
    /// Files that were read.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// All that was looked at.
    pub covers: Vec<&'static str>,
}

const COVERS: [&str; 10] = [
    "every byte against SHA256SUMS, B3SUMS and manifest.json",
    "nothing missing, nothing unlisted",
    "paths",
    "scene.json against manifest.json and the recipe in it",
    "index.parquet against scene.json, speed.json and checks.json",
    "croissant.json: its fields, and what it says of files, columns and terms",
    "licence expressions, their texts and evidence, what sources demand; REUSE.toml and DATASHEET.md against them",
    "splits: each scene where the rule puts it, no group, photo or Gaussians in two of them",
    "failed checks",
    "events, poses, stamps, transforms and pictures open and agree",
];

/// Audits the release in `dir`.
///
/// Only files whose bytes are those of the sums are opened: what an altered file says is nobody's claim.
///
/// # Errors
/// When the folder cannot be listed. A file that cannot be read is a fault.
pub fn audit(dir: &Path) -> io::Result<Report> {
    audit_against(dir, None)
}

/// Audits the release in `dir`, and whether it holds a scene of a takedown list.
///
/// # Errors
/// As [`audit`].
pub fn audit_against(dir: &Path, takedown: Option<&Takedown>) -> io::Result<Report> {
    let tree = walk::walk(dir)?;
    let bytes = bytes::hash(dir, &tree.files);
    let mut faults = tree.oddities;
    if let Some(sums) = sums::read(dir, &mut faults) {
        let tree = Tree { dir, intact: bytes::intact(&bytes, &sums) };
        let manifest: Option<Manifest> = claims::parse(&tree, super::manifest::NAME, &mut faults);
        let b3 = sums::read_b3(&tree, &sums, &mut faults);
        bytes::compare(&bytes, &bytes::Stated::new(&sums, b3.as_ref(), manifest.as_ref()), &mut faults);
        if let Some(manifest) = &manifest {
            faults.extend(audit_scenes(&tree, manifest, takedown));
            faults = faults.into_iter().map(|fault| fault.placed(manifest)).collect();
        }
    }
    faults.sort();
    faults.dedup();
    let read = bytes.values().flatten();
    let covers = COVERS.into_iter().chain(takedown.map(|_| "scenes against the takedown list")).collect();
    Ok(Report { faults, files: bytes.len(), bytes: read.map(|hashes| hashes.size).sum(), covers })
}

/// Reads and hashes every byte below `dir`, which is the first of the audit's two passes, and says how many there are.
///
/// # Errors
/// When the folder cannot be listed, or a file not be read.
pub fn read(dir: &Path) -> io::Result<u64> {
    let tree = walk::walk(dir)?;
    let unreadable = || io::Error::other("a file cannot be read");
    bytes::hash(dir, &tree.files).into_values().map(|hashes| Ok(hashes.ok_or_else(unreadable)?.size)).sum()
}

/// The part of a tree that can be trusted to be what was released.
#[derive(Debug)]
struct Tree<'a> {
    dir: &'a Path,
    /// Files whose bytes are those of the sums, with their SHA-256.
    intact: BTreeMap<&'a str, &'a str>,
}

impl Tree<'_> {
    fn has(&self, path: &str) -> bool {
        self.intact.contains_key(path)
    }

    fn path_of(&self, path: &str) -> PathBuf {
        self.dir.join(path)
    }
}

fn audit_scenes(tree: &Tree<'_>, manifest: &Manifest, takedown: Option<&Takedown>) -> Vec<Fault> {
    let (mut faults, mut scenes) = (Vec::new(), Vec::new());
    for listed in &manifest.scenes {
        let path = format!("{}/scene.json", listed.id);
        let known = scenes.len();
        if !tree.has(&path) {
            faults.push(Fault::of_scene(
                Code::SceneIncomplete,
                &listed.id,
                "it has no scene.json that is whole",
            ));
        } else if let Some(scene) = claims::parse::<SceneFile>(tree, &path, &mut faults) {
            faults.extend(claims::scene(manifest, listed, &scene));
            faults.extend(terms::scene(&scene, tree));
            faults.extend(contents::scene(tree, &scene));
            scenes.push(scene);
        }
        faults.extend(takedown.and_then(|list| takedown::scene(list, listed, scenes.get(known))));
    }
    let index = index::read(tree, &mut faults);
    let compared = index.iter().filter(|_| scenes.len() == manifest.scenes.len());
    faults.extend(compared.flat_map(|table| index::compare(tree, table, &scenes)));
    faults.extend(croissant::audit(&croissant::Subject {
        tree,
        manifest,
        index: index.as_ref(),
        scenes: &scenes,
    }));
    faults.extend(splits::audit(manifest, &scenes));
    faults.extend(terms::texts(manifest, tree));
    faults.extend(terms::card(tree, manifest));
    faults.extend(terms::files(tree, manifest, &scenes));
    faults
}
