//! A tensor as a file of PyTorch, written without PyTorch.
//!
//! Format: a zip archive of `data.pkl`, `data/0` and `version` in a folder `archive`, nothing compressed.
//! `data.pkl` is a pickle of protocol 2 (Python, `pickletools.py`) that calls
//! `torch._utils._rebuild_tensor_v2(storage, offset, shape, strides, requires_grad, hooks)`; `data/0` holds
//! the little-endian numbers.

use super::ExportError;
use super::npy::entry_options;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipWriter};

/// A float32 tensor of three axes that is written front to back.
pub(super) struct TensorWriter {
    path: PathBuf,
    archive: ZipWriter<BufWriter<File>>,
    /// Numbers that are missing.
    left: u64,
}

impl TensorWriter {
    /// Starts a tensor of this shape.
    pub(super) fn create(path: &Path, shape: [u64; 3]) -> Result<Self, ExportError> {
        let left = shape.iter().product();
        let start = || {
            let mut archive = ZipWriter::new(BufWriter::new(File::create_new(path)?));
            let options = entry_options(CompressionMethod::Stored).large_file(true);
            archive.start_file("archive/data.pkl", options)?;
            archive.write_all(&pickle(shape))?;
            archive.start_file("archive/version", options)?;
            archive.write_all(b"3\n")?;
            // Last, because its numbers follow one by one, and an archive has one open entry.
            archive.start_file("archive/data/0", options)?;
            Ok::<_, io::Error>(archive)
        };
        let archive = start().map_err(ExportError::unwritten(path))?;
        Ok(Self { path: path.to_owned(), archive, left })
    }

    /// Appends numbers.
    pub(super) fn push(&mut self, values: &[f32]) -> Result<(), ExportError> {
        self.left = self.left.checked_sub(values.len() as u64).expect("the shape bounds the numbers");
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.archive.write_all(&bytes).map_err(ExportError::unwritten(&self.path))
    }

    /// Completes the file.
    pub(super) fn finish(self) -> Result<(), ExportError> {
        assert_eq!(self.left, 0, "the tensor has all of its numbers");
        let finish = || self.archive.finish()?.flush();
        finish().map_err(ExportError::unwritten(&self.path))
    }
}

/// The pickle of a contiguous tensor.
fn pickle(shape: [u64; 3]) -> Vec<u8> {
    let [_, rows, columns] = shape;
    let mut bytes = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((".to_vec();
    text("storage", &mut bytes);
    bytes.extend(b"ctorch\nFloatStorage\n");
    text("0", &mut bytes);
    text("cpu", &mut bytes);
    integer(shape.iter().product(), &mut bytes);
    // TUPLE, BINPERSID, and an offset of 0.
    bytes.extend(b"tQK\x00");
    for numbers in [shape, [rows * columns, columns, 1]] {
        numbers.iter().for_each(|number| integer(*number, &mut bytes));
        // TUPLE3.
        bytes.push(b'\x87');
    }
    // NEWFALSE, an empty OrderedDict, TUPLE, REDUCE, STOP.
    bytes.extend(b"\x89ccollections\nOrderedDict\n)RtR.");
    bytes
}

/// BINUNICODE.
fn text(value: &str, out: &mut Vec<u8>) {
    out.push(b'X');
    out.extend(u32::try_from(value.len()).expect("a text is short").to_le_bytes());
    out.extend(value.as_bytes());
}

/// BININT where it suffices, or LONG1 of 8 bytes.
fn integer(value: u64, out: &mut Vec<u8>) {
    if let Ok(short) = i32::try_from(value) {
        out.push(b'J');
        out.extend(short.to_le_bytes());
    } else {
        out.extend(b"\x8a\x08");
        out.extend(value.to_le_bytes());
    }
}
