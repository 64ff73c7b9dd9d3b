//! The sound files that every run starts from.

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
