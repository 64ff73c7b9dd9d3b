//! Writing: an array's length is written before its elements, so columns are kept in temporary
//! files.

use super::{ARRAYS, LABEL, SIZE};
use crate::order::{END_US, StreamOrder};
use crate::{Event, EventFileError, EventSink, StreamHeader};
use gs2e_files as files;
use gs2e_files::Removal;
use gs2e_files::rename::parent_folder;
use npyz::{DType, WriteOptions, WriterBuilder};
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// Level of deflate: half the time of level 6 for 2 % more bytes.
const LEVEL: i64 = 4;

/// Writes one stream in constant memory.
///
/// The archive appears with [`Writer::finish`]. Until then, the columns are in files without a name in
/// its folder.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    columns: SpooledColumns,
}

impl Writer {
    /// Starts an archive for a stream.
    ///
    /// # Errors
    /// A file next to `path` cannot be created.
    pub fn create(path: &Path, header: &StreamHeader) -> Result<Self, EventFileError> {
        let columns = SpooledColumns::new(header, parent_folder(path))?;
        Ok(Self { path: path.to_owned(), columns })
    }

    /// Writes the archive, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails; there is no archive then.
    pub fn finish(self) -> Result<u64, EventFileError> {
        let written = self.columns.write_archive(BufWriter::new(File::create(&self.path)?));
        if written.is_err() {
            // If the removal fails, the archive has no directory, so no reader takes it for
            // complete.
            let _ = files::remove(&self.path, Removal::File);
        }
        written
    }
}

impl EventSink for Writer {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.columns.append(events)
    }
}

/// The events of one stream until their archive is written, in files without a name.
#[derive(Debug)]
pub struct SpooledColumns {
    size: [i32; 2],
    order: StreamOrder,
    columns: [ColumnSpool; 4],
    labels: Option<ColumnSpool>,
}

impl SpooledColumns {
    /// Starts a stream whose columns are kept in `folder`.
    ///
    /// # Errors
    /// A file cannot be created there.
    pub fn new(header: &StreamHeader, folder: &Path) -> Result<Self, EventFileError> {
        let [t, x, y, p] = ARRAYS.map(|_| ColumnSpool::within(folder));
        let labels = header.labelled.then(|| ColumnSpool::within(folder)).transpose()?;
        let order = StreamOrder::new(header.size, END_US);
        let side = |side: u32| i32::try_from(side).unwrap_or(i32::MAX);
        let size = [side(header.size.width), side(header.size.height)];
        Ok(Self { size, order, columns: [t?, x?, y?, p?], labels })
    }

    /// Writes the archive, and returns the number of events.
    ///
    /// # Errors
    /// Writing fails; what was written is no archive then.
    pub fn write_archive(mut self, out: impl Write + Seek) -> Result<u64, EventFileError> {
        let count = self.order.count();
        let mut archive = ZipWriter::new(out);
        for ((name, kind), column) in
            // `zip` ends with the columns, so the name of the labels is used only if there are any.
            ARRAYS.into_iter().chain([LABEL]).zip(self.columns.iter_mut().chain(&mut self.labels))
        {
            archive.start_file(format!("{name}.npy"), entry_options())?;
            write_npy_header(&mut archive, kind, count)?;
            std::io::copy(&mut column.rewound()?, &mut archive)?;
        }
        let (name, kind) = SIZE;
        archive.start_file(format!("{name}.npy"), entry_options())?;
        write_npy_header(&mut archive, kind, 2)?;
        archive.write_all(self.size.map(i32::to_le_bytes).as_flattened())?;
        archive.finish()?.flush()?;
        Ok(count)
    }
}

impl EventSink for SpooledColumns {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        // Before any column is written, so that the columns stay equally long.
        self.order.admit(events)?;
        let [t, x, y, p] = &mut self.columns;
        for event in events {
            t.file.write_all(&event.t.floor_micros().to_le_bytes())?;
            x.file.write_all(&event.x.to_le_bytes())?;
            y.file.write_all(&event.y.to_le_bytes())?;
            p.file.write_all(&[event.polarity as u8])?;
            if let Some(labels) = &mut self.labels {
                labels.file.write_all(&[event.label as u8])?;
            }
        }
        Ok(())
    }
}

/// Options of every entry. Sizes always have 64 bits, so that the bytes do not depend on a guess.
fn entry_options() -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .compression_level(Some(LEVEL))
        // A fixed time, so that equal streams give equal bytes.
        .last_modified_time(DateTime::DEFAULT)
        .unix_permissions(0o644)
        .large_file(true)
}

fn write_npy_header(out: &mut impl Write, kind: &str, count: u64) -> std::io::Result<()> {
    let dtype = DType::Plain(kind.parse().expect("the array types are NumPy's"));
    WriteOptions::new_header_only().dtype(dtype).shape(&[count]).writer(out).write_header_only()?;
    Ok(())
}

/// The bytes of one column until the archive is written.
#[derive(Debug)]
struct ColumnSpool {
    file: BufWriter<File>,
}

impl ColumnSpool {
    /// An empty column. Its file has no name, so it replaces none and is gone when the process ends.
    fn within(folder: &Path) -> std::io::Result<Self> {
        let file = tempfile::tempfile_in(folder)?;
        Ok(Self { file: BufWriter::new(file) })
    }

    fn rewound(&mut self) -> std::io::Result<&File> {
        // The rewind also flushes the buffer, so that the file is complete behind it.
        self.file.rewind()?;
        Ok(self.file.get_ref())
    }
}
