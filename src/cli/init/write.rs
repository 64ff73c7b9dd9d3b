//! Files that `init` writes: each is written whole or not at all.

use crate::cli::{VerbError, output};
use gs2e_files::{self as files, Removal, escape, is_there};
use gs2e_recipe::draft;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The list of rejected scenes, in the folder of the recipes. It is no recipe.
const REJECTED: &str = "rejected.tsv";
/// Its first line.
const COLUMNS: &str = "scene\tfolder\tcode\tbecause\n";

fn write_failed(path: &Path) -> impl FnOnce(io::Error) -> VerbError {
    let what = format!("cannot write {}", path.display());
    move |e| VerbError::failed("output-unwritable", format!("{what}: {e}"))
}

/// Creates a folder and its parents.
pub(super) fn make_folder(path: &Path) -> Result<(), VerbError> {
    fs::create_dir_all(path).map_err(write_failed(path))
}

/// Writes a file whole or not at all.
pub(super) fn write_file(path: &Path, text: &str) -> Result<(), VerbError> {
    output::write_whole(path, text.as_bytes()).map_err(write_failed(path))
}

/// The path from a recipe's folder to a place, as it is written in the recipe.
pub(super) fn relative_path(folder: &Path, to: &Path) -> Result<PathBuf, VerbError> {
    // A path that does not exist yet is split at its deepest existing ancestor, because only an
    // existing path can be resolved.
    let mut there = to;
    let mut rest = PathBuf::new();
    while !there.as_os_str().is_empty() && !is_there(there) {
        rest = Path::new(there.file_name().unwrap_or_default()).join(&rest);
        there = there.parent().unwrap_or(Path::new(""));
    }
    let there = if there.as_os_str().is_empty() { Path::new(".") } else { there };
    let way = draft::relative_path(folder, there).map_err(write_failed(folder))?;
    Ok(if rest.as_os_str().is_empty() { way } else { way.join(rest).components().collect() })
}

/// The path of the list of rejected scenes.
pub(super) fn rejected_in(folder: &Path) -> PathBuf {
    folder.join(REJECTED)
}

/// Writes the list of rejected scenes: scene, folder, code and reason in visible characters.
/// Without a rejected scene, removes the list.
pub(super) fn write_rejected(
    folder: &Path,
    rejected: &[(String, PathBuf, &'static str, String)],
) -> Result<(), VerbError> {
    let path = rejected_in(folder);
    let known = files::read_text(&path, files::MAX_DOCUMENT).ok();
    if known.as_ref().is_some_and(|known| !known.starts_with(COLUMNS)) {
        let what = "it is not a list of rejected scenes; rename it, and run the command again";
        return Err(write_failed(&path)(io::Error::new(io::ErrorKind::AlreadyExists, what)));
    }
    if rejected.is_empty() {
        return match files::remove(&path, Removal::File) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(write_failed(&path)(e)),
            _ => Ok(()),
        };
    }
    let mut text = String::from(COLUMNS);
    for (scene, folder, code, because) in rejected {
        let folder = escape::path(folder);
        let cells = [scene, &folder, *code, because].map(escape::line);
        text += &(cells.join("\t") + "\n");
    }
    // An equal list is left alone, so that its time stamp stays.
    if known.is_some_and(|known| known == text) {
        return Ok(());
    }
    write_file(&path, &text)
}
