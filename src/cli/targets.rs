//! The recipes that a verb works on, as the user names them.

use super::VerbError;
use clap::Args;
use gs2e_files::{self as files, escape};
use gs2e_recipe as recipe;
use std::path::{Path, PathBuf};

/// The recipes or folders that a verb works on.
#[derive(Debug, Args)]
pub(super) struct RecipeTargets {
    /// Recipes, folders of recipes, or ids of scenes in `recipes`
    #[arg(value_name = "RECIPE, DIR or SCENE", default_value = Self::DEFAULT)]
    pub(super) recipes: Vec<PathBuf>,
}

impl RecipeTargets {
    /// Replaces scene ids by the recipes of those scenes in the default folder. A word is a path if a
    /// file or folder of that name exists, or if it ends like a recipe.
    pub(super) fn resolve(&mut self) -> Result<(), VerbError> {
        let default = Path::new(Self::DEFAULT);
        // Without the default folder, the reader reports the missing path.
        if self.recipes.iter().all(|path| is_recipe_path(path)) || !files::is_there(default) {
            return Ok(());
        }
        let known = recipe::read_all(&[default.to_owned()])?;
        for path in self.recipes.iter_mut().filter(|path| !is_recipe_path(path)) {
            let named = known.iter().find(|recipe| path.as_os_str() == recipe.scene.as_str());
            let recipe = named.ok_or_else(|| {
                let word = escape::path(path);
                let what = format!("{word} is not a recipe, a folder, or a scene of {}", Self::DEFAULT);
                VerbError::usage("no-scene", what).help("gs2e plan lists the scenes")
            })?;
            path.clone_from(&recipe.meta.file.path);
        }
        Ok(())
    }

    /// Default folder of recipes.
    pub(super) const DEFAULT: &'static str = "recipes";
}

/// Returns true if a word names a recipe or a folder by its path, and not a scene by its id.
pub(super) fn is_recipe_path(path: &Path) -> bool {
    files::is_there(path) || path.extension().is_some_and(|end| end == "yaml")
}
