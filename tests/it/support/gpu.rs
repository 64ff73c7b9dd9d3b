//! The GPU that tests render on: any GPU, also one in software.

use super::absent::absent;
use gs2e::render::gpu::{DeviceChoice, GpuDevice};

/// A GPU. Without one, the test is reported as not run and this is `None`; with `REQUIRE_GPU=1`
/// that is a failure.
pub(crate) fn device() -> Option<GpuDevice> {
    match GpuDevice::open(&DeviceChoice::Any) {
        Ok(device) => Some(device),
        Err(because) => {
            absent("REQUIRE_GPU", &because.to_string());
            None
        }
    }
}
