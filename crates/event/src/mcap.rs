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

mod message;
mod reader;
mod record;
mod topics;

pub use reader::Reader;

/// The first and the last bytes of a file.
pub(crate) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Kinds of records.
pub(crate) mod opcode {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const STATISTICS: u8 = 0x0b;
    pub(crate) const METADATA: u8 = 0x0c;
    pub(crate) const METADATA_INDEX: u8 = 0x0d;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(crate) const DATA_END: u8 = 0x0f;
}

/// Type of the messages of events.
pub(crate) const EVENT_PACKET: &str = "event_camera_msgs/msg/EventPacket";

/// Encoding of messages that this program reads and writes.
pub(crate) const CDR: &str = "cdr";

/// The bytes before a message in CDR: version 1, little-endian, no options.
pub(crate) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
