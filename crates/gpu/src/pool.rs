//! Several GPUs of one kind, for many scenes at once.
//!
//! Each renderer works on one GPU. GPUs of other kinds round differently, so their steps would have other
//! keys: a pool has GPUs of one numerical class only.

use super::device::{DeviceChoice, GpuDevice};
use super::features::FeatureSet;
use super::{GpuGradientRenderer, GpuRenderer};
use gs2e_render::backend::{Backend, GpuBackend};
use gs2e_render::differentiable::DifferentiableRenderer;
use gs2e_render::{GpuError, RenderError, RenderStyle, Renderer};
use gs2e_scene::Gaussians;
use std::sync::{Arc, Mutex, PoisonError};

/// GPUs of one numerical class. Clones share the load.
#[derive(Debug, Clone)]
pub struct GpuPool {
    devices: Arc<[GpuDevice]>,
    /// Number of renderers on each device.
    loads: Arc<Mutex<Vec<usize>>>,
}

/// A renderer's place on a device of a pool. It is free again when the last clone is dropped.
#[derive(Debug)]
pub(super) struct PoolPlace {
    loads: Arc<Mutex<Vec<usize>>>,
    at: usize,
}

impl Drop for PoolPlace {
    fn drop(&mut self) {
        self.loads.lock().unwrap_or_else(PoisonError::into_inner)[self.at] -= 1;
    }
}

impl From<GpuDevice> for GpuPool {
    fn from(device: GpuDevice) -> Self {
        Self::new(vec![device])
    }
}

impl From<GpuPool> for Backend {
    fn from(pool: GpuPool) -> Self {
        Self::Gpu(Arc::new(pool))
    }
}

impl From<GpuDevice> for Backend {
    fn from(device: GpuDevice) -> Self {
        GpuPool::from(device).into()
    }
}

impl GpuBackend for GpuPool {
    fn class(&self) -> &str {
        self.devices[0].fingerprint()
    }

    fn device_count(&self) -> usize {
        self.devices.len()
    }

    fn is_lost(&self) -> bool {
        self.devices.iter().all(|device| device.check().is_err())
    }

    fn renderer(&self, scene: &Gaussians, style: RenderStyle) -> Result<Box<dyn Renderer>, RenderError> {
        Ok(Box::new(GpuRenderer::new(self.take()?, scene, style)?))
    }

    fn differentiable(
        &self,
        scene: Gaussians,
        style: RenderStyle,
    ) -> Result<Box<dyn DifferentiableRenderer>, RenderError> {
        Ok(Box::new(GpuGradientRenderer::new(self.take()?, scene, style)?))
    }
}

impl GpuPool {
    /// A pool of these devices. Those of another numerical class than the first are left out.
    ///
    /// # Panics
    /// There is no device.
    #[must_use]
    pub fn new(mut devices: Vec<GpuDevice>) -> Self {
        let class = devices.first().expect("a pool has a device").fingerprint().to_owned();
        devices.retain(|device| device.fingerprint() == class);
        let loads = Arc::new(Mutex::new(vec![0; devices.len()]));
        Self { devices: devices.into(), loads }
    }

    /// Opens the GPUs of a choice without some of their features.
    ///
    /// # Errors
    /// There is no GPU, none matches, or the first one lacks what WebGPU guarantees.
    pub fn open(choice: &DeviceChoice, without: FeatureSet) -> Result<Self, GpuError> {
        GpuDevice::open_all(choice, without).map(Self::new)
    }

    /// Name and interface of the devices, with their number if there are several.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.devices[0].name();
        if self.devices.len() == 1 { name.to_owned() } else { format!("{} GPUs {name}", self.devices.len()) }
    }

    /// The device with the fewest renderers among those that were not lost. The renderer that it is for keeps
    /// the place.
    ///
    /// # Errors
    /// All devices were lost: the error of the first.
    pub fn take(&self) -> Result<GpuDevice, GpuError> {
        let mut loads = self.loads.lock().unwrap_or_else(PoisonError::into_inner);
        let sound = (0..self.devices.len()).filter(|at| self.devices[*at].check().is_ok());
        let Some(at) = sound.min_by_key(|at| loads[*at]) else {
            self.devices[0].check()?;
            unreachable!("a device without an error is sound");
        };
        loads[at] += 1;
        let place = PoolPlace { loads: Arc::clone(&self.loads), at };
        Ok(self.devices[at].clone().at_place(place))
    }
}
