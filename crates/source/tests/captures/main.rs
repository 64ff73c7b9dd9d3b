//! Captured datasets as they lie on disk: the real ones under `../shared`, and small ones with
//! every known defect.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod against_colmap;
mod half_pixel;
mod models;
mod reprojection;
mod transforms;
mod undistortion;

use gs2e_image::Size;
use std::path::PathBuf;

fn size(width: u32, height: u32) -> Size {
    Size { width, height }
}

/// A path below `../shared/data`. If it is absent, the test is reported as not run and this is
/// `None`.
fn shared(path: &str) -> Option<PathBuf> {
    gs2e_testing::shared::path(&format!("data/{path}"))
}
