//! Captured datasets as they lie on disk: the real ones under `../shared`, and small ones with every known defect.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod against_colmap;
pub(crate) mod datasets;
mod half_pixel;
mod model_folders;
mod models;
pub(crate) mod planted;
mod reprojection;
mod transforms;
mod undistortion;

use gs2e::image::Size;
use std::path::{Path, PathBuf};

fn size(width: u32, height: u32) -> Size {
    Size { width, height }
}

/// A path below `../shared/data`, or `None`, said on stderr.
#[expect(clippy::print_stderr, reason = "a test that is not run says so")]
fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("not run: ../shared is absent");
    None
}
