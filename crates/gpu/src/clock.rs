//! Time that the device spends on each stage of a frame, by its own clock if it has one.

use super::device::GpuDevice;
use super::features::GpuFeature;
use std::time::Duration;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, QuerySet,
    QuerySetDescriptor, QueryType,
};

/// A stage of a frame that is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimedStage {
    /// Projection of every Gaussian.
    Project,
    /// Sort of the splats by depth.
    Sort,
    /// Pairs of splats and tiles.
    List,
    /// Sort of the pairs by tile.
    Bin,
    /// Blending, and the images.
    Raster,
}

impl TimedStage {
    /// All stages, in the order in which the device runs them.
    pub const ALL: [Self; 5] = [Self::Project, Self::Sort, Self::List, Self::Bin, Self::Raster];

    /// Name of the stage.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Project => "project",
            Self::Sort => "sort",
            Self::List => "list",
            Self::Bin => "bin",
            Self::Raster => "raster",
        }
    }
}

/// Number of time stamps of a frame: the begin and the end of each stage.
const STAMPS: u32 = 2 * (TimedStage::Raster as u32 + 1);

/// Size of the time stamps, bytes.
pub(super) const BYTES: usize = 8 * STAMPS as usize;

/// Reads the clock of the device.
#[derive(Debug)]
pub(super) struct DeviceClock {
    stamps: QuerySet,
    resolved: Buffer,
    nanoseconds_a_tick: f32,
}

impl DeviceClock {
    /// The clock of the device, if it has one.
    pub(super) fn new(device: &GpuDevice) -> Option<Self> {
        let gpu = &device.device;
        device.features().has(GpuFeature::Timestamps).then(|| Self {
            stamps: gpu.create_query_set(&QuerySetDescriptor {
                label: None,
                ty: QueryType::Timestamp,
                count: STAMPS,
            }),
            resolved: gpu.create_buffer(&BufferDescriptor {
                label: None,
                size: BYTES as u64,
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            nanoseconds_a_tick: device.queue.get_timestamp_period(),
        })
    }

    /// Records time stamps at the begin and the end of a stage.
    pub(super) fn stamp(&self, stage: TimedStage) -> ComputePassTimestampWrites<'_> {
        let first = 2 * stage as u32;
        ComputePassTimestampWrites {
            query_set: &self.stamps,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Copies the time stamps to a buffer.
    pub(super) fn copy(&self, encoder: &mut CommandEncoder, to: &Buffer, at: u64) {
        // By a buffer in between: one that the host can map cannot take queries.
        encoder.resolve_query_set(&self.stamps, 0..STAMPS, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, to, at, BYTES as u64);
    }

    /// Durations of the stages, from the copied time stamps.
    #[expect(clippy::cast_precision_loss, reason = "53 bits of a duration are more than the clock has")]
    pub(super) fn times(&self, stamps: &[u8]) -> [Duration; TimedStage::ALL.len()] {
        let stamp = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| stamps[8 * i + k]));
        TimedStage::ALL.map(|stage| {
            let ticks = stamp(2 * stage as usize + 1).saturating_sub(stamp(2 * stage as usize));
            Duration::from_secs_f64(ticks as f64 * f64::from(self.nanoseconds_a_tick) * 1e-9)
        })
    }
}
