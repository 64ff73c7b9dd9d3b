//! Goldens of the repository: results of other programs, in `tests/golden`.

use std::path::{Path, PathBuf};

/// A folder of `tests/golden`.
pub(crate) fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}
