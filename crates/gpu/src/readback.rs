//! Transfer of images and counts from the device.

use super::clock;
use super::device::GpuDevice;
use super::shader::{ImageLayout, TOTALS, Total, UNDEFINED};
use super::{TileRegion, passes::RegionPasses};
use gs2e_image::{Image, Size};
use gs2e_render::{GpuError, RenderWork, RenderedImages};
use rayon::prelude::*;
use std::sync::mpsc;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, BufferView, CommandEncoder, CommandEncoderDescriptor, MapMode,
    PollType, SubmissionIndex,
};

/// Staging buffers for reuse by later frames.
#[derive(Debug, Default)]
pub(super) struct Ring {
    idle: Vec<Buffer>,
}

/// A transfer of one region's counts and images that is under way.
#[derive(Debug)]
pub(super) struct Copy {
    buffer: Buffer,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submitted: SubmissionIndex,
}

/// Size of the counts, bytes. Counts and time stamps, together [`HEAD`], precede the images.
const COUNTS: usize = 4 * TOTALS;
const HEAD: usize = COUNTS + clock::BYTES;

/// Size of a transfer with this many floats of images, bytes.
pub(super) fn transfer_bytes(floats: u64) -> u64 {
    HEAD as u64 + 4 * floats
}

impl Ring {
    /// Submits passes, then a copy of their counts and of this many floats of images.
    pub(super) fn submit(
        &mut self,
        device: &GpuDevice,
        passes: &RegionPasses<'_>,
        floats: u64,
    ) -> Result<Copy, GpuError> {
        let size = transfer_bytes(floats);
        let at = self.idle.iter().position(|b| b.size() >= size);
        let buffer = match at {
            Some(at) => self.idle.swap_remove(at),
            None => {
                // All of them are too small for the present frames, and would only take memory.
                self.idle.clear();
                let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
                device.allocate("images to be read", size, |gpu| {
                    gpu.create_buffer(&BufferDescriptor {
                        label: None,
                        size,
                        usage,
                        mapped_at_creation: false,
                    })
                })?
            }
        };
        let mut encoder = device.device.create_command_encoder(&CommandEncoderDescriptor::default());
        passes.record(&mut encoder);
        encoder.copy_buffer_to_buffer(&passes.buffers.totals, 0, &buffer, 0, COUNTS as u64);
        if let Some(clock) = passes.clock {
            clock.copy(&mut encoder, &buffer, COUNTS as u64);
        }
        if floats > 0 {
            encoder.copy_buffer_to_buffer(&passes.buffers.images, 0, &buffer, HEAD as u64, 4 * floats);
        }
        Ok(Copy::submit(device, encoder, buffer, size))
    }

    /// Waits for the transfer, and passes on counts, time stamps and images.
    pub(super) fn read<T>(
        &mut self,
        device: &GpuDevice,
        copy: Copy,
        floats: u64,
        read: impl FnOnce(&Totals, &[u8], &[u8]) -> T,
    ) -> Result<T, GpuError> {
        let (done, buffer) = copy.read(device, transfer_bytes(floats), |bytes| {
            // The same layout as in `submit`: counts, time stamps, images.
            let (head, images) = bytes.split_at(HEAD);
            let (counts, stamps) = head.split_at(COUNTS);
            read(&Totals::from_bytes(counts), stamps, images)
        })?;
        self.idle.push(buffer);
        Ok(done)
    }
}

impl Copy {
    /// Submits the encoder's commands, and asks for the first bytes of a buffer that they write.
    pub(super) fn submit(device: &GpuDevice, encoder: CommandEncoder, buffer: Buffer, size: u64) -> Self {
        let submitted = device.queue.submit([encoder.finish()]);
        let (tell, mapped) = mpsc::channel();
        // The receiver is gone if the frame was abandoned.
        buffer.slice(..size).map_async(MapMode::Read, move |result| drop(tell.send(result)));
        Self { buffer, mapped, submitted }
    }

    /// Waits for the bytes, and passes them on. Returns the buffer for reuse.
    pub(super) fn read<T>(
        self,
        device: &GpuDevice,
        size: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<(T, Buffer), GpuError> {
        let wait = PollType::Wait { submission_index: Some(self.submitted), timeout: None };
        device.device.poll(wait).map_err(|e| device.lost(&e.to_string()))?;
        device.check()?;
        // The poll has run the callback, so the result is there.
        let mapped = self.mapped.recv().map_err(|e| device.lost(&e.to_string()))?;
        mapped.map_err(|e| device.lost(&e.to_string()))?;
        let view = self.buffer.slice(..size).get_mapped_range();
        let view: BufferView = view.map_err(|e| device.lost(&e.to_string()))?;
        let done = read(&view);
        drop(view);
        self.buffer.unmap();
        Ok((done, self.buffer))
    }
}

/// The counts of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Totals([u32; TOTALS]);

impl Totals {
    fn from_bytes(bytes: &[u8]) -> Self {
        let mut words = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word));
        Self(std::array::from_fn(|_| words.next().unwrap_or(0)))
    }

    pub(super) fn of_count(&self, total: Total) -> u32 {
        self.0[total as usize]
    }

    /// The work of a region. Every region counts what was left out of the whole image.
    pub(super) fn work(&self, gaussians: usize) -> RenderWork {
        let count = |total| u64::from(self.of_count(total));
        RenderWork {
            gaussians: gaussians as u64,
            behind: count(Total::Behind),
            degenerate: count(Total::Degenerate),
            outside: count(Total::Outside),
            tile_pairs: count(Total::Pairs),
            // Atomic counters have 32 bits, so the second one counts the overflows of the first.
            blended: count(Total::Blended) | count(Total::BlendedCarry) << 32,
            stopped: count(Total::Stopped),
            affine_doubtful: count(Total::Doubtful),
            affine_invalid: count(Total::Invalid),
            ..RenderWork::default()
        }
    }
}

/// The transferred images of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct RegionImages<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) layout: ImageLayout,
    pub(super) region: TileRegion,
    /// Size of the whole image.
    pub(super) size: Size,
}

impl RegionImages<'_> {
    /// Copies the images into those of the whole image, and removes the others.
    pub(super) fn place(self, out: &mut RenderedImages) {
        let Self { layout, .. } = self;
        let float = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
        let depth = |bytes: &[u8; 4]| {
            let z = float(bytes);
            // Defined depths are positive, so a negative number marks undefined ones.
            if z <= UNDEFINED { f32::NAN } else { z }
        };
        let colour = |bytes: &[u8; 12]| {
            let (channels, _) = bytes.as_chunks();
            [float(&channels[0]), float(&channels[1]), float(&channels[2])]
        };
        self.fill(&mut out.rgb, layout.rgb, colour);
        self.fill(&mut out.luminance, layout.grey, float);
        self.fill(&mut out.alpha, layout.alpha, float);
        self.fill(&mut out.depth, layout.depth, depth);
        self.fill(&mut out.doubtful, layout.doubtful, float);
        self.fill(&mut out.luminance_rate, layout.rate, float);
    }

    /// Returns true if all floats are finite. Undefined depths are marked by a number.
    pub(super) fn is_finite(self) -> bool {
        self.bytes.as_chunks().0.iter().all(|bytes| f32::from_le_bytes(*bytes).is_finite())
    }

    /// Fills the region of an image from values of `N` bytes behind this many planes of floats, or removes
    /// the image.
    ///
    /// All cores copy: one core moves some 5 GB/s, and the link to a device brings ten times as much.
    fn fill<T: std::marker::Copy + Default + Send, const N: usize>(
        self,
        image: &mut Option<Image<T>>,
        planes: Option<u32>,
        value: impl Fn(&[u8; N]) -> T + Sync,
    ) {
        let Self { bytes, region, size, .. } = self;
        let Some(planes) = planes else {
            *image = None;
            return;
        };
        // An image of another size is replaced; one of this size keeps the regions placed before.
        let reused = image.take().filter(|i| i.size() == size);
        let mut filled = reused.unwrap_or_else(|| Image::filled(size, T::default()));
        let [x, y] = region.origin();
        let ([columns, _], pixels) = (region.extent(size), region.pixels(size));
        let width = size.width as usize;
        let (values, _) = bytes[4 * planes as usize * pixels..][..N * pixels].as_chunks::<N>();
        let rows = filled.pixels_mut()[y * width..].par_chunks_mut(width).with_min_len(ROWS_AT_A_TIME);
        rows.zip(values.par_chunks_exact(columns)).for_each(|(to, from)| {
            to[x..][..columns].iter_mut().zip(from).for_each(|(to, from)| *to = value(from));
        });
        *image = Some(filled);
    }
}

/// Rows that a thread copies at a time, at least: fewer are faster than a second thread wakes up.
const ROWS_AT_A_TIME: usize = 16;
