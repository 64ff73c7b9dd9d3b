//! The GPU that tests render on: any, one in software too.

use super::absent::absent;
use gs2e::render::gpu::{DeviceChoice, GpuDevice};

/// A GPU; `None`, and the test is named as not run, where there is none. With `REQUIRE_GPU=1` that is a
/// failure.
pub(crate) fn device() -> Option<GpuDevice> {
    match GpuDevice::open(&DeviceChoice::Any) {
        Ok(device) => Some(device),
        Err(because) => {
            absent("REQUIRE_GPU", &because.to_string());
            None
        }
    }
}
