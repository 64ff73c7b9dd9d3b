//! The GPU that tests render on: any, one in software too.

use gs2e::render::gpu::{Choice, Device};
use std::io::Write as _;

/// A GPU, or `None`, said on stderr, where there is none. Where `REQUIRE_GPU` is 1 that is a failure.
pub(crate) fn device() -> Option<Device> {
    match Device::open(&Choice::Any) {
        Ok(device) => Some(device),
        Err(because) => {
            assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "{because}");
            // Past the capture of the test's output: a test that was not run says so although it passes.
            drop(writeln!(std::io::stderr(), "not run: {because}"));
            None
        }
    }
}
