//! Every event codec: what is written is read back, byte for byte the same each time, and damage is named.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

use gs2e::event::{Event, EventFileError, EventSink, EventSource, Header, LawStamp, Polarity, h5};
use gs2e::image::Size;
use gs2e::units::Timestamp;
use std::path::Path;

const SIZE: Size = Size { width: 640, height: 360 };
const HEADER: Header = Header { size: SIZE, law: Some(LawStamp { version: 3, c_on: 0.19, c_off: 0.21 }) };

/// A sorted stream with gaps of several milliseconds, runs within one microsecond, and sub-microsecond times.
fn stream(count: u64) -> Vec<Event> {
    let event = |i: u64| {
        let h = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let jump = (i / 1000) * 3_700_000 + i / 3 * 1_300;
        Event {
            t: Timestamp(i64::try_from(jump + h % 900).unwrap()),
            x: u16::try_from((h >> 20) % 640).unwrap(),
            y: u16::try_from((h >> 40) % 360).unwrap(),
            polarity: if h >> 63 == 1 { Polarity::On } else { Polarity::Off },
        }
    };
    let mut events: Vec<Event> = (0..count).map(event).collect();
    events.sort_by_key(Event::file_order);
    events
}

/// What files keep of an event.
fn kept(events: &[Event]) -> Vec<(i64, u16, u16, Polarity)> {
    events.iter().map(Event::file_order).collect()
}

fn write_h5(path: &Path, events: &[Event], piece: usize, last_stamp_us: i64) {
    let mut writer = h5::Writer::create(path, &HEADER).unwrap();
    for part in events.chunks(piece) {
        writer.append(part).unwrap();
    }
    assert_eq!(writer.finish(last_stamp_us).unwrap(), events.len() as u64);
}

fn read_all(source: &mut dyn EventSource) -> Result<Vec<Event>, EventFileError> {
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while source.next_chunk(&mut chunk)? {
        all.extend_from_slice(&chunk);
    }
    assert!(chunk.is_empty());
    Ok(all)
}

#[test]
fn hdf5_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("events.h5");
    for count in [0, 1, 2, 65_535, 65_536, 65_537, 200_000] {
        let events = stream(count);
        write_h5(&path, &events, 10_007, 62_083);
        let mut reader = h5::Reader::open(&path).unwrap();
        assert_eq!((reader.count(), reader.header()), (count, Some(HEADER)));
        reader.verify_index().unwrap();
        assert_eq!(kept(&read_all(&mut reader).unwrap()), kept(&events), "{count} events");
    }
}
