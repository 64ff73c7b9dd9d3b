//! Recipe files in a folder and the folders below it.

use super::{DEFAULTS, RELEASE, RecipeFile, SOURCES, TAKEDOWN};
use crate::fault::RecipeFault;
use crate::load::system_words;
use gs2e_files::{FolderWalk, is_there};
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use walkdir::DirEntry;

/// Returns the recipe files of these paths, each once.
pub(super) fn find_recipes(paths: &[PathBuf]) -> (Vec<RecipeFile>, Vec<RecipeFault>) {
    let (mut found, mut faults) = (FoundRecipes::default(), Vec::new());
    for path in paths {
        if path.is_dir() {
            walk_folder(path, &mut found, &mut faults);
        } else if beside_recipes(path).is_some() {
            let no_recipe = || {
                RecipeFault::of_file(path, "this file is not a recipe", Some("name a recipe, or its folder"))
            };
            faults.push(misnamed(path).unwrap_or_else(no_recipe));
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
pub(crate) fn parent_folder(file: &Path) -> PathBuf {
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
                let message = format!("cannot be searched for recipes: {}", system_words(&error.source));
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
    let other = beside_recipes(entry.path()).is_some();
    yaml && !other && !entry.file_type().is_dir()
}

/// The name of the file beside the recipes that a file is, or is meant to be: in other letters, with blanks
/// around it, or with the ending `.yml`.
fn beside_recipes(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_str()?.trim().to_lowercase();
    let name = name.strip_suffix(".yml").map_or_else(|| name.clone(), |stem| format!("{stem}.yaml"));
    [DEFAULTS, RELEASE, SOURCES, TAKEDOWN].into_iter().find(|wanted| name == *wanted)
}

/// Returns a fault if a file beside the recipes has another spelling of its name: it would have no effect.
pub(crate) fn misnamed(path: &Path) -> Option<RecipeFault> {
    let wanted =
        beside_recipes(path).filter(|wanted| path.file_name().is_some_and(|name| name != *wanted))?;
    let message = format!("a file with this name is ignored, wanted {wanted}");
    Some(RecipeFault::of_file(path, &message, Some("rename the file")))
}
