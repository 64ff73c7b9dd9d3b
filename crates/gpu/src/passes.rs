//! The passes of a frame, in the order in which the device runs them.

use super::TileRegion;
use super::buffers::{ALIGNED, DIGITS, FrameBuffers};
use super::clock::{DeviceClock, TimedStage};
use super::device::GpuDevice;
use super::scene::ScenePart;
use super::shader::{Dispatch, ShaderKind, ShaderVariant};
use wgpu::{
    BindGroup, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    BufferBindingType, CommandEncoder, ComputePass, ComputePassDescriptor, ComputePipeline,
    ComputePipelineDescriptor, PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModuleDescriptor,
    ShaderSource, ShaderStages,
};

/// Bind group layouts of the shaders, in addition to the frame's.
#[derive(Debug)]
pub(super) struct BindingLayouts {
    pub(super) frame: BindGroupLayout,
    pub(super) project: BindGroupLayout,
    pub(super) scan: BindGroupLayout,
    pub(super) bin: BindGroupLayout,
    pub(super) sort: BindGroupLayout,
    pub(super) raster: BindGroupLayout,
    pub(super) slots: BindGroupLayout,
    pub(super) backward: BindGroupLayout,
    pub(super) gather: BindGroupLayout,
    pub(super) chain: BindGroupLayout,
}

/// Kinds of buffer bindings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BufferUse {
    Uniform,
    /// A uniform buffer of several entries; a dispatch selects one by its offset.
    Entry,
    Read,
    Write,
}

impl BindingLayouts {
    pub(super) fn new(device: &GpuDevice) -> Self {
        use BufferUse::{Entry, Read, Uniform, Write};
        let layout = |uses: &[BufferUse]| bind_layout(&device.device, uses);
        Self {
            frame: layout(&[Uniform]),
            project: layout(&[Uniform, Read, Read, Read, Write, Write, Write, Write, Write]),
            scan: layout(&[Write, Write, Write, Uniform]),
            bin: layout(&[Read, Read, Write, Write, Read, Write, Write]),
            sort: layout(&[Entry, Read, Write, Write, Read]),
            raster: layout(&[Read, Read, Read, Write, Write]),
            slots: layout(&[Read, Read, Read, Read, Write, Write, Write]),
            backward: layout(&[Read, Read, Read, Read, Read, Write]),
            gather: layout(&[Read, Read, Read, Write]),
            chain: layout(&[Uniform, Read, Read, Read, Read, Read, Read, Read, Write]),
        }
    }

    fn of(&self, shader: ShaderKind) -> &BindGroupLayout {
        match shader {
            ShaderKind::Project => &self.project,
            ShaderKind::Scan => &self.scan,
            ShaderKind::Bin => &self.bin,
            ShaderKind::Sort => &self.sort,
            ShaderKind::Raster => &self.raster,
            ShaderKind::Slots => &self.slots,
            ShaderKind::Backward => &self.backward,
            ShaderKind::Gather => &self.gather,
            ShaderKind::Chain => &self.chain,
        }
    }
}

fn bind_layout(gpu: &wgpu::Device, uses: &[BufferUse]) -> BindGroupLayout {
    let entry = |(binding, of): (u32, &BufferUse)| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty: match of {
                BufferUse::Uniform | BufferUse::Entry => BufferBindingType::Uniform,
                BufferUse::Read => BufferBindingType::Storage { read_only: true },
                BufferUse::Write => BufferBindingType::Storage { read_only: false },
            },
            has_dynamic_offset: *of == BufferUse::Entry,
            min_binding_size: None,
        },
        count: None,
    };
    let entries: Vec<BindGroupLayoutEntry> = (0..).zip(uses).map(entry).collect();
    gpu.create_bind_group_layout(&BindGroupLayoutDescriptor { label: None, entries: &entries })
}

/// The compiled pipelines of a frame.
#[derive(Debug)]
pub(super) struct FramePipelines {
    measure: ComputePipeline,
    place: ComputePipeline,
    scan_splats: ComputePipeline,
    scan_pairs: ComputePipeline,
    scan_splat_digits: ComputePipeline,
    scan_pair_digits: ComputePipeline,
    tally: ComputePipeline,
    emit: ComputePipeline,
    bound: ComputePipeline,
    count: ComputePipeline,
    scatter: ComputePipeline,
    raster: ComputePipeline,
    /// Only for traced frames.
    slots: Option<SlotPipelines>,
}

/// The passes that number the pairs.
#[derive(Debug)]
struct SlotPipelines {
    number: ComputePipeline,
    name: ComputePipeline,
}

impl FramePipelines {
    pub(super) fn new(device: &GpuDevice, layouts: &BindingLayouts, variant: &ShaderVariant) -> Self {
        let [project, scan, bin, sort, raster] =
            [ShaderKind::Project, ShaderKind::Scan, ShaderKind::Bin, ShaderKind::Sort, ShaderKind::Raster]
                .map(|shader| ShaderCompiler::new(device, layouts, shader, variant));
        let slots = variant.layout.trace.map(|_| {
            let slots = ShaderCompiler::new(device, layouts, ShaderKind::Slots, variant);
            SlotPipelines { number: slots.entry("number"), name: slots.entry("name") }
        });
        Self {
            measure: project.entry("measure"),
            place: project.entry("place"),
            scan_splats: scan.entry("scan_splats"),
            scan_pairs: scan.entry("scan_pairs"),
            scan_splat_digits: scan.entry("scan_splat_digits"),
            scan_pair_digits: scan.entry("scan_pair_digits"),
            tally: bin.entry("tally"),
            emit: bin.entry("emit"),
            bound: bin.entry("bound"),
            count: sort.entry("count"),
            scatter: sort.entry("scatter"),
            raster: raster.entry("raster"),
            slots,
        }
    }
}

/// One shader module, from which entry points are compiled.
pub(super) struct ShaderCompiler<'a> {
    gpu: &'a wgpu::Device,
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
}

impl<'a> ShaderCompiler<'a> {
    pub(super) fn new(
        device: &'a GpuDevice,
        layouts: &BindingLayouts,
        shader: ShaderKind,
        variant: &ShaderVariant,
    ) -> Self {
        let gpu = &device.device;
        let source = ShaderSource::Wgsl(shader.text(variant).into());
        let module = gpu.create_shader_module(ShaderModuleDescriptor { label: Some(shader.name()), source });
        let layout = gpu.create_pipeline_layout(&PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layouts.frame), Some(layouts.of(shader))],
            immediate_size: 0,
        });
        Self { gpu, module, layout }
    }

    pub(super) fn entry(&self, name: &str) -> ComputePipeline {
        // Zero initialisation is off: every pass writes its workgroup memory before it reads it.
        let compilation_options =
            PipelineCompilationOptions { zero_initialize_workgroup_memory: false, ..Default::default() };
        self.gpu.create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&self.layout),
            module: &self.module,
            entry_point: Some(name),
            compilation_options,
            cache: None,
        })
    }
}

/// A sort by digits.
#[derive(Clone, Copy)]
struct DigitSort<'a> {
    /// The uniform entry of the lowest digit.
    first: u32,
    digits: u32,
    /// From the first buffer to the second, and back.
    ways: &'a [BindGroup; 2],
    by: Dispatch,
    scan: &'a ComputePipeline,
}

/// The inputs for the passes of one region.
pub(super) struct RegionPasses<'a> {
    pub(super) pipelines: &'a FramePipelines,
    pub(super) buffers: &'a FrameBuffers,
    pub(super) parts: &'a [ScenePart],
    pub(super) region: TileRegion,
    pub(super) clock: Option<&'a DeviceClock>,
}

impl RegionPasses<'_> {
    /// Records all passes.
    pub(super) fn record(&self, encoder: &mut CommandEncoder) {
        let buffers = self.buffers;
        // Passes add to the totals, and write sizes and lists only where there is something to do.
        let ranges = buffers.traced.as_ref().map(|traced| &traced.ranges);
        for buffer in [&buffers.totals, &buffers.groups, &buffers.lists].into_iter().chain(ranges) {
            encoder.clear_buffer(buffer, 0, None);
        }
        self.stage(encoder, TimedStage::Project, |pass| self.project(pass));
        let bound = &buffers.bound;
        // `DIGITS` is even, so the order is back in its first buffer, which the later passes bind.
        let (by, scan) = (Dispatch::SplatBlocks, &self.pipelines.scan_splat_digits);
        let splats = DigitSort { first: 0, digits: DIGITS, ways: &bound.sort_splats, by, scan };
        self.stage(encoder, TimedStage::Sort, |pass| self.sort(pass, splats));
        self.stage(encoder, TimedStage::List, |pass| self.list(pass));
        let digits = self.region.tile_digits();
        let (by, scan) = (Dispatch::PairBlocks, &self.pipelines.scan_pair_digits);
        let pairs = DigitSort { first: DIGITS, digits, ways: &bound.sort_pairs, by, scan };
        self.stage(encoder, TimedStage::Bin, |pass| {
            self.sort(pass, pairs);
            self.indirect(
                pass,
                &self.pipelines.bound,
                &bound.bin[(digits % 2) as usize],
                Dispatch::PairBlocks,
            );
            if let Some((slots, ways)) = self.slots() {
                self.indirect(pass, &slots.name, &ways[(digits % 2) as usize], Dispatch::PairBlocks);
            }
        });
        self.stage(encoder, TimedStage::Raster, |pass| {
            let [columns, rows] = self.region.tiles();
            pass.set_pipeline(&self.pipelines.raster);
            pass.set_bind_group(1, &bound.raster[(digits % 2) as usize], &[]);
            pass.dispatch_workgroups(columns, rows, 1);
        });
    }

    fn stage(
        &self,
        encoder: &mut CommandEncoder,
        stage: TimedStage,
        fill: impl FnOnce(&mut ComputePass<'_>),
    ) {
        let timestamp_writes = self.clock.map(|clock| clock.stamp(stage));
        let described = ComputePassDescriptor { label: Some(stage.name()), timestamp_writes };
        let mut pass = encoder.begin_compute_pass(&described);
        // The view is the same for all pipelines of a frame.
        pass.set_bind_group(0, &self.buffers.bound.frame, &[]);
        fill(&mut pass);
    }

    /// Records the projection of each part. Its splats follow those of the earlier parts, so all
    /// are in file order.
    fn project(&self, pass: &mut ComputePass<'_>) {
        let (pipelines, bound) = (self.pipelines, &self.buffers.bound);
        for (k, part) in self.parts.iter().enumerate() {
            pass.set_pipeline(&pipelines.measure);
            pass.set_bind_group(1, &bound.project[k], &[]);
            pass.dispatch_workgroups(part.groups, 1, 1);
            record_scan(pass, &pipelines.scan_splats, &bound.scan_parts[k]);
            pass.set_pipeline(&pipelines.place);
            pass.set_bind_group(1, &bound.project[k], &[]);
            pass.dispatch_workgroups(part.groups, 1, 1);
        }
    }

    /// Records the pairs of all splats, in the order of the splats.
    fn list(&self, pass: &mut ComputePass<'_>) {
        let (pipelines, bound) = (self.pipelines, &self.buffers.bound);
        self.indirect(pass, &pipelines.tally, &bound.bin[0], Dispatch::Splats);
        record_scan(pass, &pipelines.scan_pairs, &bound.scan_tally);
        self.indirect(pass, &pipelines.emit, &bound.bin[0], Dispatch::ListedSplats);
        if let Some((slots, ways)) = self.slots() {
            self.indirect(pass, &slots.number, &ways[0], Dispatch::ListedSplats);
        }
    }

    /// The passes that number the pairs, and their groups.
    fn slots(&self) -> Option<(&SlotPipelines, &[BindGroup; 2])> {
        self.pipelines.slots.as_ref().zip(self.buffers.traced.as_ref().map(|traced| &traced.slots))
    }

    /// Records a sort. After an even number of digits, the keys are back in their first buffer.
    fn sort(&self, pass: &mut ComputePass<'_>, sort: DigitSort<'_>) {
        let DigitSort { first, digits, ways, by, scan } = sort;
        let sizes = &self.buffers.groups;
        for digit in 0..digits {
            // Digits sort in turn from the first buffer to the second and back.
            let (way, entry) = (&ways[(digit % 2) as usize], [(first + digit) * ALIGNED]);
            pass.set_pipeline(&self.pipelines.count);
            pass.set_bind_group(1, way, &entry);
            pass.dispatch_workgroups_indirect(sizes, by.offset());
            record_scan(pass, scan, &self.buffers.bound.scan_digits);
            pass.set_pipeline(&self.pipelines.scatter);
            pass.set_bind_group(1, way, &entry);
            pass.dispatch_workgroups_indirect(sizes, by.offset());
        }
    }

    fn indirect(
        &self,
        pass: &mut ComputePass<'_>,
        pipeline: &ComputePipeline,
        group: &BindGroup,
        by: Dispatch,
    ) {
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, group, &[]);
        // The device knows the size, so the host need not wait for the counts.
        pass.dispatch_workgroups_indirect(&self.buffers.groups, by.offset());
    }
}

/// Records a scan, which is one workgroup.
fn record_scan(pass: &mut ComputePass<'_>, pipeline: &ComputePipeline, group: &BindGroup) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(1, group, &[]);
    pass.dispatch_workgroups(1, 1, 1);
}
