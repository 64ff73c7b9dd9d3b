//! HDF5 files of others: their faults by name, their columns and their index.

use super::*;

/// A part of an HDF5 file that is replaced by something else; the rest follows the layout.
#[derive(Clone, Copy)]
enum Instead {
    Nothing,
    No(&'static str),
    Polarity(u8),
    Times([u32; 3]),
    Index(&'static [u64]),
    Offset(i64),
    ShortX,
    WideY,
    Chunks(usize),
    Labels(&'static [u8]),
}

fn write_foreign(path: &Path, instead: Instead) {
    let file = rust_hdf5::H5File::create(path).unwrap();
    let events = file.create_group("events").unwrap();
    let column = |name: &'static str, bytes: &[u8], width: usize| {
        if matches!(instead, Instead::No(absent) if absent == name) {
            return;
        }
        let len = bytes.len() / width;
        match width {
            1 => events.new_dataset::<u8>().shape([len]).create(name).unwrap(),
            2 => events.new_dataset::<u16>().shape([len]).create(name).unwrap(),
            _ => events.new_dataset::<u32>().shape([len]).create(name).unwrap(),
        }
        .write_raw_bytes(bytes)
        .unwrap();
    };
    let times = if let Instead::Times(times) = instead { times } else { [5, 900, 1001] };
    column("t", &times.map(u32::to_le_bytes).concat(), 4);
    column("x", &[7, 0, 8, 0, 9, 0][..if matches!(instead, Instead::ShortX) { 4 } else { 6 }], 2);
    let wide = matches!(instead, Instead::WideY);
    column("y", &[0; 12][..if wide { 12 } else { 6 }], if wide { 4 } else { 2 });
    column("p", &[1, if let Instead::Polarity(p) = instead { p } else { 0 }, 1], 1);
    if let Instead::Labels(labels) = instead {
        column("label", labels, 1);
    }
    let index = if let Instead::Index(index) = instead { index } else { &[0, 2, 3] };
    let chunk = if let Instead::Chunks(chunk) = instead { chunk } else { 3 };
    let dataset =
        file.new_dataset::<u64>().shape([index.len()]).chunk(&[chunk]).max_shape(&[None]).create("ms_to_idx");
    dataset.unwrap().write_raw(index).unwrap();
    let offset = if let Instead::Offset(offset) = instead { offset } else { 0 };
    file.new_dataset::<i64>().scalar().create("t_offset").unwrap().write_raw(&[offset]).unwrap();
    file.close().unwrap();
}

#[test]
fn faults_of_an_hdf5_file_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.h5");
    write_foreign(&path, Instead::Nothing);
    let events = read_h5(&path).unwrap();
    assert_eq!(
        events.iter().map(|e| (e.t.floor_micros(), e.x)).collect::<Vec<_>>(),
        [(5, 7), (900, 8), (1001, 9)]
    );

    let t = |instead, words: &str| {
        write_foreign(&path, instead);
        let error = read_h5(&path).unwrap_err().to_string();
        assert!(error.contains(words), "`{words}`: {error}");
    };
    t(Instead::No("p"), "dataset `events/p`: ");
    t(Instead::Polarity(2), "`events/p`[1] is 2, wanted 0 or 1");
    t(Instead::Labels(&[1, 0, 2]), "`events/label`[2] is 2, wanted 0 or 1");
    t(Instead::Labels(&[1, 0]), "dataset `events/label`: 2 elements, wanted 3 as in `events/t`");
    t(Instead::Times([5, 4, 1001]), "`events/t`[1] is 4, wanted at least 5");
    t(Instead::Index(&[0, 1, 3]), "`ms_to_idx`[1] is 1, wanted 2");
    t(Instead::Index(&[0, 2]), "dataset `ms_to_idx`: 2 entries, wanted more");
    t(Instead::Index(&[0, 2, 3, 2]), "`ms_to_idx`[3] is 2, wanted 3");
    t(Instead::Offset(i64::MAX), "dataset `t_offset`: [9223372036854775807], wanted one time");
    t(Instead::ShortX, "dataset `events/x`: 2 elements, wanted 3 as in `events/t`");
    t(Instead::WideY, "dataset `events/y`: its type is ");
    t(
        Instead::Chunks(1 << 21),
        "dataset `ms_to_idx`: its chunks have 2097152 elements, wanted at most 1048576",
    );
    std::fs::write(&path, "no HDF5 file").unwrap();
    assert!(read_h5(&path).is_err());
}

/// EventCV 1.0 writes times of 64 bits, and neither `ms_to_idx` nor `t_offset`.
#[test]
fn an_hdf5_file_of_four_columns_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.h5");
    let write = |times: [i64; 2]| {
        let file = rust_hdf5::H5File::create(&path).unwrap();
        let events = file.create_group("events").unwrap();
        events.new_dataset::<i64>().shape([2]).create("t").unwrap().write_raw(&times).unwrap();
        for (name, values) in [("x", [3_u16, 4]), ("y", [5, 6])] {
            events.new_dataset::<u16>().shape([2]).create(name).unwrap().write_raw(&values).unwrap();
        }
        events.new_dataset::<u8>().shape([2]).create("p").unwrap().write_raw(&[1_u8, 0]).unwrap();
        file.close().unwrap();
    };
    let read = || {
        let mut events = Vec::new();
        h5::Reader::open(&path).unwrap().next_chunk(&mut events).map(|_| events)
    };
    write([7, 5_000_000_000]);
    let found: Vec<(i64, u16, u16)> =
        read().unwrap().iter().map(|e| (e.t.floor_micros(), e.x, e.y)).collect();
    assert_eq!(found, [(7, 3, 5), (5_000_000_000, 4, 6)]);
    let error = h5::Reader::open(&path).unwrap().verify_index().unwrap_err().to_string();
    assert!(error.contains("dataset `ms_to_idx`: it is missing"), "{error}");
    write([7, i64::MAX]);
    let error = read().unwrap_err().to_string();
    assert!(error.contains("`events/t`[1] is 9223372036854775807"), "{error}");
}

/// Compares `ms_to_idx` with its definition: entry k is the number of events with `t < 1000 k`.
#[test]
fn the_index_of_an_hdf5_file_is_as_defined() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.h5");
    for (count, last_stamp_us) in [(0, 0), (0, 62_083), (1, 0), (70_000, 1), (70_000, 300_000_000)] {
        let events = stream(count);
        let mut writer = h5::Writer::create(&path, &HEADER).unwrap();
        writer.append(&events).unwrap();
        writer.finish(last_stamp_us).unwrap();
        h5::Reader::open(&path).unwrap().verify_index().unwrap();

        let times: Vec<i64> = events.iter().map(|e| e.t.floor_micros()).collect();
        let end = last_stamp_us.max(times.last().copied().unwrap_or(0));
        let file = rust_hdf5::H5File::open(&path).unwrap();
        let found = file.dataset("ms_to_idx").unwrap().read_raw::<u64>().unwrap();
        assert_eq!(found.len() as i64, end / 1000 + 2);
        let mut before = times.iter().peekable();
        let mut earlier = 0;
        for (&entry, start) in found.iter().zip((0..).step_by(1000)) {
            while before.next_if(|t| **t < start).is_some() {
                earlier += 1;
            }
            assert_eq!(entry, earlier, "from {start} us");
        }
        assert_eq!(h5::Reader::open(&path).unwrap().index().unwrap(), found);
    }
}

/// After a seek the reader continues with the chunk that holds the event, and it detects the end of
/// the stream.
#[test]
fn an_hdf5_file_is_read_from_the_middle() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.h5");
    let events = stream(150_000);
    let mut writer = h5::Writer::create(&path, &HEADER).unwrap();
    writer.append(&events).unwrap();
    writer.finish(0).unwrap();
    let mut reader = h5::Reader::open(&path).unwrap();
    let mut chunk = Vec::new();
    for (number, from) in [(70_000, 65_536), (0, 0), (65_536, 65_536), (149_999, 131_072)] {
        reader.seek(number);
        assert!(reader.next_chunk(&mut chunk).unwrap());
        assert!(kept(&chunk) == kept(&events[from..(from + 65_536).min(150_000)]), "{number}");
    }
    reader.seek(150_000);
    assert!(!reader.next_chunk(&mut chunk).unwrap());
    reader.seek(u64::MAX);
    assert!(!reader.next_chunk(&mut chunk).unwrap());
}
