//! A scene on the device, in parts that each fit one binding.

#![expect(clippy::cast_possible_truncation, reason = "a part's Gaussians are few enough for 32 bits")]

use super::device::{GpuDevice, GpuError};
use super::shader::{GROUP, LOST, SPOILT};
use crate::render::cpu::activate::{self, ActivatedGaussian};
use crate::scene::Gaussians;
use rayon::prelude::*;
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

/// Maximum number of workgroups of a dispatch along one axis that every device supports.
pub(super) const MAX_GROUPS: u32 = 65_535;

/// Gaussians that one dispatch projects.
#[derive(Debug)]
pub(super) struct ScenePart {
    /// Number of workgroups, at one thread per Gaussian.
    pub(super) groups: u32,
    /// `Part` of the shaders.
    pub(super) counts: Buffer,
    pub(super) means: Buffer,
    pub(super) axes: Buffer,
    pub(super) harmonics: Buffer,
}

/// Sizes of a mean, of the scaled axes, and of the coefficients of one harmonic, bytes.
const MEAN: u64 = 16;
const AXES: u64 = 36;
const HARMONIC: u64 = 12;

/// Uploads a scene. Activations are applied here, once, with the code of the CPU renderer.
pub(super) fn upload_scene(scene: &Gaussians, device: &GpuDevice) -> Result<Vec<ScenePart>, GpuError> {
    let activated: Vec<ActivatedGaussian> =
        (0..scene.len()).into_par_iter().map(|i| activate::activate_one(scene, i)).collect();
    // Each array must fit one binding, so the largest row decides.
    let each = (HARMONIC * scene.sh_len() as u64).max(AXES).max(MEAN);
    let most = (device.limit / each).min(u64::from(MAX_GROUPS * GROUP)).max(1) as usize;
    (0..scene.len())
        .step_by(most)
        .map(|first| ScenePart::new(scene, &activated, first..scene.len().min(first + most), device))
        .collect()
}

impl ScenePart {
    fn new(
        scene: &Gaussians,
        activated: &[ActivatedGaussian],
        range: std::ops::Range<usize>,
        device: &GpuDevice,
    ) -> Result<Self, GpuError> {
        let (count, n) = (range.len() as u64, scene.sh_len());
        let [means, axes, harmonics] = [MEAN, AXES, HARMONIC * n as u64].map(|each| each * count);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let groups = (range.len() as u32).div_ceil(GROUP);
        let part = device.allocate("the scene", means + axes + harmonics, |device| {
            let buffer = |size, usage| {
                device.create_buffer(&BufferDescriptor {
                    label: None,
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            };
            Self {
                groups,
                counts: buffer(16, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
                means: buffer(means, usage),
                axes: buffer(axes, usage),
                harmonics: buffer(harmonics, usage),
            }
        })?;
        // Two words, padded to a row of a uniform buffer.
        let words: Vec<u8> = [count as u32, groups, 0, 0].into_iter().flat_map(u32::to_le_bytes).collect();
        device.queue.write_buffer(&part.counts, 0, &words);
        write_rows(device, &part.means, range.clone().map(|i| mean_row(scene.positions[i], &activated[i])));
        write_rows(device, &part.axes, range.clone().map(|i| axes_of(&activated[i])));
        write_rows(device, &part.harmonics, scene.sh[range.start * n..range.end * n].iter().copied());
        Ok(part)
    }
}

/// Position and opacity. NaN is not portable in WGSL, so special opacities mark values that are not
/// finite.
fn mean_row(position: [f32; 3], activated: &ActivatedGaussian) -> [f32; 4] {
    let [x, y, z] = position;
    match (position.iter().all(|v| v.is_finite()), activated.axes[0][0].is_nan()) {
        (false, _) => [0.0, 0.0, 0.0, LOST],
        (true, true) => [x, y, z, SPOILT],
        (true, false) => [x, y, z, activated.opacity],
    }
}

fn axes_of(activated: &ActivatedGaussian) -> [f32; 9] {
    let [[a, b, c], [d, e, f], [g, h, i]] = activated.axes;
    if a.is_nan() { [0.0; 9] } else { [a, b, c, d, e, f, g, h, i] }
}

/// Uploads rows in chunks of some MiB.
fn write_rows<const N: usize>(device: &GpuDevice, buffer: &Buffer, rows: impl Iterator<Item = [f32; N]>) {
    const ENOUGH: usize = 4 << 20;
    let (mut bytes, mut at) = (Vec::with_capacity(ENOUGH + 4 * N), 0);
    for row in rows {
        row.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        if bytes.len() >= ENOUGH {
            device.queue.write_buffer(buffer, at, &bytes);
            at += bytes.len() as u64;
            bytes.clear();
        }
    }
    device.queue.write_buffer(buffer, at, &bytes);
}
