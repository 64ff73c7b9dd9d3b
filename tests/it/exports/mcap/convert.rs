//! Recordings by anyone: forms, topics, encodings, damage, and lengths that lie.

pub(super) mod builder;

use super::all_events;
use crate::convert_events::words16;
use crate::release::small::{gs2e, said};
use builder::{Packet, channel, chunk, complete, message, packets, recording, schema};
use gs2e_event::mcap::Reader;
use gs2e_event::{EventFileError, EventSource as _};
use std::path::Path;

/// Words of two events at 5,000 us in row 7: ON at column 3, OFF at column 9.
const WORDS: [u16; 5] = [0x8001, 0x6388, 0x0007, 0x2803, 0x2009];

fn packet() -> Packet {
    Packet { events: words16(&WORDS), ..Packet::default() }
}

/// Reads a recording to its end, and returns the number of events.
fn read(path: &Path) -> Result<usize, EventFileError> {
    let mut reader = Reader::open(path, None)?;
    let (mut count, mut chunk) = (0, Vec::new());
    while reader.next_chunk(&mut chunk)? {
        count += chunk.len();
    }
    Ok(count)
}

/// Converts bytes to text. Returns the exit code, the messages and the lines of events.
fn convert(bytes: &[u8], options: &[&str]) -> (Option<i32>, String, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("in.mcap"), bytes).unwrap();
    let output = gs2e(folder.path(), &[&["convert", "in.mcap", "out.txt"], options].concat());
    let text = std::fs::read_to_string(folder.path().join("out.txt")).unwrap_or_default();
    let lines = text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect();
    (output.status.code(), said(&output), lines)
}

/// Checks that bytes are refused with these words, and that nothing is written.
fn refused(bytes: &[u8], wanted: &str) {
    let (code, said, lines) = convert(bytes, &[]);
    assert!(code == Some(1) && lines.is_empty(), "wanted `{wanted}`: {said}");
    // The lines of a message are as long as the terminal is wide.
    let joined = said.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ");
    assert!(joined.contains(wanted), "wanted `{wanted}`: {said}");
}

#[test]
fn every_form_of_chunks_is_read() {
    let inner = packets(&[packet()]);
    for compression in ["", "zstd", "lz4"] {
        let bytes = complete(&[chunk(compression, &inner)]);
        let (code, said, lines) = convert(&bytes, &[]);
        assert_eq!(
            (code, lines),
            (Some(0), vec!["5000 3 7 1".to_owned(), "5000 9 7 0".to_owned()]),
            "{said}"
        );
    }
    // Without chunks, and with schemas and channels in another chunk than the messages.
    let split = [chunk("zstd", &inner[..2]), chunk("zstd", &inner[2..])];
    for bytes in [complete(&inner), complete(&split)] {
        assert_eq!(convert(&bytes, &[]).2.len(), 2);
    }
}

#[test]
fn mono_has_times_of_ros() {
    // 8 bytes: p in bit 63, y from bit 48, x from bit 32, nanoseconds from `time_base` on.
    let event = |p: u64, y: u64, x: u64, ns: u64| (p << 63 | y << 48 | x << 32 | ns).to_le_bytes();
    let events = [event(1, 239, 319, 0), event(0, 0, 0, 4_000_000_000)].concat();
    let mono = |events: &[u8], time_base: u64| {
        let events = events.to_vec();
        recording(&[Packet { encoding: "mono", events, time_base, ..Packet::default() }])
    };
    let (code, said, lines) = convert(&mono(&events, 1_700_000_000_000_000_000), &[]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(lines, ["1700000000000000 319 239 1", "1700000004000000 0 0 0"]);
    refused(
        &mono(&event(0, 240, 0, 0), 0),
        "packet 0, byte 0: pixel (0, 240) is outside the sensor of 320x240",
    );
    refused(&mono(&events, u64::MAX), "wanted less than 2^63");
    let (code, said, _) = convert(&mono(&event(0, 0, 0, 1), 0), &[]);
    assert!(code == Some(2) && said.contains("truncated to the microsecond"), "{said}");
}

#[test]
fn a_topic_is_chosen_by_name() {
    let other = Packet { events: words16(&[0x8000, 0x6000, 0x0000, 0x2001]), ..Packet::default() };
    let bytes = complete(&[
        schema(1, "event_camera_msgs/msg/EventPacket"),
        schema(2, "sensor_msgs/msg/Image"),
        channel(0, 2, "/image", "cdr"),
        channel(1, 1, "/left", "cdr"),
        channel(2, 1, "/right", "cdr"),
        channel(3, 0, "/free", "json"),
        message(0, b"a picture"),
        message(1, &packet().message()),
        message(2, &other.message()),
        message(3, b"{}"),
    ]);
    refused(&bytes, "events on the topics `/left`, `/right`: choose one with --topic");
    assert_eq!(convert(&bytes, &["--topic", "/left"]).2, ["5000 3 7 1", "5000 9 7 0"]);
    assert_eq!(convert(&bytes, &["--topic", "/right"]).2, ["0 1 0 0"]);
    let (code, said, _) = convert(&bytes, &["--topic", "/image"]);
    assert!(code == Some(1) && said.contains("no events on the topic `/image`"), "{said}");
}

#[test]
fn other_contents_are_named() {
    let one = |packet: Packet| recording(&[packet]);
    let events = |list: &[u16]| one(Packet { events: words16(list), ..Packet::default() });
    refused(
        &one(Packet { encoding: "libcaer", ..packet() }),
        "events encoded as `libcaer`, wanted `evt3` or `mono`",
    );
    refused(&one(Packet { is_bigendian: 1, ..packet() }), "big-endian events");
    refused(&one(Packet { size: [0, 240], ..packet() }), "a sensor of 0x240");
    refused(&one(Packet { size: [70_000, 70_000], ..packet() }), "65536 columns and rows");
    refused(&one(Packet { events: vec![0; 3], ..packet() }), "3 bytes of events, wanted a multiple of 2");
    refused(&events(&[0x8000, 0x6000, 0x0000, 0x2140]), "packet 0, byte 6: pixel (320, 0) is outside");
    refused(&events(&[0x8000, 0x9000]), "packet 0, byte 2: a word of kind 0x9");
    let sizes = recording(&[packet(), Packet { size: [640, 480], seq: 1, ..packet() }]);
    refused(&sizes, "packet 1 has 640x480 pixels");
    let mut cdr = packet().message();
    cdr[1] = 0;
    let of = |message_bytes: &[u8], kind: &str, encoding: &str| {
        complete(&[schema(1, kind), channel(0, 1, "/e", encoding), message(0, message_bytes)])
    };
    let packet_type = "event_camera_msgs/msg/EventPacket";
    refused(&of(&cdr, packet_type, "cdr"), "encapsulation 00000000, wanted 00010000");
    refused(&of(&cdr, packet_type, "protobuf"), "encoded as `protobuf`, wanted `cdr`");
    refused(&of(&cdr, "event_camera_msgs/EventPacket", "ros1"), "encoded as `ros1`, wanted `cdr`");
    refused(
        &of(&cdr, "dvs_msgs/msg/EventArray", "cdr"),
        "no topic of the type event_camera_msgs/msg/EventPacket",
    );
    refused(&complete(&[channel(0, 9, "/e", "cdr")]), "channel 0 has the schema 9, which is absent");
    refused(&complete(&packets(&[])), "`/e` has no message");
    let inner = packets(&[packet()]);
    refused(&complete(&[chunk("brotli", &inner)]), "compressed by `brotli`, wanted zstd, lz4 or nothing");
    refused(&complete(&[chunk("", &[chunk("", &inner)])]), "a chunk holds a record of kind 0x06");
    refused(b"#ROSBAG V2.0\n", "it does not begin as an MCAP file");
}

/// Events without a time or a row are dropped by name.
#[test]
fn events_without_a_time_need_a_permission() {
    let bytes =
        recording(&[Packet { events: words16(&[0x2801, 0x8000, 0x2802, 0x0001, 0x2803]), ..packet() }]);
    let (code, said, _) = convert(&bytes, &[]);
    assert!(code == Some(2) && said.contains("events: 2 "), "{said}");
    assert_eq!(convert(&bytes, &["--lossy"]).2, ["0 3 1 1"]);
}

/// A recording that is cut anywhere is refused, and says so.
#[test]
fn cut_recordings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    let whole = complete(&[chunk("zstd", &packets(&[packet()])), chunk("", &packets(&[packet()]))]);
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = read(&path).expect_err(&format!("{length} of {} bytes", whole.len())).to_string();
        let wanted = if length < 8 { "does not begin" } else { "truncated" };
        assert!(error.contains(wanted), "{length}: {error}");
        // The same with the right ending, as of a file whose middle was lost.
        let ended = [&whole[..length], b"\x89MCAP0\r\n"].concat();
        std::fs::write(&path, ended).unwrap();
        if length < whole.len() - builder::END {
            read(&path).expect_err(&format!("{length} bytes and an ending"));
        }
    }
    std::fs::write(&path, &whole).unwrap();
    assert_eq!(read(&path).unwrap(), 4);
    assert_eq!(all_events(&path).len(), 4);
}

/// A bit that flips in the data of a chunk is found by its sum; elsewhere it does no harm.
#[test]
fn damaged_recordings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mcap");
    let inner = packets(&[packet()]);
    let whole = complete(&[chunk("", &inner)]);
    let stored: usize = inner.iter().map(Vec::len).sum();
    let end = whole.len() - builder::END;
    for at in 8..whole.len() - 8 {
        for bit in 0..8 {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            std::fs::write(&path, &bytes).unwrap();
            let found = read(&path);
            if (end - stored..end).contains(&at) {
                found.expect_err(&format!("byte {at}, bit {bit}"));
            }
        }
    }
}

/// Lengths that lie: each is refused for what it claims, long before that is allocated.
#[test]
fn lengths_that_lie_are_refused() {
    let changed = |mut bytes: Vec<u8>, at: usize, value: &[u8]| {
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    let huge = (1_u64 << 62).to_le_bytes();
    let inner = packets(&[packet()]);
    // A record: kind, then its length.
    refused(
        &complete(&[changed(schema(1, "a"), 1, &huge)]),
        "a record of 4611686018427387904 bytes, and the file has",
    );
    refused(&complete(&[changed(schema(1, "a"), 11, &[0xff; 4])]), "a name of 4294967295 bytes");
    refused(&complete(&[changed(schema(1, "a"), 11, &[0, 1, 0, 0])]), "ends within its fields");
    // A chunk: kind, length, two times, its length without compression, the sum, and a text.
    let of = |compression, at, value: &[u8]| complete(&[changed(chunk(compression, &inner), at, value)]);
    refused(&of("zstd", 25, &huge), "the chunk ends");
    refused(&of("", 25, &[1, 0, 0, 0]), "a chunk ends within a record");
    refused(&of("zstd", 33, &[1]), "a chunk with the sum");
    refused(&of("zstd", 45, &huge), "a chunk of 4611686018427387904 bytes in a record with room for");
    refused(&of("lz4", 52, &[0xff; 4]), "the chunk:");
    // A record in a chunk.
    let bad = changed(inner[2].clone(), 1, &huge);
    refused(
        &complete(&[chunk("zstd", &[inner[0].clone(), inner[1].clone(), bad])]),
        "in a chunk, and the chunk has",
    );
    // Fields of a message: the text of the header, and the number of bytes of events.
    let of = |at, value: &[u8]| {
        let message_bytes = changed(packet().message(), at, value);
        complete(&[inner[0].clone(), inner[1].clone(), message(0, &message_bytes)])
    };
    refused(&of(12, &[0xff; 4]), "the message ends within its fields");
    let count = packet().message().len() - 2 * WORDS.len() - 4;
    refused(&of(count, &[0xfe, 0xff, 0xff, 0xff]), "4294967294 bytes of events, and the message has 10");
    refused(&of(count, &[2, 0, 0, 0]), "2 bytes of events, and the message has 10");
    // A message that zeros of a few bytes stand for.
    let zeros = vec![0; 20 << 20];
    let bomb = chunk("zstd", &[inner[0].clone(), inner[1].clone(), message(0, &zeros)]);
    assert!(bomb.len() < 20_000);
    refused(&complete(&[bomb]), "a message of 20971520 bytes, wanted at most 16777216");
}

#[test]
fn a_recording_is_read_only() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("in.txt"), "# sensor 4x4\n0 1 1 1\n").unwrap();
    let output = gs2e(folder.path(), &["convert", "in.txt", "out.mcap"]);
    assert!(
        output.status.code() == Some(2) && said(&output).contains("export --to mcap"),
        "{}",
        said(&output)
    );
    let bytes = recording(&[packet()]);
    std::fs::write(folder.path().join("in.mcap"), bytes).unwrap();
    let output = gs2e(folder.path(), &["info", "in.mcap"]);
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(shown.contains("320x240") && shown.contains('2'), "{shown}{}", said(&output));
}
