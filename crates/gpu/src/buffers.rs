//! The device memory of a frame, and its bindings for the passes.

use super::device::GpuDevice;
use super::passes::BindingLayouts;
use super::scene::{MAX_GROUPS, ScenePart};
use super::shader::{BLOCK, DIGIT_BITS, DISPATCHES, GROUP, TOTALS};
use super::{TileRegion, frame};
use gs2e_render::GpuError;
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindingResource, Buffer, BufferBinding,
    BufferDescriptor, BufferSize, BufferUsages,
};

/// Capacities of the buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct BufferCapacity {
    pub(super) splats: u32,
    pub(super) pairs: u32,
    pub(super) tiles: u32,
    /// Number of floats of all images.
    pub(super) floats: u64,
    /// Rows of four words per splat.
    pub(super) splat_rows: u32,
    /// The pairs have slots for gradients.
    pub(super) traced: bool,
}

impl BufferCapacity {
    /// The larger of both capacities, field by field. Buffers never shrink.
    pub(super) fn or(self, o: Self) -> Self {
        Self {
            splats: self.splats.max(o.splats),
            pairs: self.pairs.max(o.pairs),
            tiles: self.tiles.max(o.tiles),
            floats: self.floats.max(o.floats),
            splat_rows: self.splat_rows.max(o.splat_rows),
            traced: self.traced || o.traced,
        }
    }
}

/// Maximum number of splats of this many rows that the device can bind and dispatches can reach.
pub(super) fn most_splats(limit: u64, splat_rows: u32) -> u32 {
    let bound = (limit / (16 * u64::from(splat_rows))).min(u64::from(MAX_GROUPS * GROUP));
    u32::try_from(bound).unwrap_or(u32::MAX)
}

/// Maximum number of pairs of this size, in bytes, that the device can bind and dispatches can reach.
pub(super) fn most_pairs(limit: u64, size: u64) -> u32 {
    let bound = (limit / size).min(u64::from(MAX_GROUPS) * u64::from(BLOCK));
    u32::try_from(bound).unwrap_or(u32::MAX)
}

/// Distance between the sorts' uniform entries (lowest bit of the digit; kind of entries), bytes.
/// Devices align dynamic offsets to this.
pub(super) const ALIGNED: u32 = 256;
/// Number of digits of a key.
pub(super) const DIGITS: u32 = 32 / DIGIT_BITS;

/// The buffers of a frame, with their bind groups.
#[derive(Debug)]
pub(super) struct FrameBuffers {
    pub(super) room: BufferCapacity,
    pub(super) frame: Buffer,
    pub(super) totals: Buffer,
    pub(super) groups: Buffer,
    pub(super) lists: Buffer,
    pub(super) images: Buffer,
    pub(super) bound: PassBindings,
    /// Only with [`BufferCapacity::traced`].
    pub(super) traced: Option<TracedBuffers>,
}

/// Buffers that the gradients read after a frame.
#[derive(Debug)]
pub(super) struct TracedBuffers {
    pub(super) splats: Buffer,
    /// The pairs of slot and splat: in the first or in the second buffer, as in [`PassBindings::bin`].
    pub(super) pairs: [Buffer; 2],
    /// First slot and number of slots of each splat.
    pub(super) ranges: Buffer,
    /// Groups of the passes that number the pairs, with the pairs in the first or in the second buffer.
    pub(super) slots: [BindGroup; 2],
}

/// Bind groups of the passes.
#[derive(Debug)]
pub(super) struct PassBindings {
    pub(super) frame: BindGroup,
    /// One group per part of the scene.
    pub(super) project: Vec<BindGroup>,
    /// One group per part of the scene.
    pub(super) scan_parts: Vec<BindGroup>,
    /// Groups for the counts of splats, and for the digits of a sort.
    pub(super) scan_tally: BindGroup,
    pub(super) scan_digits: BindGroup,
    /// Groups of a sort: from the first buffer to the second, and back.
    pub(super) sort_splats: [BindGroup; 2],
    pub(super) sort_pairs: [BindGroup; 2],
    /// Groups with the pairs in the first or in the second buffer.
    pub(super) bin: [BindGroup; 2],
    pub(super) raster: [BindGroup; 2],
}

/// Buffers that only the passes use.
struct PassBuffers {
    drawn: Buffer,
    sums: Buffer,
    counts: Buffer,
    splats: Buffer,
    order: [Buffer; 2],
    touched: Buffer,
    pairs: [Buffer; 2],
    digits: Buffer,
    no_part: Buffer,
}

impl FrameBuffers {
    /// Allocates buffers with these capacities.
    pub(super) fn new(
        device: &GpuDevice,
        layouts: &BindingLayouts,
        parts: &[ScenePart],
        room: BufferCapacity,
    ) -> Result<Self, GpuError> {
        let groups = parts.iter().map(|p| p.groups).max().unwrap_or(0);
        let sizes = BufferSizes::new(room, groups);
        device.allocate("splats, pairs and images", sizes.sum(), |gpu| {
            let buffer = |size: u64, usage| {
                // WebGPU refuses a binding without bytes.
                let size = size.max(16);
                gpu.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
            };
            let storage = |size| buffer(size, BufferUsages::STORAGE);
            let inner = PassBuffers {
                drawn: storage(sizes.drawn),
                sums: storage(sizes.sums),
                counts: storage(sizes.counts),
                splats: storage(sizes.splats),
                order: [storage(sizes.order), storage(sizes.order)],
                touched: storage(sizes.touched),
                pairs: [storage(sizes.pairs), storage(sizes.pairs)],
                digits: buffer(
                    u64::from(2 * DIGITS * ALIGNED),
                    BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                ),
                no_part: buffer(16, BufferUsages::UNIFORM),
            };
            let cleared = BufferUsages::STORAGE | BufferUsages::COPY_DST;
            let frame = buffer(frame::BYTES, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
            let totals = buffer(4 * TOTALS as u64, cleared | BufferUsages::COPY_SRC);
            // The size of an indirect dispatch is three words.
            let groups = buffer(12 * DISPATCHES, cleared | BufferUsages::INDIRECT);
            let lists = buffer(8 * u64::from(room.tiles), cleared);
            let images = buffer(4 * room.floats, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
            let outer = [&frame, &totals, &groups, &lists, &images];
            let bound = inner.bind(gpu, layouts, parts, outer);
            device.queue.write_buffer(&inner.digits, 0, &digit_entries());
            let traced = room.traced.then(|| {
                let buffers = [storage(sizes.owners), buffer(sizes.ranges, cleared)];
                inner.trace(gpu, layouts, &totals, buffers)
            });
            Self { room, frame, totals, groups, lists, images, bound, traced }
        })
    }
}

/// Sizes of the buffers, bytes.
struct BufferSizes {
    drawn: u64,
    sums: u64,
    counts: u64,
    splats: u64,
    order: u64,
    touched: u64,
    pairs: u64,
    images: u64,
    owners: u64,
    ranges: u64,
}

impl BufferSizes {
    fn new(room: BufferCapacity, part_groups: u32) -> Self {
        // `sums` and `counts` serve several passes one after another, so each has the larger size.
        let blocks = room.splats.max(room.pairs).div_ceil(BLOCK);
        Self {
            drawn: 4 * u64::from(part_groups) * u64::from(GROUP),
            sums: 4 * u64::from(part_groups.max(room.splats.div_ceil(GROUP))),
            counts: (4 * u64::from(blocks)) << DIGIT_BITS,
            splats: 16 * u64::from(room.splats) * u64::from(room.splat_rows),
            order: 8 * u64::from(room.splats),
            touched: 4 * u64::from(room.splats),
            pairs: 8 * u64::from(room.pairs),
            images: 4 * room.floats,
            owners: if room.traced { 4 * u64::from(room.pairs) } else { 0 },
            ranges: if room.traced { 8 * u64::from(room.splats) } else { 0 },
        }
    }

    fn sum(&self) -> u64 {
        let twice = 2 * (self.order + self.pairs);
        let traced = self.owners + self.ranges;
        self.drawn + self.sums + self.counts + self.splats + self.touched + twice + self.images + traced
    }
}

/// The uniform entries of all digits, first of splats and then of pairs.
fn digit_entries() -> Vec<u8> {
    let entries = (0..2 * DIGITS).map(|k| [k % DIGITS * DIGIT_BITS, u32::from(k >= DIGITS)]);
    let mut bytes = Vec::new();
    for (entry, end) in entries.zip((ALIGNED as usize..).step_by(ALIGNED as usize)) {
        bytes.extend(entry.into_iter().flat_map(u32::to_le_bytes));
        bytes.resize(end, 0);
    }
    bytes
}

impl PassBuffers {
    fn bind(
        &self,
        gpu: &wgpu::Device,
        layouts: &BindingLayouts,
        parts: &[ScenePart],
        [frame, totals, groups, lists, images]: [&Buffer; 5],
    ) -> PassBindings {
        let group = |layout: &BindGroupLayout, buffers: &[&Buffer]| bind_whole(gpu, layout, buffers);
        let Self { drawn, sums, counts, splats, order: [a, b], touched, pairs: [c, d], digits, no_part } =
            self;
        let project = |part: &ScenePart| {
            let ScenePart { counts, means, axes, harmonics, .. } = part;
            group(&layouts.project, &[counts, means, axes, harmonics, drawn, sums, totals, splats, a])
        };
        // A dispatch selects one entry by its dynamic offset.
        let digit = BufferBinding { buffer: digits, offset: 0, size: BufferSize::new(8) };
        let sort = |from: &Buffer, to: &Buffer| {
            let whole = [from, to, counts, totals].map(|b| b.as_entire_buffer_binding());
            bind_buffers(gpu, &layouts.sort, &[std::slice::from_ref(&digit), &whole[..]].concat())
        };
        let bin = |pairs| group(&layouts.bin, &[splats, a, touched, sums, totals, pairs, lists]);
        let raster = |pairs| group(&layouts.raster, &[splats, pairs, lists, images, totals]);
        let scan = |of, part| group(&layouts.scan, &[of, totals, groups, part]);
        PassBindings {
            frame: group(&layouts.frame, &[frame]),
            project: parts.iter().map(project).collect(),
            scan_parts: parts.iter().map(|part| scan(sums, &part.counts)).collect(),
            scan_tally: scan(sums, no_part),
            scan_digits: scan(counts, no_part),
            sort_splats: [sort(a, b), sort(b, a)],
            sort_pairs: [sort(c, d), sort(d, c)],
            bin: [bin(c), bin(d)],
            raster: [raster(c), raster(d)],
        }
    }
}

impl PassBuffers {
    /// The buffers that the gradients read, and the passes that fill them.
    fn trace(
        &self,
        gpu: &wgpu::Device,
        layouts: &BindingLayouts,
        totals: &Buffer,
        [owners, ranges]: [Buffer; 2],
    ) -> TracedBuffers {
        let Self { splats, order: [order, _], touched, sums, pairs, .. } = self;
        let slots = |pairs: &Buffer| {
            bind_whole(gpu, &layouts.slots, &[order, touched, sums, totals, pairs, &owners, &ranges])
        };
        let slots = [slots(&pairs[0]), slots(&pairs[1])];
        TracedBuffers { splats: splats.clone(), pairs: pairs.clone(), ranges, slots }
    }
}

/// A group of whole buffers.
pub(super) fn bind_whole(gpu: &wgpu::Device, layout: &BindGroupLayout, buffers: &[&Buffer]) -> BindGroup {
    let whole: Vec<BufferBinding<'_>> = buffers.iter().map(|b| b.as_entire_buffer_binding()).collect();
    bind_buffers(gpu, layout, &whole)
}

fn bind_buffers(gpu: &wgpu::Device, layout: &BindGroupLayout, bound: &[BufferBinding<'_>]) -> BindGroup {
    let entries: Vec<BindGroupEntry<'_>> = (0..)
        .zip(bound)
        .map(|(binding, bound)| BindGroupEntry { binding, resource: BindingResource::Buffer(bound.clone()) })
        .collect();
    gpu.create_bind_group(&BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// Capacities for the tiles and images of a region.
pub(super) fn room_of(region: TileRegion, pixels: u64, floats: u32) -> BufferCapacity {
    let [columns, rows] = region.tiles();
    BufferCapacity { tiles: columns * rows, floats: pixels * u64::from(floats), ..BufferCapacity::default() }
}
