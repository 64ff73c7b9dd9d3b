//! The repository's own files, as tests of the documentation read them.

use std::path::Path;

/// Root of the repository: two folders above this crate.
///
/// # Panics
/// This crate was moved.
#[must_use]
pub fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).expect("a crate lies in crates/")
}

/// A text file of the repository, by its path from the root.
pub fn text_of(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Rust sources below a folder, as sorted paths from the root with `/`.
pub fn sources_below(folder: &str) -> Vec<String> {
    files_below(folder, "rs")
}

/// Files below a folder whose names end in `.ext`, as sorted paths from the root with `/`.
pub fn files_below(folder: &str, ext: &str) -> Vec<String> {
    let entries = walkdir::WalkDir::new(root().join(folder)).sort_by_file_name();
    let files = entries.into_iter().map(|entry| entry.expect("the repository can be walked"));
    let files = files.filter(|entry| entry.path().extension().is_some_and(|found| found == ext));
    files
        .map(|entry| {
            let path = entry.path().strip_prefix(root()).expect("it lies below the root");
            path.to_string_lossy().replace('\\', "/")
        })
        .collect()
}
