//! The optional folder of test data next to the repository.

use crate::absent::absent;
use crate::repository;
use std::path::PathBuf;

/// A path below `../shared`. If that folder is absent, the test is reported as not run and this is
/// `None`; with `REQUIRE_SHARED=1` that is a failure.
pub fn path(relative: &str) -> Option<PathBuf> {
    let root = repository::root().join("../shared");
    if !root.exists() {
        absent("REQUIRE_SHARED", "../shared is absent");
        return None;
    }
    Some(root.join(relative))
}
