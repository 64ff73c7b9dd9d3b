//! The optional folder of test data beside the repository.

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A path below `../shared`, or `None`, said on stderr, where that folder is absent.
pub(crate) fn path(relative: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if !root.exists() {
        // Past the capture of the test's output: a test that was not run says so although it passes.
        drop(std::io::stderr().write_all(b"not run: ../shared is absent\n"));
        return None;
    }
    Some(root.join(relative))
}
