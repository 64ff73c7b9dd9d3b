//! Event streams as iniVation's AEDAT 4.0: a version line, a header, packets of events
//! (docs.inivation.com, "AEDAT 4.0 file format"; schemas `IOHeader`, `EventPacket` of
//! dv-processing).
//!
//! Header and packets are `FlatBuffers` with a few fields, which are laid out here directly;
//! packets are compressed separately. LZ4 frames are written; plain and Zstandard packets can be
//! read too. Packets of other streams than the first stream of events are skipped; [`FrameReader`]
//! reads those of the first stream of frames.
//!
//! # Examples
//! ```
//! use gs2e_event::aedat4::{Reader, Writer};
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//!
//! let mut text = text::Reader::new("# t x y p in us; sensor 4x3\n5 0 1 1\n".as_bytes(), None, None)?;
//! let (mut written, mut read, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
//! text.next_chunk(&mut written)?;
//! let mut writer = Writer::new(&mut bytes, text.header().size)?;
//! writer.append(&written)?;
//! writer.finish()?;
//! Reader::new(&bytes[..])?.next_chunk(&mut read)?;
//! assert_eq!(read, written);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod buffer;
mod frames;
mod inflate;
mod info;
mod packets;
mod reader;
mod writer;

pub use frames::{CameraFrame, FramePixels, FrameReader};
pub use reader::Reader;
pub use writer::Writer;

/// The first line.
const VERSION: &[u8; 14] = b"#!AER-DAT4.0\r\n";

/// Identifiers of the kinds of buffer.
const HEADER: &[u8; 4] = b"IOHE";
/// See [`HEADER`].
const EVENTS: &[u8; 4] = b"EVTS";
/// See [`HEADER`].
const FRAMES: &[u8; 4] = b"FRME";

/// Size of an event, bytes: time (i64, us), column, row (i16), polarity (u8), 3 bytes of padding.
const EVENT: usize = 16;

/// Columns and rows are signed 16-bit numbers.
const EDGE: u32 = 1 << 15;

/// Compression of packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PacketCompression {
    None,
    Lz4,
    Zstd,
}

impl PacketCompression {
    /// From the number in a header: two levels of each method count as one.
    fn from_number(number: i32) -> Option<Self> {
        match number {
            0 => Some(Self::None),
            1 | 2 => Some(Self::Lz4),
            3 | 4 => Some(Self::Zstd),
            _ => None,
        }
    }
}
