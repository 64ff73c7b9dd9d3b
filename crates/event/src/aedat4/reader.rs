//! Reading, packet by packet.

use super::buffer::BufferTable;
use super::info::{self, StreamInfo};
use super::packets::{HEADER_AT, PacketHead, PacketStream, wrong_packet};
use super::{EVENT, EVENTS};
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Reads the first stream of events of a file. Its order is not checked.
#[derive(Debug)]
pub struct Reader<R = BufReader<File>> {
    packets: PacketStream<R>,
    stream: StreamInfo,
}

impl Reader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// The file is of another version, or its header names no stream of events or no sensor size.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        Self::new(BufReader::new(files::open(path)?))
    }
}

impl<R: Read> Reader<R> {
    /// Reads the header of a recording.
    ///
    /// # Errors
    /// It is of another version, or its header names no stream of events or no sensor size.
    pub fn new(input: R) -> Result<Self, EventFileError> {
        let (packets, text) = PacketStream::new(input)?;
        let stream = info::read_info(&text).map_err(|because| wrong_packet(HEADER_AT, &because))?;
        Ok(Self { packets, stream })
    }

    /// The properties that the file states.
    #[must_use]
    pub fn header(&self) -> StreamHeader {
        StreamHeader { size: self.stream.size, law: None, labelled: false }
    }

    /// The events of a packet.
    fn events(&mut self, packet: &PacketHead, out: &mut Vec<Event>) -> Result<(), EventFileError> {
        let (at, inflated) = (packet.at, self.packets.inflate(packet)?);
        // The first 4 bytes are the size of the buffer.
        let table = inflated.get(4..).and_then(|bytes| BufferTable::root_table(bytes, EVENTS));
        let table = table.ok_or_else(|| wrong_packet(at, "the packet holds no events"))?;
        // A packet without its field has no events.
        let (stored, _) = table.elements(0, EVENT).unwrap_or_default().as_chunks();
        let (size, first) = (self.stream.size, out.len());
        let mut sound = true;
        // Without a branch per event: the one that is wrong is looked for afterwards.
        out.extend(stored.iter().map(|bytes| {
            let (event, is_sound) = parse_event(bytes, size);
            sound &= is_sound;
            event
        }));
        if sound {
            return Ok(());
        }
        let wrong = stored.iter().position(|bytes| !parse_event(bytes, size).1).expect("one is wrong");
        out.truncate(first + wrong);
        Err(wrong_packet(at, &refusal(&stored[wrong], size)))
    }
}

/// An event, and whether its values are those of an event on a sensor of this size.
#[inline]
fn parse_event(bytes: &[u8; EVENT], Size { width, height }: Size) -> (Event, bool) {
    let (t, [x, y], stored) = fields(bytes);
    let side = |v: i16, end: u32| (v.cast_unsigned(), v >= 0 && u32::from(v.cast_unsigned()) < end);
    let ((x, has_column), (y, has_row)) = (side(x, width), side(y, height));
    let polarity = if stored == 1 { Polarity::On } else { Polarity::Off };
    // Times out of range wrap around, and are refused.
    let t_ns = Timestamp(t.wrapping_mul(1000));
    let is_sound = (0..END_US).contains(&t) & has_column & has_row & (stored <= 1);
    (Event { t: t_ns, x, y, polarity, label: EventLabel::Signal }, is_sound)
}

/// Time, column and row, and polarity.
#[inline]
fn fields(bytes: &[u8; EVENT]) -> (i64, [i16; 2], u8) {
    let [t @ .., x0, x1, y0, y1, polarity, _, _, _] = *bytes;
    (i64::from_le_bytes(t), [[x0, x1], [y0, y1]].map(i16::from_le_bytes), polarity)
}

/// The value that no event can have.
fn refusal(bytes: &[u8; EVENT], size: Size) -> String {
    let (t, [x, y], polarity) = fields(bytes);
    let is_outside = |v: i16, end: u32| u32::try_from(v).map_or(true, |v| v >= end);
    if !(0..END_US).contains(&t) {
        format!("t = {t} us, wanted 0 to {}", END_US - 1)
    } else if is_outside(x, size.width) || is_outside(y, size.height) {
        format!("pixel ({x}, {y}) is outside the sensor of {size}")
    } else {
        format!("polarity {polarity}, wanted 0 or 1")
    }
}

impl<R: Read> EventSource for Reader<R> {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        // Packets of other streams have no events, so reading goes on until there is one.
        while out.is_empty() {
            let Some(packet) = self.packets.next()? else { return Ok(false) };
            if packet.stream == self.stream.id {
                self.events(&packet, out)?;
            }
        }
        Ok(true)
    }
}
