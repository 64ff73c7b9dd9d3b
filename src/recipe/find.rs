//! From files and folders to recipes: all are read, and every fault is found, before anything runs.

use super::Recipe;
use super::clash::clashes;
use super::fault::{Fault, Faults};
use super::load::{Library, words};
use crate::escape;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use walkdir::{DirEntry, WalkDir};

/// Defaults of the recipes below its folder.
pub(super) const DEFAULTS: &str = "defaults.yaml";
/// What the release is called, beside the recipes.
pub(super) const RELEASE: &str = "release.yaml";
/// What may be passed on, beside the recipes.
pub(super) const SOURCES: &str = "sources.yaml";
/// What is no longer made or passed on, beside the recipes.
pub(super) const TAKEDOWN: &str = "takedown.txt";

/// A recipe file that was found, not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct RecipeFile {
    /// The file, as the user named it or its folder.
    pub path: PathBuf,
    /// The defaults that lie under it.
    pub defaults: Option<PathBuf>,
}

impl RecipeFile {
    /// Both paths in one text: what this recipe is, as long as no file moves.
    #[must_use]
    pub fn name(&self) -> String {
        let defaults = self.defaults.as_deref().unwrap_or(Path::new(""));
        format!("{}\0{}", escape::path(&self.path), escape::path(defaults))
    }
}

/// Finds the recipes of files and folders, each once, in no promised order.
///
/// A folder stands for every `.yaml` and `.yml` file below it but `defaults.yaml`, `sources.yaml`, `release.yaml` and
/// hidden ones. Under each recipe the nearest `defaults.yaml` is merged, upward to the folder that was given, or beside
/// the file that was given.
///
/// # Errors
/// When a path is no recipe, or a folder cannot be searched or holds none.
pub fn find_all(paths: &[PathBuf]) -> Result<Vec<RecipeFile>, Faults> {
    let (found, faults) = find(paths);
    Faults::or(found, faults)
}

/// Reads the recipes of files and folders, sorted by scene id; see [`find_all`] for which they are.
///
/// # Errors
/// Every fault of every recipe, the first [`super::LISTED`] of them in full: files that cannot be read or parsed,
/// fields that are unknown, missing, out of range or not built yet, and scenes that share an id or a folder.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Recipe>, Faults> {
    let (found, faults) = find(paths);
    read_after(&found, faults)
}

/// Reads recipes that were found, sorted by scene id.
///
/// # Errors
/// As [`read_all`].
pub fn read_files(files: &[RecipeFile]) -> Result<Vec<Recipe>, Faults> {
    read_after(files, Vec::new())
}

fn read_after(files: &[RecipeFile], mut faults: Vec<Fault>) -> Result<Vec<Recipe>, Faults> {
    let library = Library::of(files);
    let results: Vec<_> = files.par_iter().map(|file| library.recipe(file)).collect();
    let mut read = Vec::with_capacity(files.len());
    for result in results {
        match result {
            Ok(recipe) => read.push(recipe),
            Err(more) => faults.extend(more),
        }
    }
    read.sort_by(|a, b| (&a.recipe.scene, &a.recipe.file.path).cmp(&(&b.recipe.scene, &b.recipe.file.path)));
    faults.extend(clashes(&read));
    let recipes = read.into_iter().map(|read| read.recipe).collect();
    Faults::or(recipes, faults)
}

/// The recipe files that paths stand for, each once.
fn find(paths: &[PathBuf]) -> (Vec<RecipeFile>, Vec<Fault>) {
    let (mut found, mut faults) = (Found::default(), Vec::new());
    for path in paths {
        let no_recipe = [DEFAULTS, RELEASE, SOURCES, TAKEDOWN]
            .iter()
            .any(|name| path.file_name().is_some_and(|n| n == *name));
        if path.is_dir() {
            walk(path, &mut found, &mut faults);
        } else if no_recipe {
            faults.push(Fault::of_file(path, "this file is no recipe", Some("name a recipe, or its folder")));
        } else {
            found.add(path.clone(), &folder(path));
        }
    }
    (found.files, faults)
}

/// What was found so far.
#[derive(Default)]
struct Found {
    files: Vec<RecipeFile>,
    /// Device and inode of each file that is there: links and repetitions lead to one.
    known: BTreeSet<(u64, u64)>,
    /// The defaults of each folder and topmost folder.
    defaults: BTreeMap<(PathBuf, PathBuf), Option<PathBuf>>,
}

impl Found {
    /// Adds a recipe, whose defaults are looked for from its own folder up to `root`.
    fn add(&mut self, path: PathBuf, root: &Path) {
        let about = std::fs::metadata(&path);
        if about.is_ok_and(|about| !self.known.insert((about.dev(), about.ino()))) {
            return;
        }
        let place = (folder(&path), root.to_owned());
        let defaults = self.defaults.entry(place).or_insert_with_key(|(folder, root)| {
            let folders = folder.ancestors().take_while(|folder| folder.starts_with(root));
            folders.map(|folder| folder.join(DEFAULTS)).find(|path| path.is_file())
        });
        self.files.push(RecipeFile { path, defaults: defaults.clone() });
    }
}

/// The folder that a file lies in.
pub(super) fn folder(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}

fn walk(root: &Path, found: &mut Found, faults: &mut Vec<Fault>) {
    let mut is_empty = true;
    let shown =
        |entry: &DirEntry| entry.depth() == 0 || !entry.file_name().as_encoded_bytes().starts_with(b".");
    for entry in WalkDir::new(root).follow_links(true).sort_by_file_name().into_iter().filter_entry(shown) {
        match entry {
            Ok(entry) if is_recipe(&entry) => {
                is_empty = false;
                found.add(entry.into_path(), root);
            }
            Ok(_) => {}
            Err(error) => {
                is_empty = false;
                let why =
                    error.io_error().map_or_else(|| "a link leads back to its own folder".into(), words);
                let message = format!("cannot be searched for recipes: {why}");
                faults.push(Fault::of_file(error.path().unwrap_or(root), &message, None));
            }
        }
    }
    if is_empty {
        let help = "a recipe is a .yaml file other than defaults.yaml, sources.yaml and release.yaml";
        faults.push(Fault::of_file(root, "no recipe is in this folder", Some(help)));
    }
}

fn is_recipe(entry: &DirEntry) -> bool {
    let yaml = entry.path().extension().is_some_and(|extension| extension == "yaml" || extension == "yml");
    let other = [DEFAULTS, RELEASE, SOURCES].iter().any(|name| entry.file_name() == *name);
    yaml && !other && entry.file_type().is_file()
}
