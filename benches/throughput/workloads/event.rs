//! Writing event files, into the system's temporary folder.

use super::amount;
use crate::measure::{Workload, timed};
use gs2e_event::h5::ChunkFilter;
use gs2e_event::{Event, EventLabel, EventSink as _, Polarity, StreamHeader, h5, npz};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::path::Path;
use std::sync::Arc;

const SIZE: Size = Size { width: 640, height: 480 };
const EVENTS: u32 = 1_000_000;

type Write = fn(&Path, &[Event]);

pub(super) fn workloads() -> Vec<Workload> {
    let events: Arc<[Event]> = stream().into();
    let formats: [(&str, Write); 6] = [
        ("events.h5, gzip 4 + shuffle", |path, events| write_h5(path, events, ChunkFilter::Gzip(4))),
        ("events.h5, gzip 1 + shuffle", |path, events| write_h5(path, events, ChunkFilter::Gzip(1))),
        ("events.h5, zstd 3 + shuffle", |path, events| write_h5(path, events, ChunkFilter::Zstd(3))),
        ("events.h5, lz4 + shuffle", |path, events| write_h5(path, events, ChunkFilter::Lz4)),
        ("events.h5, no filter", |path, events| write_h5(path, events, ChunkFilter::None)),
        ("events.npz", write_npz),
    ];
    formats.map(|(name, write)| workload(name, write, &events)).into()
}

fn workload(name: &str, write: Write, events: &Arc<[Event]>) -> Workload {
    let events = Arc::clone(events);
    let what = format!("write {name}: {EVENTS} events of {SIZE} over one second");
    let run = move || {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        timed(|| {
            write(&folder.path().join("events"), &events);
            vec![amount(events.len(), "Mevent")]
        })
    };
    Workload { part: "event", what, rival: false, run: Box::new(run) }
}

fn write_h5(path: &Path, events: &[Event], filter: ChunkFilter) {
    let options = h5::H5Options { filter, t_offset_us: 0 };
    let header = StreamHeader { size: SIZE, law: None, labelled: false };
    let mut writer = h5::Writer::create_as(path, &header, options).expect("it can be created");
    events.chunks(1 << 16).for_each(|chunk| writer.append(chunk).expect("it can be written"));
    writer.finish(1_000_000).expect("it can be written");
}

fn write_npz(path: &Path, events: &[Event]) {
    let header = StreamHeader { size: SIZE, law: None, labelled: false };
    let mut writer = npz::Writer::create(path, &header).expect("it can be created");
    events.chunks(1 << 16).for_each(|chunk| writer.append(chunk).expect("it can be written"));
    writer.finish().expect("it can be written");
}

/// Events at times and places without a pattern (a multiplicative hash), one per microsecond and
/// therefore sorted. A compressor can take advantage of nothing but the times.
fn stream() -> Vec<Event> {
    let event = |i: u32| {
        let hash = i.wrapping_mul(2_654_435_769) >> 8;
        let (x, y) = (hash % SIZE.width, hash / SIZE.width % SIZE.height);
        Event {
            t: Timestamp::from_micros(i64::from(i)),
            x: u16::try_from(x).expect("a column"),
            y: u16::try_from(y).expect("a row"),
            polarity: if hash & 1 == 0 { Polarity::Off } else { Polarity::On },
            label: EventLabel::Signal,
        }
    };
    (0..EVENTS).map(event).collect()
}
