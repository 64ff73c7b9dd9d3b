//! A message of events, in CDR: numbers are at multiples of their size after the encapsulation.

use super::ENCAPSULATION;
use gs2e_image::Size;
use std::ops::Range;

/// Coding of the events of a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PacketEncoding {
    Evt3,
    Mono,
}

impl PacketEncoding {
    /// Size of a word, bytes.
    pub(super) fn word(self) -> usize {
        match self {
            Self::Evt3 => crate::evt::packet::WORD,
            Self::Mono => 8,
        }
    }
}

/// The fields of a message.
#[derive(Debug)]
pub(super) struct EventMessage {
    /// Time of its header, ns.
    pub(super) stamp_ns: i64,
    pub(super) size: Size,
    pub(super) seq: u64,
    pub(super) time_base: u64,
    pub(super) encoding: PacketEncoding,
    /// Place of the events in the message.
    pub(super) events: Range<usize>,
}

impl EventMessage {
    /// Reads a message. The error says what was found and what was wanted.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let head = bytes.get(..ENCAPSULATION.len()).ok_or_else(cut)?;
        if head[..2] != ENCAPSULATION[..2] {
            let found: String = head.iter().map(|byte| format!("{byte:02x}")).collect();
            return Err(format!("encapsulation {found}, wanted 00010000, little-endian CDR"));
        }
        let mut fields = CdrFields { body: &bytes[ENCAPSULATION.len()..], at: 0 };
        let seconds = i64::from(i32::from_le_bytes(fields.number()?));
        let nanoseconds = i64::from(u32::from_le_bytes(fields.number()?));
        let _frame = fields.text()?;
        let [height, width] = [fields.number()?, fields.number()?].map(u32::from_le_bytes);
        let [seq, time_base] = [fields.number()?, fields.number()?].map(u64::from_le_bytes);
        let encoding = match fields.text()? {
            b"evt3" => PacketEncoding::Evt3,
            b"mono" => PacketEncoding::Mono,
            other => {
                let name = String::from_utf8_lossy(&other[..other.len().min(32)]).into_owned();
                return Err(format!("events encoded as `{name}`, wanted `evt3` or `mono`"));
            }
        };
        let [is_bigendian] = fields.number()?;
        if is_bigendian != 0 {
            return Err("big-endian events, wanted little-endian ones".to_owned());
        }
        let count = u32::from_le_bytes(fields.number()?) as usize;
        let first = ENCAPSULATION.len() + fields.at;
        let found = bytes.len() - first;
        // Writers fill a message up to a multiple of 4.
        if count > found || found - count > 3 {
            return Err(format!("{count} bytes of events, and the message has {found}"));
        }
        if !count.is_multiple_of(encoding.word()) {
            return Err(format!("{count} bytes of events, wanted a multiple of {}", encoding.word()));
        }
        Ok(Self {
            // Seconds have 32 bits, so the product fits in 64.
            stamp_ns: seconds * 1_000_000_000 + nanoseconds,
            size: Size { width, height },
            seq,
            time_base,
            encoding,
            events: first..first + count,
        })
    }
}

/// Fields of a message, one after the other.
struct CdrFields<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> CdrFields<'a> {
    /// A number of `N` bytes.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(N);
        self.bytes(N).and_then(|bytes| bytes.try_into().map_err(|_| cut()))
    }

    /// A text without the zero at its end.
    fn text(&mut self) -> Result<&'a [u8], String> {
        let length = u32::from_le_bytes(self.number()?) as usize;
        let bytes = self.bytes(length)?;
        Ok(bytes.strip_suffix(&[0]).unwrap_or(bytes))
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).ok_or_else(cut)?;
        let bytes = self.body.get(self.at..end).ok_or_else(cut)?;
        self.at = end;
        Ok(bytes)
    }
}

fn cut() -> String {
    "the message ends within its fields".to_owned()
}
