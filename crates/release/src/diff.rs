//! Differences between two releases, and their reasons.
//!
//! They follow from the claims of the trees alone: `manifest.json` of both, and `scene.json` of the
//! scenes that differ. No blob is read, no store is opened, and nothing is built. The audit decides
//! if the claims are true.

mod values;

pub use values::{ValueChange, value_changes};

use super::manifest::{KeyIngredients, ManifestFile, ManifestScene, ManifestStep, ReleaseManifest};
use super::scene::SceneRecord;
use gs2e_store::Digest;
use gs2e_tree::{TreeError, read_manifest, read_scene};
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The differences between an old and a new release.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReleaseDifference {
    /// Statements of the releases on themselves: name, version, tool, licence.
    pub release: Vec<ValueChange>,
    /// Files that belong to no scene, by path.
    pub files: Vec<FileChange>,
    /// Scenes that only the new release has, by id.
    pub added: Vec<SceneSize>,
    /// Scenes that only the old release has, by id.
    pub removed: Vec<SceneSize>,
    /// Scenes that both have and that differ, by id.
    pub changed: Vec<SceneChange>,
    /// Number of scenes that are the same in both.
    pub unchanged: usize,
}

/// A scene that only one release has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SceneSize {
    /// Scene id.
    pub id: String,
    /// Number of its files.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
}

/// A scene that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneChange {
    /// Scene id.
    pub id: String,
    /// Values of the merged recipe.
    pub recipe: Vec<ValueChange>,
    /// Photos of the source, by name and SHA-256.
    pub photos: Vec<ValueChange>,
    /// Claims of the manifest on the scene: kind of source, licence, checks, waivers, work left out
    /// of rendering.
    pub claims: Vec<ValueChange>,
    /// Steps with another key or other bytes, in the order of the new release, followed by those
    /// that the new release lacks.
    pub steps: Vec<StepChange>,
    /// Its files, by path.
    pub files: Vec<FileChange>,
}

/// A file that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FileChange {
    /// Path below the release folder.
    pub path: String,
    /// Length in the old release in bytes; `None` if the file was absent.
    pub old: Option<u64>,
    /// Length in the new release in bytes; `None` if the file is absent.
    pub new: Option<u64>,
}

/// A step that differs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct StepChange {
    /// Its name within the scene.
    pub step: String,
    /// Name of its stage.
    pub stage: String,
    /// True if it made the same bytes nevertheless.
    pub same_bytes: bool,
    /// Reasons for the difference.
    pub reasons: Vec<DiffReason>,
}

/// Reason why a step differs. The codes are those of `plan`, if it has them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "code", rename_all = "kebab-case")]
pub enum DiffReason {
    /// Only the new release has the step.
    StepAdded,
    /// Only the old release has the step.
    StepRemoved,
    /// Another revision of the stage made it.
    Revision {
        /// Old value.
        old: u32,
        /// New value.
        new: u32,
    },
    /// Another numerical class made it.
    Class {
        /// Old value.
        old: Option<String>,
        /// New value.
        new: Option<String>,
    },
    /// It has other parameters: the recipe values that differ, or another reading of equal ones.
    ParamsChanged,
    /// It was made from another input.
    InputChanged {
        /// Its role; a file of the source is `file NAME`.
        name: String,
        /// Old digest; `None` if there was no digest.
        old: Option<Digest>,
        /// New digest; `None` if there is no digest.
        new: Option<Digest>,
    },
    /// One key made two different contents.
    Nondeterministic,
    /// The releases do not contain the reason: an older program wrote one of them, or the same
    /// parts are hashed in another way now.
    Untold,
}

/// Compares the releases in two folders.
///
/// # Errors
/// One of them is not a release, or a `scene.json` that is needed for the reasons cannot be read.
pub fn diff_releases(old: &Path, new: &Path) -> Result<ReleaseDifference, TreeError> {
    let [before, after]: [ReleaseManifest; 2] = [read_manifest(old)?, read_manifest(new)?];
    let id = |scene: &ManifestScene| scene.id.clone();
    let mut difference = ReleaseDifference {
        release: value_changes(&claimed_values(&before), &claimed_values(&after)),
        files: file_changes(&before.files, &after.files),
        added: Vec::new(),
        removed: Vec::new(),
        changed: Vec::new(),
        unchanged: 0,
    };
    for pair in pair_named(&before.scenes, &after.scenes, id) {
        match pair {
            (None, Some(scene)) => difference.added.push(scene_size(scene)),
            (Some(scene), None) => difference.removed.push(scene_size(scene)),
            (Some(a), Some(b)) if a != b => {
                // Equal manifest entries list equal files, so `scene.json` is read for different
                // ones only.
                let [a_file, b_file]: [SceneRecord; 2] = [read_scene(old, &a.id)?, read_scene(new, &b.id)?];
                difference.changed.push(scene_change([a, b], [&a_file, &b_file]));
            }
            _ => difference.unchanged += 1,
        }
    }
    Ok(difference)
}

/// Elements of two lists with the same name, sorted by name.
fn pair_named<'a, T, K: Ord>(
    old: &'a [T],
    new: &'a [T],
    name: impl Fn(&T) -> K,
) -> Vec<(Option<&'a T>, Option<&'a T>)> {
    let by_name = |list: &'a [T]| list.iter().map(|x| (name(x), x)).collect::<BTreeMap<K, &'a T>>();
    let (old, new) = (by_name(old), by_name(new));
    let names: BTreeSet<&K> = old.keys().chain(new.keys()).collect();
    names.into_iter().map(|name| (old.get(name).copied(), new.get(name).copied())).collect()
}

/// Claims other than the lists that are compared one by one.
fn claimed_values<T: Serialize>(listed: &T) -> Value {
    let mut value = serde_json::to_value(listed).expect("a manifest is plain data");
    if let Some(fields) = value.as_object_mut() {
        fields.retain(|name, _| !["id", "scenes", "steps", "files"].contains(&name.as_str()));
    }
    value
}

fn scene_size(scene: &ManifestScene) -> SceneSize {
    let bytes = scene.files.iter().map(|file| file.size).sum();
    SceneSize { id: scene.id.clone(), files: scene.files.len(), bytes }
}

fn file_changes(old: &[ManifestFile], new: &[ManifestFile]) -> Vec<FileChange> {
    let pairs = pair_named(old, new, |file| file.path.clone()).into_iter().filter(|(old, new)| old != new);
    let change = |(old, new): (Option<&ManifestFile>, Option<&ManifestFile>)| {
        let path = new.or(old).map(|file| file.path.clone())?;
        Some(FileChange { path, old: old.map(|file| file.size), new: new.map(|file| file.size) })
    };
    pairs.filter_map(change).collect()
}

fn scene_change([old, new]: [&ManifestScene; 2], [old_file, new_file]: [&SceneRecord; 2]) -> SceneChange {
    let photos = |file: &SceneRecord| -> Value {
        file.images.iter().map(|photo| (photo.name.clone(), Value::from(photo.sha256.clone()))).collect()
    };
    SceneChange {
        id: new.id.clone(),
        recipe: value_changes(&old_file.recipe, &new_file.recipe),
        photos: value_changes(&photos(old_file), &photos(new_file)),
        claims: value_changes(&claimed_values(old), &claimed_values(new)),
        steps: step_changes(&old.steps, &new.steps),
        files: file_changes(&old.files, &new.files),
    }
}

fn step_changes(old: &[ManifestStep], new: &[ManifestStep]) -> Vec<StepChange> {
    let there = new.iter().filter_map(|step| match old.iter().find(|s| s.step == step.step) {
        None => Some(StepChange::new(step, false, vec![DiffReason::StepAdded])),
        Some(before) => step_change(before, step),
    });
    let gone = old.iter().filter(|step| new.iter().all(|s| s.step != step.step));
    let gone = gone.map(|step| StepChange::new(step, false, vec![DiffReason::StepRemoved]));
    there.chain(gone).collect()
}

impl StepChange {
    fn new(step: &ManifestStep, same_bytes: bool, reasons: Vec<DiffReason>) -> Self {
        Self { step: step.step.clone(), stage: step.stage.clone(), same_bytes, reasons }
    }
}

fn step_change(old: &ManifestStep, new: &ManifestStep) -> Option<StepChange> {
    let same_bytes = old.outputs == new.outputs;
    let reasons = match (&old.made_of, &new.made_of) {
        // One key promises one content, so other bytes under the same key are a fault of their own.
        _ if old.key == new.key && same_bytes => return None,
        _ if old.key == new.key => vec![DiffReason::Nondeterministic],
        (Some(old), Some(new)) => change_reasons(old, new),
        _ => vec![DiffReason::Untold],
    };
    Some(StepChange::new(new, same_bytes, reasons))
}

/// Reasons why a step with these ingredients has another key than one with the old ones.
pub fn change_reasons(old: &KeyIngredients, new: &KeyIngredients) -> Vec<DiffReason> {
    let revision = (old.revision != new.revision)
        .then_some(DiffReason::Revision { old: old.revision, new: new.revision });
    let class = (old.class != new.class)
        .then(|| DiffReason::Class { old: old.class.clone(), new: new.class.clone() });
    let params = (old.params != new.params).then_some(DiffReason::ParamsChanged);
    let roles: BTreeSet<&String> = old.inputs.keys().chain(new.inputs.keys()).collect();
    let inputs = roles.into_iter().filter_map(|name| {
        let [old, new] = [old, new].map(|side| side.inputs.get(name).copied());
        (old != new).then(|| DiffReason::InputChanged { name: name.clone(), old, new })
    });
    let known: Vec<DiffReason> = revision.into_iter().chain(class).chain(params).chain(inputs).collect();
    if known.is_empty() { vec![DiffReason::Untold] } else { known }
}
