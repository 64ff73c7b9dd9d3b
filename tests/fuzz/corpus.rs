//! The sound files that every run starts from.

use gs2e::event::{Event, EventSink as _, Header, Polarity, h5, npz};
use gs2e::image::Size;
use gs2e::units::Timestamp;
use std::io::Read as _;
use std::path::Path;

/// Files with their names.
pub(crate) type Corpus = Vec<(String, Vec<u8>)>;

/// Files by their paths in the repository.
pub(crate) fn files(paths: &[&str]) -> Corpus {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    paths.iter().map(|path| ((*path).to_owned(), std::fs::read(root.join(path)).unwrap())).collect()
}

/// The content of gzip files.
pub(crate) fn inflated(paths: &[&str]) -> Corpus {
    let inflate = |(name, bytes): (String, Vec<u8>)| {
        let mut content = Vec::new();
        flate2::read::GzDecoder::new(&bytes[..]).read_to_end(&mut content).unwrap();
        (name, content)
    };
    files(paths).into_iter().map(inflate).collect()
}

/// The files of a zip archive whose names end with `suffix`.
pub(crate) fn zipped(path: &str, suffix: &str) -> Corpus {
    let (_, bytes) = files(&[path]).remove(0);
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let mut corpus = Corpus::new();
    for i in 0..archive.len() {
        let mut file = archive.by_index(i).unwrap();
        let mut content = Vec::new();
        file.read_to_end(&mut content).unwrap();
        let name = file.name().unwrap().into_owned();
        if name.ends_with(suffix) {
            corpus.push((name, content));
        }
    }
    corpus
}

const SIZE: Size = Size { width: 64, height: 48 };

/// Some events of a sensor of [`SIZE`].
fn events(count: i64) -> Vec<Event> {
    let event = |i: i64| Event {
        t: Timestamp::from_micros(37 * i),
        x: u16::try_from(7 * i % 64).unwrap(),
        y: u16::try_from(i % 48).unwrap(),
        polarity: if i % 3 == 0 { Polarity::Off } else { Polarity::On },
    };
    (0..count).map(event).collect()
}

/// Event streams, none, few and many events long, as `write` has them.
fn streams(write: impl Fn(&Path, &[Event])) -> Corpus {
    let folder = tempfile::tempdir().unwrap();
    let stream = |count: i64| {
        let path = folder.path().join("stream");
        write(&path, &events(count));
        (format!("{count} events"), std::fs::read(path).unwrap())
    };
    [0, 3, 300].map(stream).into()
}

/// Event streams as `.h5`.
pub(crate) fn h5() -> Corpus {
    streams(|path, events| {
        let header = Header { size: SIZE, law: None };
        let mut writer = h5::Writer::create(path, &header).unwrap();
        writer.append(events).unwrap();
        writer.finish(20_000).unwrap();
    })
}

/// Event streams as `.npz`.
pub(crate) fn npz() -> Corpus {
    streams(|path, events| {
        let mut writer = npz::Writer::create(path, SIZE).unwrap();
        writer.append(events).unwrap();
        writer.finish().unwrap();
    })
}
