//! Goldens of the repository: results of other programs, in `tests/golden`.

use crate::repository;
use std::path::PathBuf;

/// A folder of `tests/golden`.
pub fn folder(name: &str) -> PathBuf {
    repository::root().join("tests/golden").join(name)
}
