//! Search for recipes in files and folders. All recipes are read and every fault is found before
//! anything runs.

use super::Recipe;
use super::clash::find_clashes;
use super::fault::{RecipeFault, RecipeFaults};
use super::load::{DefaultsLibrary, system_words};
use crate::escape;
use crate::files::{FolderWalk, is_there};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use walkdir::DirEntry;

/// Name of the file with defaults for the recipes in and below its folder.
pub(super) const DEFAULTS: &str = "defaults.yaml";
/// Name of the file with the description of the release.
pub(super) const RELEASE: &str = "release.yaml";
/// Name of the file with statements about redistribution.
pub(super) const SOURCES: &str = "sources.yaml";
/// Name of the file with scenes that are no longer made or redistributed.
pub(super) const TAKEDOWN: &str = "takedown.txt";

/// A recipe file that was found but not yet read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecipeFile {
    /// The file, named as the user named it or its folder.
    pub path: PathBuf,
    /// The defaults file that applies.
    pub defaults: Option<PathBuf>,
}

impl RecipeFile {
    /// Returns both paths in one text, which identifies the recipe as long as no file moves.
    #[must_use]
    pub fn name(&self) -> String {
        let defaults = self.defaults.as_deref().unwrap_or(Path::new(""));
        format!("{}\0{}", escape::path(&self.path), escape::path(defaults))
    }
}

/// Finds the recipes in files and folders, each once, in unspecified order.
///
/// A folder contributes every `.yaml` and `.yml` file in and below it, except `defaults.yaml`,
/// `sources.yaml`, `release.yaml` and hidden files. Each recipe is merged over the nearest
/// `defaults.yaml`, searched upward to the given folder, or next to the given file.
///
/// # Errors
/// A path is no recipe, or a folder cannot be searched or contains no recipe.
pub fn find_all(paths: &[PathBuf]) -> Result<Vec<RecipeFile>, RecipeFaults> {
    let (found, faults) = find_recipes(paths);
    RecipeFaults::value_or(found, faults)
}

/// Reads the recipes in files and folders, sorted by scene id. See [`find_all`] for the search.
///
/// # Errors
/// The recipes have faults: unreadable or unparsable files, fields that are unknown, missing, out
/// of range or not built yet, and scenes that share an id or a folder. The first [`super::LISTED`]
/// faults are returned in full.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Recipe>, RecipeFaults> {
    let (found, faults) = find_recipes(paths);
    read_after(&found, faults)
}

/// Reads recipes that were found, sorted by scene id.
///
/// # Errors
/// The recipes have faults; see [`read_all`].
pub fn read_files(files: &[RecipeFile]) -> Result<Vec<Recipe>, RecipeFaults> {
    read_after(files, Vec::new())
}

fn read_after(files: &[RecipeFile], mut faults: Vec<RecipeFault>) -> Result<Vec<Recipe>, RecipeFaults> {
    let library = DefaultsLibrary::read_defaults(files);
    let results: Vec<_> = files.par_iter().map(|file| library.recipe(file)).collect();
    let mut read = Vec::with_capacity(files.len());
    for result in results {
        match result {
            Ok(recipe) => read.push(recipe),
            Err(more) => faults.extend(more),
        }
    }
    // The path decides between equal ids, so that their fault is always on the same recipe.
    read.sort_by(|a, b| {
        (&a.recipe.scene, &a.recipe.meta.file.path).cmp(&(&b.recipe.scene, &b.recipe.meta.file.path))
    });
    faults.extend(find_clashes(&read));
    let recipes = read.into_iter().map(|read| read.recipe).collect();
    RecipeFaults::value_or(recipes, faults)
}

/// Returns the recipe files of these paths, each once.
fn find_recipes(paths: &[PathBuf]) -> (Vec<RecipeFile>, Vec<RecipeFault>) {
    let (mut found, mut faults) = (FoundRecipes::default(), Vec::new());
    for path in paths {
        let no_recipe = [DEFAULTS, RELEASE, SOURCES, TAKEDOWN]
            .iter()
            .any(|name| path.file_name().is_some_and(|n| n == *name));
        if path.is_dir() {
            walk_folder(path, &mut found, &mut faults);
        } else if no_recipe {
            faults.push(RecipeFault::of_file(
                path,
                "this file is not a recipe",
                Some("name a recipe, or its folder"),
            ));
        } else {
            found.add(path.clone(), &parent_folder(path));
        }
    }
    (found.files, faults)
}

/// The recipes found so far.
#[derive(Default)]
struct FoundRecipes {
    files: Vec<RecipeFile>,
    /// Device and inode of each existing file. Links and repetitions have the same pair.
    known: BTreeSet<(u64, u64)>,
    /// The defaults, by folder and topmost folder.
    defaults: BTreeMap<(PathBuf, PathBuf), Option<PathBuf>>,
}

impl FoundRecipes {
    /// Adds a recipe. Its defaults are searched from its own folder up to `root`.
    fn add(&mut self, path: PathBuf, root: &Path) {
        // A path without metadata is added, so that reading it reports the cause.
        let about = std::fs::metadata(&path);
        if about.is_ok_and(|about| !self.known.insert((about.dev(), about.ino()))) {
            return;
        }
        let place = (parent_folder(&path), root.to_owned());
        let defaults = self.defaults.entry(place).or_insert_with_key(|(folder, root)| {
            // Defaults above the given folder do not apply, so the search ends at the root.
            let folders = folder.ancestors().take_while(|folder| folder.starts_with(root));
            folders.map(|folder| folder.join(DEFAULTS)).find(|path| is_there(path))
        });
        self.files.push(RecipeFile { path, defaults: defaults.clone() });
    }
}

/// Returns the folder of a file.
pub(super) fn parent_folder(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}

fn walk_folder(root: &Path, found: &mut FoundRecipes, faults: &mut Vec<RecipeFault>) {
    let mut is_empty = true;
    // A folder that the user names is searched even if it is hidden.
    let shown = |entry: &DirEntry| entry.depth() == 0 || !is_hidden(entry.path());
    for entry in FolderWalk::new(root).following().entries(shown) {
        match entry {
            Ok(entry) if is_recipe(&entry) => {
                is_empty = false;
                found.add(entry.into_path(), root);
            }
            Ok(entry) => faults.extend(misnamed(entry.path())),
            // The lock of an editor is a link to nothing.
            Err(error) if error.path != root && is_hidden(&error.path) => {}
            Err(error) => {
                is_empty = false;
                let message = format!("cannot be searched for recipes: {}", system_words(&error.because));
                let help = "name folders in other places on the command line too";
                faults.push(RecipeFault::of_file(&error.path, &message, Some(help)));
            }
        }
    }
    if is_empty {
        let help = "a recipe is a .yaml file other than defaults.yaml, sources.yaml and release.yaml";
        faults.push(RecipeFault::of_file(root, "this folder has no recipe", Some(help)));
    }
}

fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// Returns true for a recipe by its name. Every kind of file except folders counts: a file that
/// cannot be read is then a fault, and no scene goes missing silently.
fn is_recipe(entry: &DirEntry) -> bool {
    let yaml = entry.path().extension().is_some_and(|extension| extension == "yaml" || extension == "yml");
    let other = [DEFAULTS, RELEASE, SOURCES].iter().any(|name| entry.file_name() == *name);
    yaml && !other && !entry.file_type().is_dir()
}

/// Returns a fault if a file has the name of the takedown list in other letters: its scenes would
/// be released.
pub(super) fn misnamed(path: &Path) -> Option<RecipeFault> {
    let name = path.file_name()?.to_str()?;
    let other = name.eq_ignore_ascii_case(TAKEDOWN) && name != TAKEDOWN;
    other.then(|| {
        let message = format!("a file with this name is ignored, wanted {TAKEDOWN}");
        RecipeFault::of_file(path, &message, Some("rename the file"))
    })
}
