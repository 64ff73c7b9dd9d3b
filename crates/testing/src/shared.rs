//! The optional folder of test data next to the repository.

use super::absent::absent;
use std::path::{Path, PathBuf};

/// A path below `../shared`. If that folder is absent, the test is reported as not run and this is
/// `None`; with `REQUIRE_SHARED=1` that is a failure.
pub(crate) fn path(relative: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if !root.exists() {
        absent("REQUIRE_SHARED", "../shared is absent");
        return None;
    }
    Some(root.join(relative))
}
