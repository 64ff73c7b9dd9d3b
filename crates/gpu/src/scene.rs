//! A scene on the device, in parts that each fit one binding.

#![expect(clippy::cast_possible_truncation, reason = "a part's Gaussians are few enough for 32 bits")]

use super::device::GpuDevice;
use super::shader::{GROUP, LOST, SPOILT};
use gs2e_render::GpuError;
use gs2e_render::cpu::activate;
use gs2e_render::cpu::activate::ActivatedGaussian;
use gs2e_scene::{Gaussians, sh};
use rayon::prelude::*;
use std::ops::Range;
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

/// Maximum number of workgroups of a dispatch along one axis that every device supports.
pub(super) const MAX_GROUPS: u32 = 65_535;

/// Gaussians that one dispatch projects.
#[derive(Debug)]
pub(super) struct ScenePart {
    /// Indices of its Gaussians in the scene.
    pub(super) range: Range<usize>,
    /// Number of workgroups, at one thread per Gaussian.
    pub(super) groups: u32,
    /// `Part` of the shaders.
    pub(super) counts: Buffer,
    pub(super) means: Buffer,
    pub(super) axes: Buffer,
    pub(super) harmonics: Buffer,
    /// Stored quaternions, for gradients.
    pub(super) rotations: Option<Buffer>,
}

/// Sizes of a mean, of the scaled axes, of a quaternion, and of the coefficients of one harmonic, bytes.
const MEAN: u64 = 16;
const AXES: u64 = 36;
const ROTATION: u64 = 16;
const HARMONIC: u64 = 12;

/// Uploads a scene. Activations are applied here, with the code of the CPU renderer. Gradients also
/// need the quaternions.
pub(super) fn upload_scene(
    scene: &Gaussians,
    degree: u8,
    rotations: bool,
    device: &GpuDevice,
) -> Result<Vec<ScenePart>, GpuError> {
    // Each array must fit one binding, so the largest row decides.
    let each = (HARMONIC * scene.sh_len() as u64).max(AXES).max(MEAN);
    let most = (device.limit / each).min(u64::from(MAX_GROUPS * GROUP)).max(1) as usize;
    let mut parts = Vec::new();
    for first in (0..scene.len()).step_by(most) {
        let range = first..scene.len().min(first + most);
        let part = ScenePart::new(range.clone(), scene.sh_len(), rotations, device)?;
        part.write(scene, degree, range, device);
        parts.push(part);
    }
    Ok(parts)
}

impl ScenePart {
    /// Room for these Gaussians, with this number of harmonics each.
    fn new(
        range: Range<usize>,
        functions: usize,
        rotations: bool,
        device: &GpuDevice,
    ) -> Result<Self, GpuError> {
        let count = range.len() as u64;
        let [means, axes, harmonics] = [MEAN, AXES, HARMONIC * functions as u64].map(|each| each * count);
        let turned = if rotations { ROTATION * count } else { 0 };
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let groups = (range.len() as u32).div_ceil(GROUP);
        // Three words, padded to a row of a uniform buffer.
        let words = [count as u32, groups, range.start as u32, 0].map(u32::to_le_bytes);
        let part = device.allocate("the scene", means + axes + harmonics + turned, |device| {
            let buffer = |size, usage| {
                device.create_buffer(&BufferDescriptor {
                    label: None,
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            };
            Self {
                range,
                groups,
                counts: buffer(16, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
                means: buffer(means, usage),
                axes: buffer(axes, usage),
                harmonics: buffer(harmonics, usage),
                rotations: rotations.then(|| buffer(turned, usage)),
            }
        })?;
        device.queue.write_buffer(&part.counts, 0, words.as_flattened());
        Ok(part)
    }

    /// Writes those Gaussians of a range that are in this part. Harmonics above the degree are zeros.
    pub(super) fn write(&self, scene: &Gaussians, degree: u8, range: Range<usize>, device: &GpuDevice) {
        let range = range.start.max(self.range.start)..range.end.min(self.range.end);
        if range.is_empty() {
            return;
        }
        let activate = |i| activate::activate_one(scene, i);
        let activated: Vec<ActivatedGaussian> = range.clone().into_par_iter().map(activate).collect();
        let (first, n) = ((range.start - self.range.start) as u64, scene.sh_len());
        let each = || range.clone().zip(&activated);
        let means = each().map(|(i, activated)| mean_row(scene.positions[i], activated));
        write_rows(device, &self.means, first, means);
        write_rows(device, &self.axes, first, activated.iter().map(axes_of));
        let kept = sh::function_count(degree);
        let coefficients = scene.sh[range.start * n..range.end * n].iter().enumerate();
        // The harmonics of a Gaussian are sorted by degree, so those above `degree` come last.
        let coefficients = coefficients.map(|(k, value)| if k % n < kept { *value } else { [0.0; 3] });
        write_rows(device, &self.harmonics, first * n as u64, coefficients);
        if let Some(rotations) = &self.rotations {
            write_rows(device, rotations, first, scene.rotations[range.clone()].iter().copied());
        }
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

/// Uploads rows in chunks of some MiB, from a row of the buffer on.
fn write_rows<const N: usize>(
    device: &GpuDevice,
    buffer: &Buffer,
    first: u64,
    rows: impl Iterator<Item = [f32; N]>,
) {
    const ENOUGH: usize = 4 << 20;
    let (mut bytes, mut at) = (Vec::new(), first * 4 * N as u64);
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
