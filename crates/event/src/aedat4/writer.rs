//! Writing, packet by packet.

use super::{EDGE, VERSION, buffer, info};
use crate::order::{END_US, StreamOrder};
use crate::{Event, EventFileError, EventSink};
use gs2e_image::Size;
use lz4_flex::frame::FrameEncoder;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Number of events in a packet.
const PACKET: usize = 8192;

/// Size of the head of a packet, bytes: the stream, and the length of the rest.
const HEAD: usize = 8;

/// The index of the stream.
const STREAM: i32 = 0;

/// Writes one stream in constant memory. The bytes do not depend on how the stream is divided into
/// chunks.
#[derive(Debug)]
pub struct Writer<W = BufWriter<File>> {
    out: W,
    order: StreamOrder,
    waiting: Vec<Event>,
    /// The last packet before it is compressed.
    buffer: Vec<u8>,
    /// The encoder of whole packets, whose output is the last packet with its head.
    frames: FrameEncoder<Vec<u8>>,
}

impl Writer {
    /// Creates a file for a stream from a sensor of this size.
    ///
    /// # Errors
    /// The sensor has more than 32,768 columns or rows, or the file cannot be created.
    pub fn create(path: &Path, size: Size) -> Result<Self, EventFileError> {
        check_size(size)?;
        Self::new(BufWriter::new(File::create(path)?), size)
    }
}

impl<W: Write> Writer<W> {
    /// Writes the header of a stream from a sensor of this size.
    ///
    /// # Errors
    /// The sensor has more than 32,768 columns or rows, or writing fails.
    pub fn new(mut out: W, size: Size) -> Result<Self, EventFileError> {
        check_size(size)?;
        out.write_all(VERSION)?;
        out.write_all(&buffer::header_buffer(&info::write_info(size)))?;
        Ok(Self {
            out,
            order: StreamOrder::new(size, END_US),
            waiting: Vec::with_capacity(PACKET),
            buffer: Vec::new(),
            frames: FrameEncoder::new(Vec::new()),
        })
    }

    /// Completes the file, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails.
    pub fn finish(mut self) -> Result<u64, EventFileError> {
        self.packet()?;
        self.out.flush()?;
        Ok(self.order.count())
    }

    fn packet(&mut self) -> std::io::Result<()> {
        if self.waiting.is_empty() {
            return Ok(());
        }
        // An encoder keeps the size of blocks that the length of its first packet asks for.
        if self.waiting.len() < PACKET {
            self.frames = FrameEncoder::new(Vec::new());
        }
        buffer::packet_buffer(&self.waiting, &mut self.buffer);
        self.waiting.clear();
        self.frames.get_mut().clear();
        self.frames.get_mut().extend([0; HEAD]);
        self.frames.write_all(&self.buffer)?;
        self.frames.try_finish().map_err(std::io::Error::other)?;
        let packet = self.frames.get_mut();
        let length = i32::try_from(packet.len() - HEAD).map_err(std::io::Error::other)?;
        packet[..HEAD].copy_from_slice(&[STREAM.to_le_bytes(), length.to_le_bytes()].concat());
        self.out.write_all(packet)
    }
}

fn check_size(size: Size) -> Result<(), EventFileError> {
    if size.width > EDGE || size.height > EDGE {
        let because = format!("a sensor of {size}, but AEDAT 4 allows at most {EDGE} columns and rows");
        return Err(EventFileError::Container(because));
    }
    Ok(())
}

impl<W: Write> EventSink for Writer<W> {
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
