//! The GPU that tests render on: any GPU, also one in software.

use super::absent::present;
use gs2e_gpu::{DeviceChoice, GpuDevice};

/// A GPU. Without one, the test is reported as not run and this is `None`; with `REQUIRE_GPU=1`
/// that is a failure.
pub(crate) fn device() -> Option<GpuDevice> {
    present("REQUIRE_GPU", GpuDevice::open(&DeviceChoice::Any))
}
