//! Recipes: their faults as an exception.

use crate::sensor::recipe_error;
use gs2e_recipe::read_all;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Reads the recipes at these paths, files or folders, and returns each in full with all defaults, as JSON.
#[pyfunction]
pub(crate) fn read_recipes(paths: Vec<PathBuf>) -> PyResult<Vec<String>> {
    let recipes = read_all(&paths).map_err(|faults| recipe_error(&faults))?;
    Ok(recipes.iter().map(|recipe| recipe.meta.merged.to_string()).collect())
}
