//! The packets of a file, of all streams.

use super::buffer::BufferTable;
use super::inflate::Inflater;
use super::{HEADER, PacketCompression, VERSION};
use crate::EventFileError;
use std::io::Read;

/// Maximum size of a header, bytes. It describes a few streams as XML, which takes a multiple of
/// that once it is parsed.
const MAX_HEADER: u64 = 1 << 20;

/// The packets after the header.
#[derive(Debug)]
pub(super) struct PacketStream<R> {
    input: R,
    /// The last packet as the file has it. Its memory serves all packets.
    stored: Vec<u8>,
    inflater: Inflater,
    /// Offset of the next packet.
    offset: u64,
    /// End of the packets, if the file states it.
    end: u64,
}

/// The head of a packet.
#[derive(Debug)]
pub(super) struct PacketHead {
    pub(super) stream: i32,
    /// Its offset in the file.
    pub(super) at: u64,
}

impl<R: Read> PacketStream<R> {
    /// Reads the header. The second value is the description of the streams.
    ///
    /// # Errors
    /// The file is of another version, or its header is damaged.
    pub(super) fn new(mut input: R) -> Result<(Self, String), EventFileError> {
        let mut version = [0; VERSION.len()];
        let begins = input.read_exact(&mut version).is_ok() && version == *VERSION;
        if !begins {
            return Err(wrong_packet(0, "it does not begin with `#!AER-DAT4.0`"));
        }
        let at = HEADER_AT;
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
        let mut bytes = Vec::new();
        if !read_exactly(&mut input, length, &mut bytes)? {
            return Err(cut());
        }
        let table =
            BufferTable::root_table(&bytes, HEADER).ok_or_else(|| wrong_packet(at, "no valid header"))?;
        let number = table.i32(0).unwrap_or(0);
        let compression = PacketCompression::from_number(number)
            .ok_or_else(|| wrong_packet(at, &format!("compression number {number}, wanted 0 to 4")))?;
        let text = table
            .elements(2, 1)
            .ok_or_else(|| wrong_packet(at, "the header does not describe its streams"))?;
        // Without a table of packets, its place is -1, and the packets reach to the end of the
        // file.
        let end = table.i64(1).and_then(|end| u64::try_from(end).ok()).unwrap_or(u64::MAX);
        let text = String::from_utf8_lossy(text).into_owned();
        let (stored, inflater) = (bytes, Inflater::new(compression));
        Ok((Self { input, stored, inflater, offset: at + 4 + length, end }, text))
    }

    /// Reads the next packet; `None` after the last.
    pub(super) fn next(&mut self) -> Result<Option<PacketHead>, EventFileError> {
        let head = &mut self.stored;
        head.clear();
        // Packets end where their table begins, and a file that is read once needs no table.
        if self.offset < self.end {
            self.input.by_ref().take(8).read_to_end(head)?;
        }
        if head.is_empty() {
            return Ok(None);
        }
        // No byte at all is the end of the file. Fewer than 8 are a packet that was cut off.
        let at = self.offset;
        let cut = || wrong_packet(at, "the packet is truncated");
        let word = |k: usize| Some(i32::from_le_bytes(head.get(4 * k..4 * k + 4)?.try_into().ok()?));
        let (stream, length) = word(0).zip(word(1)).ok_or_else(cut)?;
        let length = u64::try_from(length)
            .map_err(|_| wrong_packet(at, &format!("a packet of {length} bytes, wanted 0 or more")))?;
        if !read_exactly(&mut self.input, length, &mut self.stored)? {
            return Err(cut());
        }
        self.offset += 8 + length;
        Ok(Some(PacketHead { stream, at }))
    }

    /// The buffer in the packet that was read last.
    pub(super) fn inflate(&mut self, packet: &PacketHead) -> Result<&[u8], EventFileError> {
        let inflated = self.inflater.inflate(&self.stored);
        inflated.map_err(|e| wrong_packet(packet.at, &format!("the packet: {e}")))
    }
}

/// Offset of the header.
pub(super) const HEADER_AT: u64 = VERSION.len() as u64;

/// Replaces `bytes` by this many. Returns false if the file ends before.
fn read_exactly(file: &mut impl Read, length: u64, bytes: &mut Vec<u8>) -> std::io::Result<bool> {
    bytes.clear();
    // Through `take`, not a buffer of `length` bytes: the length is a claim of the file.
    Ok(file.by_ref().take(length).read_to_end(bytes)? as u64 == length)
}

pub(super) fn wrong_packet(at: u64, because: &str) -> EventFileError {
    EventFileError::Container(format!("byte {at}: {because}"))
}
