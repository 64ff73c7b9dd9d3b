//! The `FlatBuffers`: a size, the offset of a table, an identifier, and the table. A table
//! begins with the offset of its list of fields.

use super::{EVENT, EVENTS, HEADER};
use crate::Event;

/// Number of bytes before the events of a packet.
const BEFORE_EVENTS: usize = 32;

/// A header for LZ4 frames without a table of packets. Numbers of 8 bytes are at multiples of 8.
pub(super) fn header_buffer(info: &str) -> Vec<u8> {
    const LZ4: i32 = 1;
    const NO_TABLE: i64 = -1;
    let mut bytes = Vec::new();
    bytes.extend(20_u32.to_le_bytes()); // the table
    bytes.extend(HEADER);
    // The list of fields: its size, the size of the table, then the offset of each of the three
    // fields.
    bytes.extend([10_u16, 20, 4, 8, 16, 0].map(u16::to_le_bytes).concat());
    bytes.extend(12_i32.to_le_bytes()); // back to the list
    bytes.extend(LZ4.to_le_bytes());
    bytes.extend(NO_TABLE.to_le_bytes());
    bytes.extend(4_u32.to_le_bytes()); // on to the text
    bytes.extend(buffer_length(info.len()).to_le_bytes());
    bytes.extend(info.as_bytes());
    // A text ends with a zero byte, and a buffer has a multiple of 4 bytes.
    bytes.resize((bytes.len() + 1).next_multiple_of(4), 0);
    with_size(bytes)
}

/// Replaces `bytes` by a packet.
#[expect(clippy::cast_sign_loss, reason = "times are 0 or more")]
pub(super) fn packet_buffer(events: &[Event], bytes: &mut Vec<u8>) {
    bytes.clear();
    bytes.extend(buffer_length(BEFORE_EVENTS - 4 + EVENT * events.len()).to_le_bytes());
    bytes.extend(16_u32.to_le_bytes()); // the table
    bytes.extend(EVENTS);
    // As in the header, with one field. The last number fills up to 4 bytes, so that events begin at byte 32.
    bytes.extend([6_u16, 8, 4, 0].map(u16::to_le_bytes).concat());
    bytes.extend(8_i32.to_le_bytes()); // back to the list
    bytes.extend(4_u32.to_le_bytes()); // on to the vector
    bytes.extend(buffer_length(events.len()).to_le_bytes());
    bytes.resize(BEFORE_EVENTS + EVENT * events.len(), 0);
    let (stored, _) = bytes[BEFORE_EVENTS..].as_chunks_mut();
    for (stored, event) in stored.iter_mut().zip(events) {
        let place = u64::from(event.y) << 16 | u64::from(event.x);
        // Three bytes fill the structure up to 16, a multiple of its longest number.
        let upper = (event.polarity as u64) << 32 | place;
        *stored = (u128::from(upper) << 64 | u128::from(event.t.floor_micros() as u64)).to_le_bytes();
    }
}

fn buffer_length(n: usize) -> u32 {
    u32::try_from(n).expect("packets and headers are small")
}

fn with_size(bytes: Vec<u8>) -> Vec<u8> {
    [buffer_length(bytes.len()).to_le_bytes().to_vec(), bytes].concat()
}

/// A table of a buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct BufferTable<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> BufferTable<'a> {
    /// The root table of a buffer without its size, if the buffer has this identifier.
    pub(super) fn root_table(bytes: &'a [u8], identifier: &[u8; 4]) -> Option<Self> {
        if bytes.get(4..8)? != identifier {
            return None;
        }
        Some(Self { bytes, at: u32_at(bytes, 0)? })
    }

    /// Place of field `k`; `None` if it is absent and has its default.
    fn field(&self, k: usize) -> Option<usize> {
        // Offsets come from the file: each is checked, because a damaged one may point anywhere.
        let back = i32::from_le_bytes(read_array(self.bytes, self.at)?);
        let list = usize::try_from(i64::try_from(self.at).ok()? - i64::from(back)).ok()?;
        let entry = 4 + 2 * k;
        // A list from an older schema is shorter. A field beyond its end has its default.
        if entry + 2 > usize::from(u16::from_le_bytes(read_array(self.bytes, list)?)) {
            return None;
        }
        let offset = usize::from(u16::from_le_bytes(read_array(self.bytes, list + entry)?));
        (offset > 0).then_some(self.at + offset)
    }

    pub(super) fn i8(&self, k: usize) -> Option<i8> {
        self.field(k).and_then(|at| Some(i8::from_le_bytes(read_array(self.bytes, at)?)))
    }

    pub(super) fn i16(&self, k: usize) -> Option<i16> {
        self.field(k).and_then(|at| Some(i16::from_le_bytes(read_array(self.bytes, at)?)))
    }

    pub(super) fn i32(&self, k: usize) -> Option<i32> {
        self.field(k).and_then(|at| Some(i32::from_le_bytes(read_array(self.bytes, at)?)))
    }

    pub(super) fn i64(&self, k: usize) -> Option<i64> {
        self.field(k).and_then(|at| Some(i64::from_le_bytes(read_array(self.bytes, at)?)))
    }

    /// The elements, of this size in bytes, of a text or a vector.
    pub(super) fn elements(&self, k: usize, bytes_each: usize) -> Option<&'a [u8]> {
        let field = self.field(k)?;
        let at = field.checked_add(u32_at(self.bytes, field)?)?;
        let first = at.checked_add(4)?;
        self.bytes.get(first..first.checked_add(u32_at(self.bytes, at)?.checked_mul(bytes_each)?)?)
    }
}

fn read_array<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at.checked_add(N)?)?.try_into().ok()
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(read_array(bytes, at)?)).ok()
}
