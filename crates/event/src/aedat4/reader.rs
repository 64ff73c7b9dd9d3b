//! Reading, packet by packet.

use super::buffer::BufferTable;
use super::info::{self, StreamInfo};
use super::packets::{HEADER_AT, PacketStream, StoredPacket, wrong_packet};
use super::{EVENT, EVENTS};
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
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
    fn events(&self, packet: &StoredPacket, out: &mut Vec<Event>) -> Result<(), EventFileError> {
        let (at, inflated) = (packet.at, self.packets.inflate(packet)?);
        // The first 4 bytes are the size of the buffer.
        let table = inflated.get(4..).and_then(|bytes| BufferTable::root_table(bytes, EVENTS));
        let table = table.ok_or_else(|| wrong_packet(at, "the packet holds no events"))?;
        // A packet without its field has no events.
        for bytes in table.elements(0, EVENT).unwrap_or_default().chunks_exact(EVENT) {
            let event = self.event(bytes).map_err(|because| wrong_packet(at, &because))?;
            out.push(event);
        }
        Ok(())
    }

    fn event(&self, bytes: &[u8]) -> Result<Event, String> {
        let t = i64::from_le_bytes(bytes[..8].try_into().expect("8 of 16 bytes"));
        let [x, y] = [8, 10].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]));
        if !(0..END_US).contains(&t) {
            return Err(format!("t = {t} us, wanted 0 to {}", END_US - 1));
        }
        let side = |v: i16, end: u32| u16::try_from(v).ok().filter(|v| u32::from(*v) < end);
        let size = self.stream.size;
        let (Some(column), Some(row)) = (side(x, size.width), side(y, size.height)) else {
            return Err(format!("pixel ({x}, {y}) is outside the sensor of {size}"));
        };
        let polarity = Polarity::from_number(bytes[12]);
        let polarity = polarity.ok_or_else(|| format!("polarity {}, wanted 0 or 1", bytes[12]))?;
        Ok(Event { t: Timestamp::from_micros(t), x: column, y: row, polarity, label: EventLabel::Signal })
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
