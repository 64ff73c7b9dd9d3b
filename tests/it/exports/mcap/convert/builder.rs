//! Recordings, record by record, with a writer of the tests' own.

use super::super::recording::crc;
use std::io::Write as _;

/// Bytes after the last record with data: the end of the data, the footer, the magic bytes.
pub(in super::super) const END: usize = (9 + 4) + (9 + 20) + 8;

/// A packet of events, with the fields of its message.
pub(in super::super) struct Packet {
    /// Seconds and nanoseconds.
    pub(in super::super) stamp: (i32, u32),
    /// Columns and rows.
    pub(in super::super) size: [u32; 2],
    pub(in super::super) seq: u64,
    pub(in super::super) time_base: u64,
    pub(in super::super) encoding: &'static str,
    pub(in super::super) is_bigendian: u8,
    pub(in super::super) events: Vec<u8>,
}

impl Default for Packet {
    fn default() -> Self {
        let (encoding, events) = ("evt3", Vec::new());
        Self { stamp: (5, 0), size: [320, 240], seq: 0, time_base: 0, encoding, is_bigendian: 0, events }
    }
}

impl Packet {
    /// The message in little-endian CDR. The frame is `cam`, so that its end is at a multiple of 4.
    pub(in super::super) fn message(&self) -> Vec<u8> {
        let mut body = [self.stamp.0.to_le_bytes(), self.stamp.1.to_le_bytes()].concat();
        body.extend(sized(b"cam\0"));
        let [width, height] = self.size;
        body.extend([height, width].map(u32::to_le_bytes).concat());
        body.resize(body.len().next_multiple_of(8), 0);
        body.extend([self.seq, self.time_base].map(u64::to_le_bytes).concat());
        body.extend(sized(format!("{}\0", self.encoding).as_bytes()));
        body.push(self.is_bigendian);
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend(sized(&self.events));
        [&[0, 1, 0, 0], &body[..]].concat()
    }
}

fn sized(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(opcode: u8, parts: &[&[u8]]) -> Vec<u8> {
    let content = parts.concat();
    [&[opcode], &(content.len() as u64).to_le_bytes()[..], &content].concat()
}

pub(in super::super) fn schema(id: u16, name: &str) -> Vec<u8> {
    let parts = [sized(name.as_bytes()), sized(b"ros2msg"), sized(b"uint8 x")];
    record(3, &[&id.to_le_bytes(), &parts.concat()])
}

pub(in super::super) fn channel(id: u16, schema: u16, topic: &str, encoding: &str) -> Vec<u8> {
    let parts = [sized(topic.as_bytes()), sized(encoding.as_bytes()), sized(&[])];
    record(4, &[&id.to_le_bytes(), &schema.to_le_bytes(), &parts.concat()])
}

pub(in super::super) fn message(channel: u16, data: &[u8]) -> Vec<u8> {
    record(5, &[&channel.to_le_bytes(), &[0; 20], data])
}

pub(in super::super) fn chunk(compression: &str, records: &[Vec<u8>]) -> Vec<u8> {
    let bytes = records.concat();
    let stored = match compression {
        "zstd" => zstd::encode_all(&bytes[..], 0).unwrap(),
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(&bytes).unwrap();
            encoder.finish().unwrap()
        }
        _ => bytes.clone(),
    };
    let head = [&[0; 16][..], &(bytes.len() as u64).to_le_bytes(), &crc(&bytes).to_le_bytes()];
    let length = (stored.len() as u64).to_le_bytes();
    record(6, &[&head.concat(), &sized(compression.as_bytes()), &length, &stored])
}

/// Schema, channel `/e` and messages of packets.
pub(in super::super) fn packets(packets: &[Packet]) -> Vec<Vec<u8>> {
    let mut records = vec![schema(1, "event_camera_msgs/msg/EventPacket"), channel(0, 1, "/e", "cdr")];
    records.extend(packets.iter().map(|packet| message(0, &packet.message())));
    records
}

/// A file with these records.
pub(in super::super) fn complete(records: &[Vec<u8>]) -> Vec<u8> {
    let magic = b"\x89MCAP0\r\n";
    let header = record(1, &[&sized(b"ros2"), &sized(b"tests")]);
    [&magic[..], &header, &records.concat(), &record(0x0f, &[&[0; 4]]), &record(2, &[&[0; 20]]), magic]
        .concat()
}

/// A file with packets in one chunk.
pub(in super::super) fn recording(of: &[Packet]) -> Vec<u8> {
    complete(&[chunk("zstd", &packets(of))])
}
