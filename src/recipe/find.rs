//! From files and folders to recipes: all are read, and every fault is found, before anything runs.

use super::Recipe;
use super::clash::clashes;
use super::fault::{Fault, Faults};
use super::load::{Library, words};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use walkdir::{DirEntry, WalkDir};

/// Defaults of the recipes below its folder.
pub(super) const DEFAULTS: &str = "defaults.yaml";
/// What the release is called, beside the recipes.
pub(super) const RELEASE: &str = "release.yaml";
/// What may be passed on, beside the recipes.
pub(super) const SOURCES: &str = "sources.yaml";

/// Reads the recipes of files and folders, sorted by scene id.
///
/// A folder stands for every `.yaml` and `.yml` file below it but `defaults.yaml`, `sources.yaml`, `release.yaml` and
/// hidden ones. Under each recipe the nearest `defaults.yaml` is merged, upward to the folder that was given, or beside
/// the file that was given.
///
/// # Errors
/// Every fault of every recipe, the first [`super::LISTED`] of them in full: files that cannot be read or parsed,
/// fields that are unknown, missing, out of range or not built yet, and scenes that share an id or a folder.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Recipe>, Faults> {
    let mut library = Library::default();
    let (found, mut faults) = find(paths);
    let mut read = Vec::new();
    for (file, root) in found {
        match library.recipe(&file, &root) {
            Ok(recipe) => read.push(recipe),
            Err(more) => faults.extend(more),
        }
    }
    read.sort_by(|a, b| (&a.recipe.scene, &a.recipe.file).cmp(&(&b.recipe.scene, &b.recipe.file)));
    faults.extend(clashes(&read));
    let recipes = read.into_iter().map(|read| read.recipe).collect();
    Faults::or(recipes, faults)
}

/// A recipe file, and the topmost folder in which its defaults are looked for.
type Found = (PathBuf, PathBuf);

/// The recipe files that paths stand for, each once.
fn find(paths: &[PathBuf]) -> (Vec<Found>, Vec<Fault>) {
    let (mut found, mut faults) = (Vec::new(), Vec::new());
    for path in paths {
        let no_recipe =
            [DEFAULTS, RELEASE, SOURCES].iter().any(|name| path.file_name().is_some_and(|n| n == *name));
        if path.is_dir() {
            walk(path, &mut found, &mut faults);
        } else if no_recipe {
            faults.push(Fault::of_file(path, "this file is no recipe", Some("name a recipe, or its folder")));
        } else {
            found.push((path.clone(), folder(path)));
        }
    }
    let mut seen = BTreeSet::new();
    found.retain(|(file, _)| seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())));
    (found, faults)
}

/// The folder that a file lies in.
pub(super) fn folder(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}

fn walk(root: &Path, found: &mut Vec<Found>, faults: &mut Vec<Fault>) {
    let before = found.len() + faults.len();
    let shown =
        |entry: &DirEntry| entry.depth() == 0 || !entry.file_name().as_encoded_bytes().starts_with(b".");
    for entry in WalkDir::new(root).follow_links(true).sort_by_file_name().into_iter().filter_entry(shown) {
        match entry {
            Ok(entry) if is_recipe(&entry) => found.push((entry.into_path(), root.to_owned())),
            Ok(_) => {}
            Err(error) => {
                let why =
                    error.io_error().map_or_else(|| "a link leads back to its own folder".into(), words);
                let message = format!("cannot be searched for recipes: {why}");
                faults.push(Fault::of_file(error.path().unwrap_or(root), &message, None));
            }
        }
    }
    if found.len() + faults.len() == before {
        let help = "a recipe is a .yaml file other than defaults.yaml, sources.yaml and release.yaml";
        faults.push(Fault::of_file(root, "no recipe is in this folder", Some(help)));
    }
}

fn is_recipe(entry: &DirEntry) -> bool {
    let yaml = entry.path().extension().is_some_and(|extension| extension == "yaml" || extension == "yml");
    let other = [DEFAULTS, RELEASE, SOURCES].iter().any(|name| entry.file_name() == *name);
    yaml && !other && entry.file_type().is_file()
}
