//! Inventory of a dataset tree: the folders that are scenes of a kind, and the reasons why some
//! cannot be used.

mod rules;

pub(super) use rules::ScenePath;
pub use rules::{AcceptanceRules, RejectionReason};

use super::kind::CaptureKind;
use super::{SourceError, SourceWarning, photo};
use gs2e_files::natural;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use walkdir::WalkDir;

/// Maximum depth of scenes below the root of the tree. DL3DV groups scenes in folders of a
/// thousand; private captures have their own folder structure.
const DEEPEST: usize = 3;

/// A scene of the tree.
#[derive(Debug)]
pub struct InventoryScene {
    /// Id within the dataset: `class/instance`, 64 hexadecimal digits, or the path in the tree.
    pub name: String,
    /// Its folder.
    pub path: PathBuf,
    /// Warnings for the user, or the reason why the scene cannot be used.
    pub verdict: Result<Vec<SourceWarning>, RejectionReason>,
}

/// Lists the scenes of this kind in the tree at `root`, sorted by name in natural order.
///
/// # Errors
/// The tree cannot be listed.
pub fn take_inventory(
    kind: CaptureKind,
    root: &Path,
    rules: &AcceptanceRules,
) -> Result<Vec<InventoryScene>, SourceError> {
    let mut found = kind.as_layout().scenes(root, &rules.classes)?;
    // Scenes of the same name sort by path, so that the same one is kept on every machine.
    found.sort_by(|a, b| natural::compare_names(&a.name, &b.name).then_with(|| a.path.cmp(&b.path)));
    let mut entries: Vec<InventoryScene> =
        found.into_par_iter().map(|found| found.judged(kind, rules)).collect();
    for i in 1..entries.len() {
        if entries[i].name == entries[i - 1].name {
            entries[i].verdict = Err(RejectionReason::Twice(entries[i - 1].path.clone()));
        }
    }
    Ok(entries)
}

/// Finds folders that contain a capture, without descending into them. The root itself may be one.
pub(super) fn capture_folders(
    root: &Path,
    is_scene: &dyn Fn(&Path) -> bool,
) -> Result<Vec<ScenePath>, SourceError> {
    // The walk below skips folders that cannot be read, but the root itself must be readable.
    std::fs::read_dir(root).map_err(SourceError::io_error(root))?;
    let mut found = Vec::new();
    let mut walk =
        WalkDir::new(root).max_depth(DEEPEST).same_file_system(true).sort_by_file_name().into_iter();
    while let Some(entry) = walk.next() {
        let Some(entry) = entry.ok().filter(|entry| entry.file_type().is_dir()) else { continue };
        if !is_scene(entry.path()) {
            continue;
        }
        // A capture may contain folders that look like captures of their own.
        walk.skip_current_dir();
        found.push(scene_path(root, entry.into_path()));
    }
    Ok(found)
}

/// A folder in the tree at `root`, named by its path there.
fn scene_path(root: &Path, path: PathBuf) -> ScenePath {
    let below = path.strip_prefix(root).unwrap_or(Path::new(""));
    // A root may be given as `.` or `..`, which is no name.
    let own = root.canonicalize().ok().and_then(|root| root.file_name().map(PathBuf::from));
    let named = if below.as_os_str().is_empty() { own.unwrap_or_default() } else { below.to_owned() };
    let parts: Vec<_> = named.iter().map(|part| part.to_string_lossy()).collect();
    ScenePath { name: parts.join("/"), path, misnamed: None }
}

/// Adds the folders with photos, there or in `images`, that contain no scene and are in none. They are
/// rejected later, by the files that they lack. A tree without a scene stays empty.
pub(super) fn add_photo_folders(root: &Path, found: &mut Vec<ScenePath>) {
    if found.is_empty() {
        return;
    }
    let scenes: Vec<PathBuf> = found.iter().map(|scene| scene.path.clone()).collect();
    let mut walk = WalkDir::new(root)
        .min_depth(1)
        .max_depth(DEEPEST)
        .same_file_system(true)
        .sort_by_file_name()
        .into_iter();
    while let Some(entry) = walk.next() {
        let Some(entry) = entry.ok().filter(|entry| entry.file_type().is_dir()) else { continue };
        let folder = entry.path();
        let is_scene = scenes.iter().any(|scene| folder.starts_with(scene));
        let holds_scene = || scenes.iter().any(|scene| scene.starts_with(folder));
        let has_photos = || photo::has_photos(folder) || photo::has_photos(&folder.join("images"));
        if is_scene {
            walk.skip_current_dir();
        } else if !holds_scene() && has_photos() {
            walk.skip_current_dir();
            found.push(scene_path(root, entry.into_path()));
        }
    }
}

/// Lists the subfolders of a folder by name. Names that are not UTF-8 are skipped; no dataset has
/// them.
pub(super) fn list_subfolders(dir: &Path) -> Result<Vec<(String, PathBuf)>, SourceError> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(SourceError::io_error(dir))? {
        let path = entry.map_err(SourceError::io_error(dir))?.path();
        let name = path.file_name().and_then(|name| name.to_str()).map(str::to_owned);
        found.extend(name.filter(|_| path.is_dir()).map(|name| (name, path)));
    }
    Ok(found)
}
