//! NumPy arrays of unknown length, and archives of them. The length is written last.

use super::ExportError;
use gs2e_files as files;
use gs2e_files::Removal;
use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// Bytes of a header: room for a length of 20 digits and three sides of a picture.
const HEADER: usize = 128;

/// A header of format 1.0 for an array of this type and shape.
fn header(kind: &str, shape: &[u64]) -> Vec<u8> {
    let sides: String = shape.iter().map(|side| format!("{side},")).collect();
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(HEADER - 10).expect("a header is short").to_le_bytes());
    bytes.extend(text.as_bytes());
    // NumPy ends a header with spaces and one line feed.
    bytes.resize(HEADER - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// A whole array.
pub(super) fn array(kind: &str, shape: &[u64], values: &[u8]) -> Vec<u8> {
    [header(kind, shape), values.to_vec()].concat()
}

/// A text, as NumPy's `<U` scalar.
pub(super) fn text(value: &str) -> Vec<u8> {
    let bytes: Vec<u8> = value.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
    // NumPy has no text of length 0.
    let bytes = if bytes.is_empty() { vec![0; 4] } else { bytes };
    array(&format!("<U{}", bytes.len() / 4), &[], &bytes)
}

/// A float32 number.
pub(super) fn scalar(value: f64) -> Entry {
    Entry::Whole(array("<f4", &[], &float32([value])))
}

/// Whole numbers along one axis.
pub(super) fn int64(values: impl IntoIterator<Item = i64>) -> Vec<u8> {
    let bytes: Vec<u8> = values.into_iter().flat_map(i64::to_le_bytes).collect();
    array("<i8", &[bytes.len() as u64 / 8], &bytes)
}

/// An array that grows along its first axis.
#[derive(Debug)]
pub(super) struct GrowingArray {
    path: PathBuf,
    file: BufWriter<File>,
    kind: &'static str,
    /// The shape of a row.
    row: Vec<u64>,
    rows: u64,
}

impl GrowingArray {
    /// Starts an array with rows of `columns` elements, or of one axis without them.
    pub(super) fn create(path: &Path, kind: &'static str, columns: Option<u64>) -> Result<Self, ExportError> {
        Self::of_rows(path, kind, columns.into_iter().collect())
    }

    /// Starts an array whose rows have this shape.
    pub(super) fn of_rows(path: &Path, kind: &'static str, row: Vec<u64>) -> Result<Self, ExportError> {
        let create = || {
            let mut file = BufWriter::new(File::create_new(path)?);
            // Room for the header, whose length does not depend on the number of rows.
            file.write_all(&[0; HEADER])?;
            Ok(file)
        };
        let file = create().map_err(ExportError::unwritten(path))?;
        Ok(Self { path: path.to_owned(), file, kind, row, rows: 0 })
    }

    /// Appends a row.
    pub(super) fn push(&mut self, row: &[u8]) -> Result<(), ExportError> {
        self.rows += 1;
        self.file.write_all(row).map_err(ExportError::unwritten(&self.path))
    }

    /// Number of rows so far.
    pub(super) fn rows(&self) -> u64 {
        self.rows
    }

    /// Completes the file.
    pub(super) fn finish(mut self) -> Result<PathBuf, ExportError> {
        let shape: Vec<u64> = [self.rows].into_iter().chain(self.row.iter().copied()).collect();
        let header = header(self.kind, &shape);
        let mut finish = || {
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(&header)?;
            self.file.flush()
        };
        finish().map_err(ExportError::unwritten(&self.path))?;
        Ok(self.path)
    }
}

/// An entry of an archive.
pub(super) enum Entry {
    /// A complete array.
    Whole(Vec<u8>),
    /// An array in a file next to the archive, which is removed.
    Spooled(GrowingArray),
}

/// Options of an entry of an archive. Its date is the first day of the format, so that equal data are equal
/// bytes.
pub(super) fn entry_options(method: CompressionMethod) -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(method)
        .last_modified_time(DateTime::DEFAULT)
        .unix_permissions(0o644)
}

/// Writes an archive of arrays. Nothing is compressed: loaders map such entries fastest.
pub(super) fn write_archive(path: &Path, entries: Vec<(&str, Entry)>) -> Result<(), ExportError> {
    let failed = |e: io::Error| ExportError::unwritten(path)(e);
    let mut archive = ZipWriter::new(BufWriter::new(File::create_new(path).map_err(failed)?));
    // Zip64, because the length of an entry is not known when its header is written, and may exceed 4 GiB.
    let options = entry_options(CompressionMethod::Stored).large_file(true);
    for (name, entry) in entries {
        archive.start_file(format!("{name}.npy"), options).map_err(|e| failed(e.into()))?;
        match entry {
            Entry::Whole(bytes) => archive.write_all(&bytes).map_err(failed)?,
            Entry::Spooled(array) => {
                let spool = array.finish()?;
                // Each spool is removed as soon as it is copied, so that only one array is on the disk twice.
                let copy = files::open(&spool).and_then(|mut file| io::copy(&mut file, &mut archive));
                copy.and_then(|_| files::remove(&spool, Removal::File)).map_err(failed)?;
            }
        }
    }
    archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)
}

/// A compressed archive of whole arrays, in memory.
pub(super) fn compressed_archive(entries: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(io::Cursor::new(Vec::new()));
    let options = entry_options(CompressionMethod::Deflated);
    for (name, bytes) in entries {
        let added = archive.start_file(format!("{name}.npy"), options);
        added
            .map_err(io::Error::from)
            .and_then(|()| archive.write_all(bytes))
            .expect("a Vec takes any bytes");
    }
    archive.finish().expect("a Vec takes any bytes").into_inner()
}

/// Little-endian bytes of float64 numbers.
pub(super) fn float64(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(f64::to_le_bytes).collect()
}

/// Little-endian bytes of float32 numbers, each rounded to the nearest.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
pub(super) fn float32(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(|value| (value as f32).to_le_bytes()).collect()
}
