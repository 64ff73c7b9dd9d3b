//! The layouts for networks: every event is in one window, and both layouts hold the same.

use super::{TestExport, arrays, plane};
use gs2e_event::{Event, EventSource as _, Polarity, h5};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::{Field, Row};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;

/// A window, as a loader reads it.
#[derive(Debug, PartialEq)]
struct Sample {
    description: Value,
    /// t from the start of the window, x, y, p.
    events: Vec<[i64; 4]>,
    sharp: Vec<u8>,
}

fn webdataset(exported: &TestExport, split: &str) -> Vec<Sample> {
    let mut members: BTreeMap<String, BTreeMap<String, Vec<u8>>> = BTreeMap::new();
    let mut keys: Vec<String> = Vec::new();
    let mut archive = tar::Archive::new(File::open(exported.path(&format!("{split}-000000.tar"))).unwrap());
    for entry in archive.entries().unwrap() {
        let mut entry = entry.unwrap();
        assert_eq!((entry.header().mtime().unwrap(), entry.header().uid().unwrap()), (0, 0));
        let name = entry.path().unwrap().to_string_lossy().into_owned();
        let (key, kind) = name.split_once('.').unwrap();
        if keys.last().is_none_or(|last| last != key) {
            keys.push(key.to_owned());
        }
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        assert!(members.entry(key.to_owned()).or_default().insert(kind.to_owned(), bytes).is_none());
    }
    // The members of a sample are neighbours, and all samples have the same kinds of them.
    assert_eq!(keys.len(), members.len());
    for kinds in members.values() {
        assert_eq!(kinds.keys().collect::<Vec<_>>(), ["events.npz", "json", "sharp.png"]);
    }
    let folder = tempfile::tempdir().unwrap();
    let sample = |key: &String| {
        let path = folder.path().join("events.npz");
        std::fs::write(&path, &members[key]["events.npz"]).unwrap();
        let [x, y] = ["x", "y"].map(|name| arrays::read_npz::<u16>(&path, name).values);
        let (t, p) = (arrays::read_npz::<u32>(&path, "t").values, arrays::read_npz::<u8>(&path, "p").values);
        let event = |i: usize| [i64::from(t[i]), x[i].into(), y[i].into(), p[i].into()];
        Sample {
            description: serde_json::from_slice(&members[key]["json"]).unwrap(),
            events: (0..t.len()).map(event).collect(),
            sharp: members[key]["sharp.png"].clone(),
        }
    };
    keys.iter().map(sample).collect()
}

fn parquet_rows(exported: &TestExport, split: &str) -> Vec<Sample> {
    let reader =
        SerializedFileReader::new(File::open(exported.path(&format!("{split}.parquet"))).unwrap()).unwrap();
    let column = |row: &Row, name: &str| {
        row.get_column_iter().find(|(column, _)| *column == name).map(|(_, field)| field.clone()).unwrap()
    };
    let list = |row: &Row, name: &str| -> Vec<i64> {
        let Field::ListInternal(list) = column(row, name) else { panic!("{name} is no list") };
        let number = |field: &Field| match field {
            Field::UInt(value) => i64::from(*value),
            Field::UShort(value) => i64::from(*value),
            Field::UByte(value) => i64::from(*value),
            other => panic!("{name} holds {other:?}"),
        };
        list.elements().iter().map(number).collect()
    };
    let sample = |row: Row| {
        let [t, x, y, p] = ["t", "x", "y", "p"].map(|name| list(&row, name));
        let Field::Group(picture) = column(&row, "sharp") else { panic!("sharp is no group") };
        let Field::Bytes(sharp) = column(&picture, "bytes") else { panic!("a picture has no bytes") };
        let Field::Str(description) = column(&row, "description") else {
            panic!("the description is no text")
        };
        let description: Value = serde_json::from_str(&description).unwrap();
        assert_eq!(column(&row, "t0_us"), Field::Long(description["t0_us"].as_i64().unwrap()));
        assert_eq!(column(&row, "t1_us"), Field::Long(description["t1_us"].as_i64().unwrap()));
        let events = (0..t.len()).map(|i| [t[i], x[i], y[i], p[i]]).collect();
        Sample { description, events, sharp: sharp.data().to_vec() }
    };
    reader.get_row_iter(None).unwrap().map(|row| sample(row.unwrap())).collect()
}

/// The events of the released file.
pub(super) fn stream(plane: &plane::Plane) -> Vec<Event> {
    let mut reader = h5::Reader::open(&plane.folder("events.h5")).unwrap();
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk).unwrap() {
        all.extend_from_slice(&chunk);
    }
    all
}

#[test]
fn every_event_is_in_one_window_of_both_layouts() {
    let plane = plane::centred();
    let tars = TestExport::of(plane, "webdataset", &[]);
    let tables = TestExport::of(plane, "parquet", &[]);
    let mut samples = Vec::new();
    for split in ["train", "test"] {
        let (one, other) = (webdataset(&tars, split), parquet_rows(&tables, split));
        assert_eq!(one, other, "{split}");
        assert!(one.iter().all(|sample| sample.description["split"] == split));
        samples.extend(one);
    }
    samples.sort_by_key(|sample| sample.description["t0_us"].as_i64());
    assert_eq!(samples.len(), (plane::POSES - 1) / plane.sharp_every);
    let mut events = Vec::new();
    for (i, sample) in samples.iter().enumerate() {
        let first = i * plane.sharp_every;
        let poses = sample.description["poses"].as_array().unwrap();
        assert_eq!(poses.len(), plane.sharp_every + 1);
        assert_eq!(poses[0]["t_us"], plane::stamp_us(first));
        let start = sample.description["t0_us"].as_i64().unwrap();
        let end = sample.description["t1_us"].as_i64().unwrap();
        assert_eq!((start, end), (plane::stamp_us(first), plane::stamp_us(first + plane.sharp_every)));
        let is_last = i + 1 == samples.len();
        assert!(sample.events.iter().all(|[t, ..]| *t < end - start || (is_last && *t == end - start)));
        // The frame at the end of the window, as it is released.
        let frame = plane.folder(&format!("sharp/{:06}.png", first + plane.sharp_every));
        assert_eq!(sample.sharp, std::fs::read(frame).unwrap());
        // Held out are the frames 0, 8, 16 and so on, and the first one ends no window.
        assert_eq!(sample.description["split"] == "test", (i + 1) % 8 == 0, "{i}");
        events.extend(sample.events.iter().map(|[t, x, y, p]| [t + start, *x, *y, *p]));
    }
    let wanted = stream(plane).into_iter().map(|event| {
        let p = i64::from(event.polarity == Polarity::On);
        [event.t.floor_micros(), event.x.into(), event.y.into(), p]
    });
    assert_eq!(events, wanted.collect::<Vec<_>>());
    assert!(samples[0].description["c_on"].as_f64().is_some_and(|c| (c - plane::THRESHOLD).abs() < 1e-12));
}
