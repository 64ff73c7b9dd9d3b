//! Tests of the sums over the threads of a workgroup.

use super::device::{DeviceChoice, GpuDevice};
use super::features::GpuFeature;
use super::readback::Copy;
use super::shader::{GROUP, ImageLayout, ShaderVariant, sums_text};
use gs2e_render::{ChannelSet, LayerOrder, RenderRules, RenderStyle};
use wgpu::{
    BindGroupDescriptor, BindGroupEntry, BufferDescriptor, BufferUsages, CommandEncoderDescriptor,
    ComputePassDescriptor, ComputePipelineDescriptor, ShaderModuleDescriptor, ShaderSource,
};

/// Results of a thread.
const RESULTS: usize = 6;
const TEST: &str = "
@group(0) @binding(1) var<storage, read> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(GROUP)
fn test(thread: Thread) {
    let at = place_of(thread);
    let value = values[at];
    let small = sums_of(value & 0xffffu, thread);
    let many = sums_of_many(value, thread);
    found[6u * at] = small.before;
    found[6u * at + 1u] = small.all;
    found[6u * at + 2u] = many.before;
    found[6u * at + 3u] = many.all;
    found[6u * at + 4u] = sum_of(value & 0xffffu, thread);
    found[6u * at + 5u] = sum_of_many(value, thread);
}
";

fn found(device: &GpuDevice, subgroups: bool, values: &[u32]) -> Vec<u32> {
    let style = RenderStyle {
        rules: RenderRules::Official,
        order: LayerOrder::Depth,
        antialiased: false,
        background: [0.0; 3],
    };
    let layout = ImageLayout::new(ChannelSet { rgb: true, ..ChannelSet::NONE });
    let variant = ShaderVariant { style, sh_degree: 0, layout, subgroups };
    let gpu = &device.device;
    let source = ShaderSource::Wgsl((sums_text(&variant) + TEST).into());
    let module = gpu.create_shader_module(ShaderModuleDescriptor { label: None, source });
    let pipeline = gpu.create_compute_pipeline(&ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("test"),
        compilation_options: wgpu::PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    });
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let size = (4 * RESULTS * values.len()) as u64;
    let buffer =
        |usage| gpu.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let given = buffer(BufferUsages::STORAGE | BufferUsages::COPY_DST);
    device.queue.write_buffer(&given, 0, &bytes);
    let made = buffer(BufferUsages::STORAGE | BufferUsages::COPY_SRC);
    let read = buffer(BufferUsages::MAP_READ | BufferUsages::COPY_DST);
    fn entry(binding: u32, buffer: &wgpu::Buffer) -> BindGroupEntry<'_> {
        BindGroupEntry { binding, resource: buffer.as_entire_binding() }
    }
    let group = gpu.create_bind_group(&BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[entry(1, &given), entry(2, &made)],
    });
    let mut encoder = gpu.create_command_encoder(&CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&made, 0, &read, 0, size);
    let words = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    Copy::submit(device, encoder, read, size).read(device, size, words).unwrap().0
}

/// The wanted results, from sums of 64 bits.
fn wanted(values: &[u32]) -> Vec<u32> {
    const MANY: u64 = 1 << 30;
    let small = |values: &[u32]| values.iter().map(|value| u64::from(value & 0xffff)).sum::<u64>();
    let many = |values: &[u32]| values.iter().map(|value| u64::from(*value)).sum::<u64>().min(MANY);
    let each = |at: usize| {
        let (before, all) = (&values[..at], values);
        [small(before), small(all), many(before), many(all), small(all), many(all)]
    };
    (0..values.len()).flat_map(each).map(|sum| u32::try_from(sum).unwrap()).collect()
}

#[test]
fn sums_over_threads_are_exact_and_saturate_with_subgroups_and_without() {
    let device = match GpuDevice::open(&DeviceChoice::Any) {
        Ok(device) => device,
        Err(because) => {
            assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "{because}");
            return;
        }
    };
    let n = GROUP as usize;
    let mixed = |k: usize| u32::try_from(k).unwrap().wrapping_mul(0x9e37_79b9) >> 12;
    let lone = |k: usize| if k == 77 { (1 << 30) - 3 } else { u32::from(k > 250) };
    let cases: [Vec<u32>; 6] = [
        vec![0; n],
        vec![1; n],
        (0..n).map(mixed).collect(),
        // Just below the bound, across it by ones, and far above it.
        vec![(1 << 22) - 1; n],
        (0..n).map(lone).collect(),
        vec![u32::MAX; n],
    ];
    let ways: &[bool] = if device.features().has(GpuFeature::Subgroups) { &[false, true] } else { &[false] };
    for values in &cases {
        for subgroups in ways {
            assert_eq!(found(&device, *subgroups, values), wanted(values), "{subgroups} {}", values[0]);
        }
    }
}
