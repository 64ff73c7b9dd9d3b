//! Every event codec: written streams are read back, equal streams give equal bytes, and damage is
//! reported by name.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod hdf5;
mod labels;

use gs2e_event::evt::EvtVersion;
use gs2e_event::file::{EventFormat, ReadHints};
use gs2e_event::text::ColumnSeparator;
use gs2e_event::{
    Event, EventFileError, EventLabel, EventSink, EventSource, LawStamp, Polarity, StreamHeader, file, h5,
    npz,
};
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use gs2e_testing::absent::absent;
use std::io::{Cursor, Write as _};
use std::path::Path;

const SIZE: Size = Size { width: 640, height: 360 };
const LAW: LawStamp = LawStamp { version: 3, c_on: 0.19, c_off: 0.21 };
const HEADER: StreamHeader = StreamHeader { size: SIZE, law: Some(LAW), labelled: false };

const LAST_STAMP_US: i64 = 62_083;

/// A sorted stream with gaps of several milliseconds, runs within one microsecond, and
/// sub-microsecond times.
fn stream(count: u64) -> Vec<Event> {
    let event = |i: u64| {
        let h = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let jump = (i / 1000) * 3_700_000 + i / 3 * 1_300;
        Event {
            t: Timestamp(i64::try_from(jump + h % 900).unwrap()),
            x: u16::try_from((h >> 20) % 640).unwrap(),
            y: u16::try_from((h >> 40) % 360).unwrap(),
            polarity: if h >> 63 == 1 { Polarity::On } else { Polarity::Off },
            label: if h >> 62 & 1 == 1 { EventLabel::Signal } else { EventLabel::Noise },
        }
    };
    let mut events: Vec<Event> = (0..count).map(event).collect();
    events.sort_by_key(Event::file_order);
    events
}

/// The fields of an event that files keep.
fn kept(events: &[Event]) -> Vec<(i64, u16, u16, Polarity)> {
    events.iter().map(Event::file_order).collect()
}

/// One codec, as its contract describes it.
struct Codec {
    /// Name of the codec's file.
    name: &'static str,
    format: EventFormat,
    /// True if a file states its length, so that a truncated file is always detected.
    counted: bool,
}

const CODECS: [Codec; 7] = [
    Codec { name: "h5", format: EventFormat::H5, counted: true },
    Codec { name: "npz", format: EventFormat::Npz, counted: true },
    Codec { name: "evt2.raw", format: EventFormat::Evt(EvtVersion::Evt2), counted: false },
    Codec { name: "evt3.raw", format: EventFormat::Evt(EvtVersion::Evt3), counted: false },
    Codec { name: "aedat4", format: EventFormat::Aedat4, counted: false },
    Codec { name: "txt", format: EventFormat::Text(ColumnSeparator::Txt), counted: false },
    Codec { name: "csv", format: EventFormat::Text(ColumnSeparator::Csv), counted: false },
];

impl Codec {
    fn write(&self, path: &Path, events: &[Event], piece: usize) {
        let mut writer = file::create(path, self.format, &HEADER, file::WriteOptions::default()).unwrap();
        append_all(&mut *writer, events, piece);
        assert_eq!(writer.finish(LAST_STAMP_US).unwrap(), events.len() as u64);
    }

    fn read(&self, path: &Path) -> Result<Vec<Event>, EventFileError> {
        match self.format {
            EventFormat::H5 => read_h5(path),
            EventFormat::Npz => read_npz(path),
            format => {
                let mut opened = file::open(path, format, ReadHints::default())?;
                assert_eq!(opened.header, StreamHeader { size: SIZE, law: None, labelled: false });
                let events = read_all(&mut *opened.source)?;
                assert_eq!(opened.source.untimed(), 0);
                Ok(events)
            }
        }
    }
}

fn append_all(sink: &mut dyn EventSink, events: &[Event], piece: usize) {
    events.chunks(piece).for_each(|part| sink.append(part).unwrap());
}

fn read_h5(path: &Path) -> Result<Vec<Event>, EventFileError> {
    let mut reader = h5::Reader::open(path)?;
    reader.verify_index()?;
    let events = read_all(&mut reader)?;
    assert_eq!(reader.count(), events.len() as u64);
    Ok(events)
}

fn read_npz(path: &Path) -> Result<Vec<Event>, EventFileError> {
    let mut reader = npz::Reader::open(path)?;
    let events = read_all(&mut reader)?;
    assert_eq!(reader.count(), events.len() as u64);
    Ok(events)
}

fn read_all(source: &mut dyn EventSource) -> Result<Vec<Event>, EventFileError> {
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while source.next_chunk(&mut chunk)? {
        assert!(!chunk.is_empty());
        all.extend_from_slice(&chunk);
    }
    assert!(chunk.is_empty());
    Ok(all)
}

/// Runs `check` with each codec and a path of its own in a fresh folder.
fn each_codec(check: impl Fn(&Codec, &Path)) {
    for codec in &CODECS {
        let dir = tempfile::tempdir().unwrap();
        check(codec, &dir.path().join(format!("events.{}", codec.name)));
        let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().ends_with(".part")), "{left:?}");
    }
}

#[test]
fn written_events_are_read_back() {
    each_codec(|codec, path| {
        for count in [0, 1, 2, 65_535, 65_536, 65_537, 200_000] {
            let events = stream(count);
            codec.write(path, &events, 10_007);
            assert_eq!(kept(&codec.read(path).unwrap()), kept(&events), "{}, {count} events", codec.name);
        }
    });
}

#[test]
fn equal_streams_are_equal_bytes_for_any_chunks_and_threads() {
    let events = stream(150_000);
    each_codec(|codec, path| {
        codec.write(path, &events, 150_000);
        let first = std::fs::read(path).unwrap();
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        one_thread.install(|| codec.write(path, &events, 777));
        assert!(first == std::fs::read(path).unwrap(), "{}", codec.name);
    });
}

/// The bytes on disk are frozen. Any change of a codec, a compressor or rust-hdf5 raises the
/// revision of the stages that write the files. Then these digests (BLAKE3, the first 64 bits) are
/// taken again.
#[test]
fn formats_on_disk_are_frozen() {
    let frozen = [
        ("h5", ["3da62e039c0036fc", "f862322e564e1604"]),
        ("npz", ["de857fbd3b153085", "e24ab4f71829a6d9"]),
        ("evt2.raw", ["0c47a97e4bb3b720", "dc8333a03b7ac4a8"]),
        ("evt3.raw", ["b999eb4686e1b1af", "9c445ab51c619c01"]),
        ("aedat4", ["2166394e8d4557c6", "92acf4e283d67757"]),
        ("txt", ["caba4718d9d139b6", "8e929b582a6c95fc"]),
        ("csv", ["376ea28cbaf5ab55", "8cadb5b882253383"]),
    ];
    let dir = tempfile::tempdir().unwrap();
    let found = CODECS.each_ref().map(|codec| {
        let digest = |count| {
            let path = dir.path().join(codec.name);
            codec.write(&path, &stream(count), 10_000);
            blake3::hash(&std::fs::read(path).unwrap()).to_hex()[..16].to_owned()
        };
        (codec.name, [digest(0), digest(70_000)])
    });
    assert_eq!(found, frozen.map(|(name, digests)| (name, digests.map(str::to_owned))));
}

/// Independent readers: h5py and NumPy, compared with the stream itself as text.
const FOREIGN_READER: &str = r"
import sys, h5py, numpy as np
h5, npz, truth, end_us = sys.argv[1], sys.argv[2], np.loadtxt(sys.argv[3], dtype=np.int64, ndmin=2), int(sys.argv[4])
file, archive = h5py.File(h5), np.load(npz)
kinds = dict(t=(np.uint32, np.int64), x=(np.uint16,) * 2, y=(np.uint16,) * 2, p=(np.uint8,) * 2)
for column, name in enumerate('txyp'):
    dataset, array = file['events'][name], archive[name]
    assert (dataset.dtype, array.dtype) == kinds[name], name
    assert (dataset.compression, dataset.compression_opts, dataset.shuffle) == ('gzip', 4, True), name
    assert dataset.chunks == (65536,), name
    assert np.array_equal(dataset[:], truth[:, column]) and np.array_equal(array, truth[:, column]), name
index = file['ms_to_idx'][:]
assert index.dtype == np.uint64 and file['t_offset'].dtype == np.int64 and file['t_offset'][()] == 0
assert len(index) == max(end_us, truth[-1, 0]) // 1000 + 2
assert np.array_equal(index, np.searchsorted(truth[:, 0], np.arange(len(index)) * 1000, 'left'))
head = {name: file.attrs[name] for name in file.attrs}
assert head == dict(width=640, height=360, law_version=3, c_on=0.19, c_off=0.21), head
";

#[test]
fn foreign_readers_read_the_same() {
    let python = |args: &[&str]| std::process::Command::new("python3").args(args).output();
    if !python(&["-c", "import h5py, numpy"]).is_ok_and(|tried| tried.status.success()) {
        return absent("REQUIRE_READERS", "python3 with h5py and numpy is absent");
    }
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let events = stream(70_000);
    CODECS[0].write(&path("e.h5"), &events, 70_000);
    CODECS[1].write(&path("e.npz"), &events, 70_000);
    let line = |(t, y, x, p): (i64, u16, u16, Polarity)| format!("{t} {x} {y} {}\n", p as u8);
    std::fs::write(path("truth.txt"), kept(&events).into_iter().map(line).collect::<String>()).unwrap();
    let files = ["e.h5", "e.npz", "truth.txt"].map(|name| path(name).to_str().unwrap().to_owned());
    let said =
        python(&["-c", FOREIGN_READER, &files[0], &files[1], &files[2], &LAST_STAMP_US.to_string()]).unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
}

#[test]
fn a_file_cut_short_is_refused() {
    let events = stream(3_000);
    each_codec(|codec, path| {
        if !codec.counted {
            return;
        }
        codec.write(path, &events, 3_000);
        let whole = std::fs::read(path).unwrap();
        for cut in (0..whole.len()).step_by(97) {
            std::fs::write(path, &whole[..cut]).unwrap();
            assert!(codec.read(path).is_err(), "{}, {cut} of {} bytes", codec.name, whole.len());
        }
    });
}

#[test]
fn a_file_with_a_byte_changed_is_an_error_or_other_events_but_never_a_crash() {
    let events = stream(3_000);
    each_codec(|codec, path| {
        codec.write(path, &events, 3_000);
        let whole = std::fs::read(path).unwrap();
        for at in (0..whole.len()).step_by(61) {
            let mut changed = whole.clone();
            changed[at] ^= 0xa5;
            std::fs::write(path, &changed).unwrap();
            let _ = codec.read(path);
        }
    });
}

#[test]
fn an_invalid_stream_is_not_written() {
    let later = Event { t: Timestamp(5_000), x: 0, y: 0, polarity: Polarity::On, label: EventLabel::Signal };
    let earlier = Event { t: Timestamp(4_999), ..later };
    let outside = Event { t: Timestamp(6_000), x: 640, ..later };
    let dir = tempfile::tempdir().unwrap();
    for (bad, because) in [(earlier, "event 1:"), (outside, "event 1: pixel (640, 0) is outside")] {
        let refused = |sink: &mut dyn EventSink| {
            let error = sink.append(&[later, bad]).unwrap_err().to_string();
            assert!(error.contains(because), "{error}");
        };
        refused(&mut h5::Writer::create(&dir.path().join("e.h5"), &HEADER).unwrap());
        refused(&mut npz::Writer::create(&dir.path().join("e.npz"), &HEADER).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "an unfinished writer leaves nothing");
    }
}

#[test]
fn the_head_of_an_hdf5_file_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.h5");
    for header in [HEADER, StreamHeader { law: None, ..HEADER }, StreamHeader { labelled: true, ..HEADER }] {
        h5::Writer::create(&path, &header).unwrap().finish(0).unwrap();
        assert_eq!(h5::Reader::open(&path).unwrap().header(), Some(header));
    }
}
