//! Reading, packet by packet.

use super::buffer::BufferTable;
use super::info::{self, StreamInfo};
use super::{EVENT, EVENTS, HEADER, PacketCompression, VERSION};
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
use gs2e_files::budget;
use gs2e_num::units::Timestamp;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Maximum size of a header, bytes. It describes a few streams as XML, which takes a multiple of
/// that once it is parsed.
const MAX_HEADER: u64 = 1 << 20;

/// Maximum size of an inflated packet, bytes: 2^20 events. A packet whose compressed form is large
/// may be larger in proportion.
const MAX_PACKET: usize = 16 << 20;

/// Reads the first stream of events of a file. Its order is not checked.
#[derive(Debug)]
pub struct Reader<R = BufReader<File>> {
    input: R,
    compression: PacketCompression,
    stream: StreamInfo,
    /// Offset of the next packet.
    offset: u64,
    /// End of the packets, if the file states it.
    end: u64,
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
    pub fn new(mut input: R) -> Result<Self, EventFileError> {
        let mut version = [0; VERSION.len()];
        let begins = input.read_exact(&mut version).is_ok() && version == *VERSION;
        if !begins {
            return Err(wrong_packet(0, "it does not begin with `#!AER-DAT4.0`"));
        }
        let at = VERSION.len() as u64;
        let cut = || wrong_packet(at, "the header is truncated");
        let mut length = [0; 4];
        input.read_exact(&mut length).map_err(|_| cut())?;
        let length = u64::from(u32::from_le_bytes(length));
        if length > MAX_HEADER {
            return Err(wrong_packet(
                at,
                &format!("a header of {length} bytes, wanted at most {MAX_HEADER}"),
            ));
        }
        let bytes = read_exactly(&mut input, length)?.ok_or_else(cut)?;
        let table =
            BufferTable::root_table(&bytes, HEADER).ok_or_else(|| wrong_packet(at, "no valid header"))?;
        let number = table.i32(0).unwrap_or(0);
        let compression = PacketCompression::from_number(number)
            .ok_or_else(|| wrong_packet(at, &format!("compression number {number}, wanted 0 to 4")))?;
        let text = table
            .elements(2, 1)
            .ok_or_else(|| wrong_packet(at, "the header does not describe its streams"))?;
        let stream =
            info::read_info(&String::from_utf8_lossy(text)).map_err(|because| wrong_packet(at, &because))?;
        // Without a table of packets, its place is -1, and the packets reach to the end of the
        // file.
        let end = table.i64(1).and_then(|end| u64::try_from(end).ok()).unwrap_or(u64::MAX);
        Ok(Self { input, compression, stream, offset: at + 4 + length, end })
    }

    /// The properties that the file states.
    #[must_use]
    pub fn header(&self) -> StreamHeader {
        StreamHeader { size: self.stream.size, law: None, labelled: false }
    }

    /// The stream and the content of the next packet; `None` after the last.
    fn packet(&mut self) -> Result<Option<(i32, Vec<u8>)>, EventFileError> {
        let mut head = Vec::new();
        // Packets end where their table begins, and a file that is read once needs no table.
        if self.offset < self.end {
            self.input.by_ref().take(8).read_to_end(&mut head)?;
        }
        if head.is_empty() {
            return Ok(None);
        }
        // No byte at all is the end of the file. Fewer than 8 are a packet that was cut off.
        let cut = || wrong_packet(self.offset, "the packet is truncated");
        let word = |k: usize| Some(i32::from_le_bytes(head.get(4 * k..4 * k + 4)?.try_into().ok()?));
        let (stream, length) = word(0).zip(word(1)).ok_or_else(cut)?;
        let length = u64::try_from(length).map_err(|_| {
            wrong_packet(self.offset, &format!("a packet of {length} bytes, wanted 0 or more"))
        })?;
        let bytes = read_exactly(&mut self.input, length)?.ok_or_else(cut)?;
        self.offset += 8 + length;
        Ok(Some((stream, bytes)))
    }

    /// The events of a packet at offset `at`.
    fn events(&self, packet: &[u8], at: u64, out: &mut Vec<Event>) -> Result<(), EventFileError> {
        let inflated = self.inflate(packet).map_err(|e| wrong_packet(at, &format!("the packet: {e}")))?;
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

    fn inflate(&self, packet: &[u8]) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let limit = MAX_PACKET.max(packet.len().saturating_mul(budget::MAX_PER_BYTE));
        // One byte above the limit shows that there is more.
        let mut take = |from: &mut dyn Read| from.take(limit as u64 + 1).read_to_end(&mut bytes);
        match self.compression {
            PacketCompression::None => take(&mut &*packet),
            PacketCompression::Lz4 => take(&mut lz4_flex::frame::FrameDecoder::new(packet)),
            PacketCompression::Zstd => take(&mut zstd::Decoder::new(packet)?),
        }?;
        if bytes.len() > limit {
            let because = format!(
                "it decompresses to more than {limit} bytes, the limit for a packet of {} bytes",
                packet.len()
            );
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidData, because));
        }
        Ok(bytes)
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
            let at = self.offset;
            let Some((stream, packet)) = self.packet()? else { return Ok(false) };
            if stream == self.stream.id {
                self.events(&packet, at, out)?;
            }
        }
        Ok(true)
    }
}

/// This many bytes, or `None` if the file ends before.
fn read_exactly(file: &mut impl Read, length: u64) -> std::io::Result<Option<Vec<u8>>> {
    // Through `take`, not a buffer of `length` bytes: the length is a claim of the file.
    let mut bytes = Vec::new();
    file.by_ref().take(length).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 == length).then_some(bytes))
}

fn wrong_packet(at: u64, because: &str) -> EventFileError {
    EventFileError::Container(format!("byte {at}: {because}"))
}
