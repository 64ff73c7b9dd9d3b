//! The GPU that tests render on: any GPU, also one in software.

use gs2e_gpu::{DeviceChoice, FeatureSet, GpuDevice, GpuFeature};
use gs2e_testing::absent::present;

/// A GPU. Without one, the test is reported as not run and this is `None`; with `REQUIRE_GPU=1`
/// that is a failure.
pub(crate) fn device() -> Option<GpuDevice> {
    device_without(FeatureSet::NONE)
}

/// The same GPU once for each of its features, without that one, and once without all of them.
pub(crate) fn devices_without_features() -> Vec<(String, GpuDevice)> {
    let Some(features) = device().map(|device| device.features()) else { return Vec::new() };
    let has = GpuFeature::ALL.into_iter().filter(|feature| features.has(*feature));
    let mut sets: Vec<FeatureSet> = has.map(|feature| FeatureSet::NONE.with(feature, true)).collect();
    sets.push(features);
    sets.into_iter().filter_map(|set| Some((set.to_string(), device_without(set)?))).collect()
}

fn device_without(features: FeatureSet) -> Option<GpuDevice> {
    present("REQUIRE_GPU", GpuDevice::open_without(&DeviceChoice::Any, features))
}
