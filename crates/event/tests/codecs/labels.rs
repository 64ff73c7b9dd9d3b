//! Labels of events: the formats that hold them, and faulty ones.

use super::*;

/// The labels of events, as files hold them.
fn labels(events: &[Event]) -> Vec<EventLabel> {
    events.iter().map(|event| event.label).collect()
}

#[test]
fn labels_are_kept_by_formats_that_can_hold_them() {
    each_codec(|codec, path| {
        for count in [0, 1, 65_537, 200_000] {
            let events = stream(count);
            let write = |labelled| {
                let header = StreamHeader { labelled, ..HEADER };
                let mut writer =
                    file::create(path, codec.format, &header, file::WriteOptions::default()).unwrap();
                append_all(&mut *writer, &events, 10_007);
                writer.finish(LAST_STAMP_US).unwrap();
                let mut opened = file::open(path, codec.format, ReadHints::default()).unwrap();
                let back = read_all(&mut *opened.source).unwrap();
                assert_eq!(kept(&back), kept(&events), "{}, {count} events", codec.name);
                (opened.header.labelled, labels(&back), std::fs::read(path).unwrap())
            };
            let (plain, all_signal, bytes) = write(false);
            assert!(!plain && all_signal.iter().all(|label| *label == EventLabel::Signal));
            let (labelled, found, with_labels) = write(true);
            assert_eq!(labelled, codec.format.keeps_labels(), "{}", codec.name);
            if labelled {
                assert_eq!(found, labels(&events), "{}, {count} events", codec.name);
            } else {
                assert!(bytes == with_labels, "{}", codec.name);
            }
        }
    });
}

#[test]
fn faulty_labels_of_an_archive_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("e.npz");
    let mut writer = npz::Writer::create(&path, &HEADER).unwrap();
    append_all(&mut writer, &stream(3), 3);
    writer.finish().unwrap();
    let plain = std::fs::read(&path).unwrap();
    let t = |kind: &str, labels: &[u8], words: Option<&str>| {
        let mut archive = zip::ZipWriter::new_append(Cursor::new(plain.clone())).unwrap();
        archive.start_file("label.npy", zip::write::SimpleFileOptions::default()).unwrap();
        let mut head =
            format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({},), }}", labels.len());
        head.push_str(&" ".repeat(117 - head.len()));
        archive.write_all(b"\x93NUMPY\x01\x00\x76\x00").unwrap();
        archive.write_all(format!("{head}\n").as_bytes()).unwrap();
        archive.write_all(labels).unwrap();
        std::fs::write(&path, archive.finish().unwrap().into_inner()).unwrap();
        match (read_npz(&path), words) {
            (Ok(events), None) => {
                assert_eq!(events.iter().map(|event| event.label as u8).collect::<Vec<_>>(), labels);
            }
            (Err(error), Some(words)) => assert!(error.to_string().contains(words), "`{words}`: {error}"),
            (found, words) => panic!("{words:?}: {found:?}"),
        }
    };
    t("|u1", &[1, 0, 1], None);
    t("|u1", &[1, 2, 1], Some("`label`[1] is 2, wanted 0 or 1"));
    t("|u1", &[1, 0], Some("dataset `label`: 2 elements, wanted 3 as in `t`"));
    t("|i1", &[1, 0, 1], Some("dataset `label`: an array of type '|i1'"));
}
