//! NumPy arrays, read by a crate that the program does not write them with.

use std::io::Read;
use std::path::Path;

/// Shape, type and numbers of an array.
pub(super) struct Array<T> {
    pub(super) shape: Vec<u64>,
    pub(super) kind: String,
    pub(super) values: Vec<T>,
}

fn parse<T: npyz::Deserialize>(bytes: &[u8]) -> Array<T> {
    let file = npyz::NpyFile::new(bytes).unwrap();
    let (shape, kind) = (file.shape().to_vec(), file.dtype().descr());
    Array { shape, kind, values: file.into_vec().unwrap() }
}

pub(super) fn read_npy<T: npyz::Deserialize>(path: &Path) -> Array<T> {
    parse(&std::fs::read(path).unwrap())
}

pub(super) fn read_npz<T: npyz::Deserialize>(path: &Path, name: &str) -> Array<T> {
    parse(&entry(path, name))
}

/// The bytes of an array of an archive.
pub(super) fn entry(path: &Path, name: &str) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut bytes = Vec::new();
    archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
    bytes
}

/// Numbers of a text, by line.
pub(super) fn rows(text: &str) -> Vec<Vec<f64>> {
    let row = |line: &str| line.split_whitespace().map(|number| number.parse().unwrap()).collect();
    text.lines().map(row).collect()
}
