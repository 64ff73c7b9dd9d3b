//! The device memory of the gradients, and its bindings for the backward passes.

use super::super::buffers::{BufferCapacity, bind_whole};
use super::super::scene::ScenePart;
use super::super::shader::{ImageLayout, SUMS};
use super::super::{GpuRenderer, device::GpuDevice};
use super::{COLOUR, GRADIENT};
use gs2e_render::GpuError;
use wgpu::{BindGroup, Buffer, BufferDescriptor, BufferUsages};

/// Buffers for the gradients of a frame with certain capacities, with their bind groups.
#[derive(Debug)]
pub(super) struct GradientBuffers {
    /// The capacities of the frame.
    pub(super) room: BufferCapacity,
    pub(super) by_pixel: Buffer,
    pub(super) moments: Buffer,
    pub(super) gradients: Buffer,
    /// Groups with the pairs in the first or in the second buffer.
    pub(super) backward: [BindGroup; 2],
    pub(super) gather: BindGroup,
    /// One group per part of the scene.
    pub(super) chain: Vec<BindGroup>,
    /// The buffer through which the gradients were read last.
    pub(super) staging: Option<Buffer>,
}

impl GradientBuffers {
    /// Buffers for the frame of a renderer that keeps a trace.
    pub(super) fn new(renderer: &GpuRenderer) -> Result<Self, GpuError> {
        let GpuRenderer { device, layouts, parts, buffers: frame, .. } = renderer;
        let Some(traced) = &frame.traced else { return Err(device.lost("no trace was kept")) };
        let room = frame.room;
        let pixels = room.floats / u64::from(ImageLayout::new(COLOUR).with_trace().floats_on_device());
        let by_splat = |bytes: u64| bytes * u64::from(room.splats);
        let sums = 4 * u64::from(SUMS);
        let sizes = [16 * pixels, sums * u64::from(room.pairs), by_splat(sums), by_splat(GRADIENT as u64)];
        device.allocate("gradients", sizes.iter().sum(), |gpu| {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            let [by_pixel, moments, sums, gradients] = sizes.map(|size| {
                // WebGPU refuses a binding without bytes.
                let size = size.max(16);
                gpu.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
            });
            let backward = |pairs| {
                let bound = [&traced.splats, pairs, &frame.lists, &frame.images, &by_pixel, &moments];
                bind_whole(gpu, &layouts.backward, &bound)
            };
            let backward = [backward(&traced.pairs[0]), backward(&traced.pairs[1])];
            let gather = bind_whole(gpu, &layouts.gather, &[&traced.ranges, &moments, &frame.totals, &sums]);
            let chain = |part: &ScenePart| {
                let ScenePart { counts, means, axes, harmonics, rotations, .. } = part;
                let scene = [counts, means, axes, harmonics].into_iter().chain(rotations);
                let bound = scene.chain([&traced.splats, &sums, &frame.totals, &gradients]);
                bind_whole(gpu, &layouts.chain, &bound.collect::<Vec<_>>())
            };
            let chain = parts.iter().map(chain).collect();
            Self { room, by_pixel, moments, gradients, backward, gather, chain, staging: None }
        })
    }

    /// A buffer of at least this many bytes that the host can read: the last one if it is large enough.
    pub(super) fn staging(&mut self, device: &GpuDevice, size: u64) -> Result<Buffer, GpuError> {
        if let Some(last) = self.staging.take().filter(|buffer| buffer.size() >= size) {
            return Ok(last);
        }
        device.allocate("gradients to be read", size, |gpu| {
            let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
            gpu.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        })
    }
}
