//! Search for recipes in files and folders. All recipes are read and every fault is found before
//! anything runs.

mod walk;

use walk::find_recipes;
pub(super) use walk::{misnamed, parent_folder};

use super::Recipe;
use super::clash::find_clashes;
use super::fault::{RecipeFault, RecipeFaults};
use super::load::{DefaultsLibrary, RecipeParts};
use gs2e_files::{self as files, escape};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

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

/// Reads the recipes whose scenes may be what `name` means: a scene id, or a scene id, `/` and more. All of
/// `paths` are read if no recipe may be.
///
/// Recipes are told apart by their lines `scene: ID`, so that the work does not grow with the number of
/// scenes. A recipe without such a line is read; faults of others are not found.
///
/// # Errors
/// The recipes have faults; see [`read_all`].
pub fn read_named(paths: &[PathBuf], name: &str) -> Result<Vec<Recipe>, RecipeFaults> {
    let (found, faults) = find_recipes(paths);
    let is_meant = |recipe: &&RecipeFile| {
        // A file that cannot be read has a fault to report.
        let text = files::read_text(&recipe.path, files::MAX_DOCUMENT).ok();
        text.as_deref().and_then(scene_line).is_none_or(|scene| may_mean(name, scene))
    };
    let meant: Vec<RecipeFile> = found.par_iter().filter(is_meant).cloned().collect();
    let read = read_files(&meant).unwrap_or_default();
    let is_found = faults.is_empty() && read.iter().any(|recipe| may_mean(name, &recipe.scene));
    if is_found { Ok(read) } else { read_after(&found, faults) }
}

fn may_mean(name: &str, scene: &str) -> bool {
    name.strip_prefix(scene).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// The scene id of a recipe, if a line of its own states it plainly.
fn scene_line(text: &str) -> Option<&str> {
    let id = text.lines().find_map(|line| line.strip_prefix("scene:"))?;
    let id = id.split(" #").next().unwrap_or_default().trim();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/_-.".contains(c);
    (!id.is_empty() && id.chars().all(is_plain)).then_some(id)
}

/// Reads a recipe from a text that is in no file, without defaults. Faults name the text as `display_path`.
///
/// # Errors
/// The recipe has faults; see [`read_all`].
pub fn read_recipe_text(text: String, display_path: &Path) -> Result<Recipe, RecipeFaults> {
    let file = RecipeFile { path: display_path.to_owned(), defaults: None };
    let read = RecipeParts::of_text(display_path, text).and_then(|parts| parts.with_presets().recipe(&file));
    read.map(|read| read.recipe).map_err(RecipeFaults::new)
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
