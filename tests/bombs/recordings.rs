//! Recordings of ROS 2.

use crate::scenes::repeat;
use crate::{Bomb, Fate, Place};
use std::io::Write as _;

pub(crate) const BOMBS: &[Bomb] = &[
    Bomb {
        name: "mcap-zstd",
        what: "a packet of events that inflates to 400 MB",
        args: "convert in.mcap out.h5",
        fate: Fate::Refused,
        make: |place| recording(place, 0, 400_000_000, None),
    },
    Bomb {
        name: "mcap-picture",
        what: "a picture that inflates to 400 MB, then a packet of events that ends early",
        args: "convert in.mcap out.h5",
        fate: Fate::Refused,
        make: |place| recording(place, 1, 400_000_000, None),
    },
    Bomb {
        name: "mcap-length",
        what: "a packet of 2^60 bytes, and no data",
        args: "convert in.mcap out.h5",
        fate: Fate::Refused,
        make: |place| recording(place, 0, 0, Some(1 << 60)),
    },
];

/// A list, or a text, by its bytes.
fn sized(bytes: &[u8]) -> Vec<u8> {
    [&u32::try_from(bytes.len()).unwrap().to_le_bytes(), bytes].concat()
}

/// The kind and the length of a record.
fn head(opcode: u8, length: u64) -> Vec<u8> {
    [&[opcode][..], &length.to_le_bytes()].concat()
}

fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&head(opcode, content.len() as u64), content].concat()
}

/// Writes a recording with the topics 0 (events) and 1 (pictures): a message of `topic` with `count` zeros,
/// which claims `length` bytes if that is said, then a message of events without content.
fn recording(place: &Place, topic: u16, count: usize, length: Option<u64>) {
    let types = ["event_camera_msgs/msg/EventPacket", "sensor_msgs/msg/Image"];
    let mut chunk = zstd::Encoder::new(Vec::new(), 3).unwrap();
    for (id, name) in (0_u16..).zip(types) {
        let schema = (id + 1).to_le_bytes();
        let fields = [&schema[..], &sized(name.as_bytes()), &sized(b"ros2msg"), &sized(b"")].concat();
        chunk.write_all(&record(3, &fields)).unwrap();
        let ids = [id.to_le_bytes(), schema].concat();
        let topic = sized(format!("/{id}").as_bytes());
        chunk.write_all(&record(4, &[&ids[..], &topic, &sized(b"cdr"), &sized(b"")].concat())).unwrap();
    }
    chunk.write_all(&head(5, length.unwrap_or(22 + count as u64))).unwrap();
    chunk.write_all(&[&topic.to_le_bytes()[..], &[0; 20]].concat()).unwrap();
    repeat(&mut chunk, 0, count);
    chunk.write_all(&record(5, &[0; 22])).unwrap();
    let stored = chunk.finish().unwrap();
    // Two times, a length that is not held against anything, no sum.
    let fields = [&[0; 16][..], &u64::MAX.to_le_bytes(), &[0; 4], &sized(b"zstd")].concat();
    let fields = [&fields[..], &(stored.len() as u64).to_le_bytes(), &stored].concat();
    let magic = b"\x89MCAP0\r\n";
    let end = [record(0x0f, &[0; 4]), record(2, &[0; 20])].concat();
    place.write("in.mcap", [&magic[..], &record(1, &[0; 8]), &record(6, &fields), &end, magic].concat());
}
