//! Event streams in recordings of robots: an MCAP file (mcap.dev, "MCAP Format Specification") with messages
//! of ROS 2 in CDR (OMG DDS-RTPS 2.2, 10, and DDS-XTYPES 1.1, 7.4.1), of the type
//! `event_camera_msgs/msg/EventPacket` (GitHub ros-event-camera/event_camera_msgs).
//!
//! | encoding of a packet | content |
//! |---|---|
//! | `evt3` | words of EVT 3.0; one stream over all packets |
//! | `mono` | 8 bytes per event: p in bit 63, y from 48 on, x from 32 on, nanoseconds since `time_base` |
//!
//! A recording is read from its start to its end, so neither an index nor a summary is needed. Messages of
//! other types are passed over without being held in memory.
//!
//! ```
//! use gs2e_event::mcap::{MAGIC, Reader, opcode};
//! use std::io::Cursor;
//!
//! // A record of the end of the data: its kind, its length, and a sum that is not stated.
//! let end = [&[opcode::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0][..], &[0; 4]].concat();
//! let recording = [&MAGIC[..], &end, MAGIC].concat();
//! let refusal = Reader::new(Cursor::new(recording), None).unwrap_err();
//! assert_eq!(refusal.to_string(), "no topic of the type event_camera_msgs/msg/EventPacket");
//! ```

mod message;
mod reader;
mod record;
mod topics;

pub use reader::Reader;

/// The first and the last bytes of a file.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Kinds of records.
pub mod opcode {
    /// Format, program and version.
    pub const HEADER: u8 = 0x01;
    /// Place of the summary.
    pub const FOOTER: u8 = 0x02;
    /// Type of messages.
    pub const SCHEMA: u8 = 0x03;
    /// Topic.
    pub const CHANNEL: u8 = 0x04;
    /// Message.
    pub const MESSAGE: u8 = 0x05;
    /// Compressed records.
    pub const CHUNK: u8 = 0x06;
    /// Places of the messages of a chunk.
    pub const MESSAGE_INDEX: u8 = 0x07;
    /// Place and times of a chunk.
    pub const CHUNK_INDEX: u8 = 0x08;
    /// Counts.
    pub const STATISTICS: u8 = 0x0b;
    /// Named values.
    pub const METADATA: u8 = 0x0c;
    /// Place of named values.
    pub const METADATA_INDEX: u8 = 0x0d;
    /// Place of a group of the summary.
    pub const SUMMARY_OFFSET: u8 = 0x0e;
    /// End of the data.
    pub const DATA_END: u8 = 0x0f;
}

/// Type of the messages of events.
pub const EVENT_PACKET: &str = "event_camera_msgs/msg/EventPacket";

/// Encoding of messages that this program reads and writes.
pub const CDR: &str = "cdr";

/// The bytes before a message in CDR: version 1, little-endian, no options.
pub const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
