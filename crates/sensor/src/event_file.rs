//! The file for the events of one simulation, with what it states about them.

use super::SensorChoice;
use gs2e_event::file::{EventFile, EventFormat};
use gs2e_event::h5::{ChunkFilter, H5Options};
use gs2e_event::{EventFileError, LawStamp, StreamHeader, file};
use gs2e_image::Size;
use std::path::Path;

/// The stream that a file is for.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedStream<'a> {
    /// The sensor.
    pub sensor: &'a SensorChoice,
    /// Size of the frames.
    pub size: Size,
    /// The first and the last stamp, in microseconds.
    pub span_us: (i64, i64),
}

impl SimulatedStream<'_> {
    /// Creates the file. It takes events with times from the first stamp. The file stores the times of the
    /// stamps if its format can.
    ///
    /// # Errors
    /// The format cannot hold such a stream, or the file cannot be created.
    pub fn create_file(
        &self,
        path: &Path,
        format: EventFormat,
        filter: ChunkFilter,
    ) -> Result<Box<dyn EventFile>, EventFileError> {
        let model = self.sensor.as_model();
        let (c_on, c_off) = model.contrast();
        let law = Some(LawStamp { version: model.law_version(), c_on, c_off });
        let header = StreamHeader { size: self.size, law, labelled: model.labels() };
        let (first_us, last_us) = self.span_us;
        // An .h5 counts its times from 0 only if 32 bits can hold them.
        let h5 = H5Options { filter, t_offset_us: 0 }.spanning(first_us, last_us);
        file::create(path, format, &header, file::WriteOptions { zero_us: first_us, h5 })
    }

    /// Time from the first stamp to the last, in microseconds. A file is finished with it, since its times
    /// count from the first stamp.
    #[must_use]
    pub fn length_us(&self) -> i64 {
        self.span_us.1 - self.span_us.0
    }
}
