//! Writing, packet by packet.

use super::{EDGE, END_US, VERSION, buffer, info};
use crate::order::StreamOrder;
use crate::{Event, EventFileError, EventSink};
use gs2e_image::Size;
use lz4_flex::frame::FrameEncoder;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// Number of events in a packet.
const PACKET: usize = 8192;

/// The index of the stream.
const STREAM: i32 = 0;

/// Writes one stream in constant memory. The bytes do not depend on how the stream is divided into
/// chunks.
#[derive(Debug)]
pub struct Writer {
    file: BufWriter<File>,
    order: StreamOrder,
    waiting: Vec<Event>,
}

impl Writer {
    /// Creates a file for a stream from a sensor of this size.
    ///
    /// # Errors
    /// The sensor has more than 32,768 columns or rows, or the file cannot be created.
    pub fn create(path: &Path, size: Size) -> Result<Self, EventFileError> {
        if size.width > EDGE || size.height > EDGE {
            let because = format!("a sensor of {size}, but AEDAT 4 allows at most {EDGE} columns and rows");
            return Err(EventFileError::Container(because));
        }
        let mut file = BufWriter::new(File::create(path)?);
        file.write_all(VERSION)?;
        file.write_all(&buffer::header_buffer(&info::write_info(size)))?;
        Ok(Self { file, order: StreamOrder::new(size, END_US), waiting: Vec::with_capacity(PACKET) })
    }

    /// Completes the file, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self) -> Result<u64, EventFileError> {
        self.packet()?;
        self.file.flush()?;
        Ok(self.order.count())
    }

    fn packet(&mut self) -> std::io::Result<()> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        let mut frame = FrameEncoder::new(Vec::new());
        frame.write_all(&buffer::packet_buffer(&self.waiting))?;
        let frame = frame.finish().map_err(std::io::Error::other)?;
        let length = i32::try_from(frame.len()).map_err(std::io::Error::other)?;
        self.file.write_all(&[STREAM.to_le_bytes(), length.to_le_bytes()].concat())?;
        self.waiting.clear();
        self.file.write_all(&frame)
    }
}

impl EventSink for Writer {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.order.admit(events)?;
        let mut rest = events;
        while !rest.is_empty() {
            // The cut depends on the number of events alone, so the caller's chunks do not show in
            // the bytes.
            let (now, later) = rest.split_at(rest.len().min(PACKET - self.waiting.len()));
            self.waiting.extend_from_slice(now);
            rest = later;
            if self.waiting.len() == PACKET {
                self.packet()?;
            }
        }
        Ok(())
    }
}
