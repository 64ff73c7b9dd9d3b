//! Files next to the recipes. `release.yaml` describes the release, `sources.yaml` states which
//! material may be redistributed, and `takedown.txt` lists scenes that must no longer be
//! redistributed.

mod include;
mod release;
mod sources;
mod splits;
mod takedown;

pub use include::{EXPORT_FORMATS, HELD_OUT_EVERY, IncludedExport};
pub use release::ReleaseInfo;
pub use sources::{RedistributionStatement, SourceTerms};
pub use splits::{SplitPlan, SplitUnit};
pub use takedown::{TakedownEffect, TakedownList, read_takedown, takedown_of};

use super::fault::{RecipeFault, RecipeFaults};
use super::find::{self, RELEASE, SOURCES};
use super::load::RecipeParts;
use super::resolve::Resolver;
use gs2e_files::is_there;
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Reads the `release.yaml` of the folders that contain the recipes; returns defaults if the file
/// is absent.
///
/// # Errors
/// The file cannot be read or has a fault, or two folders have one each.
pub fn read_release(paths: &[PathBuf]) -> Result<ReleaseInfo, RecipeFaults> {
    read_single(paths, RELEASE, release::release_info)
}

/// Reads the `sources.yaml` of the folders that contain the recipes; empty if there is no file.
///
/// # Errors
/// The file cannot be read or has a fault, or two folders have one each.
pub fn read_sources(paths: &[PathBuf]) -> Result<SourceTerms, RecipeFaults> {
    read_single(paths, SOURCES, sources::source_terms)
}

/// Reads the file with this name as `T` and resolves it.
fn read_single<T: DeserializeOwned + Default, R: Default>(
    paths: &[PathBuf],
    name: &str,
    resolve: fn(&T, &Resolver<'_>) -> Option<R>,
) -> Result<R, RecipeFaults> {
    let read = |path: PathBuf| Ok(RecipeParts::without_defaults(&path)?.resolve(resolve)?.1);
    let found = find_single(paths, name).and_then(|path| path.map_or_else(|| Ok(R::default()), read));
    found.map_err(RecipeFaults::new)
}

/// Finds the one file with this name next to the recipes.
fn find_single(paths: &[PathBuf], name: &str) -> Result<Option<PathBuf>, Vec<RecipeFault>> {
    let folder = |path: &PathBuf| if path.is_dir() { path.clone() } else { find::parent_folder(path) };
    let mut seen = BTreeSet::new();
    let mut found: Vec<PathBuf> = paths.iter().map(|path| folder(path).join(name)).collect();
    // Several paths may lead to the same folder.
    found.retain(|path| is_there(path) && seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    match found.as_slice() {
        [] => Ok(None),
        [path] => Ok(Some(path.clone())),
        [first, second, ..] => {
            let message = format!("there is another one: {}", super::fault::displayed_path(first));
            let help =
                format!("a release has one {name}: release the folders separately, or keep one of the files");
            Err(vec![RecipeFault::of_file(second, &message, Some(&help))])
        }
    }
}
