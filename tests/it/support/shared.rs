//! The optional folder of test data beside the repository.

use std::path::{Path, PathBuf};

/// A path below `../shared`, or `None`, said on stderr, where that folder is absent.
pub(crate) fn path(relative: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if !root.exists() {
        eprintln!("not run: ../shared is absent");
        return None;
    }
    Some(root.join(relative))
}
