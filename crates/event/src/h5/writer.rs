//! Writing: events are held until they fill chunks, chunks are filtered in parallel and stored in
//! stream order.

use super::filter::ChunkFilter;
use super::index::MsIndex;
use super::layout::{CHUNK, MS_TO_IDX, T_OFFSET};
use super::{END_US, H5Options};
use crate::order::StreamOrder;
use crate::{Event, EventFileError, EventSink, StreamHeader};
use gs2e_files as files;
use gs2e_files::Removal;
use rayon::prelude::*;
use rust_hdf5::{H5Dataset, H5File, H5Group, H5Type, LibverBound};
use std::path::{Path, PathBuf};

/// Number of chunks that are filtered together: enough for all cores, and small in memory (17 MB of
/// events).
const BATCH: usize = 16;

/// Writes one stream in constant memory, except for the index of chunks with some 40 bytes per
/// 65,536 events.
///
/// A writer that is dropped before [`Writer::finish`] removes its file, so that no partial file
/// looks complete.
pub struct Writer {
    path: PathBuf,
    file: Option<H5File>,
    order: StreamOrder,
    held: Vec<Event>,
    columns: Vec<GrowingColumn>,
    index: MsIndex,
    index_held: Vec<u64>,
    index_column: GrowingColumn,
    filter: ChunkFilter,
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("path", &self.path).field("order", &self.order).finish_non_exhaustive()
    }
}

impl Writer {
    /// Creates the file, or replaces it.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path, header: &StreamHeader) -> Result<Self, EventFileError> {
        Self::create_as(path, header, H5Options::default())
    }

    /// Creates a file with these chunks and times. The times of events count from
    /// `options.t_offset_us`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create_as(path: &Path, header: &StreamHeader, options: H5Options) -> Result<Self, EventFileError> {
        let H5Options { filter, t_offset_us } = options;
        // The oldest layout is the only one in which the reader finds the attributes of the root.
        let file = H5File::options().no_locking().libver(LibverBound::Earliest).create(path)?;
        write_attributes(&file, header)?;
        let events = file.create_group("events")?;
        let mut columns = vec![
            GrowingColumn::create::<u16>(&events, "x", filter, |e, out| out.extend(e.x.to_le_bytes()))?,
            GrowingColumn::create::<u16>(&events, "y", filter, |e, out| out.extend(e.y.to_le_bytes()))?,
            GrowingColumn::create::<u8>(&events, "p", filter, |e, out| out.push(e.polarity as u8))?,
            GrowingColumn::create::<u32>(&events, "t", filter, |e, out| {
                out.extend(file_micros(e).to_le_bytes())
            })?,
        ];
        if header.labelled {
            columns.push(GrowingColumn::create::<u8>(&events, "label", filter, |e, out| {
                out.push(e.label as u8)
            })?);
        }
        let index_column = GrowingColumn::create::<u64>(&file.root_group(), MS_TO_IDX, filter, |_, _| ())?;
        file.new_dataset::<i64>().scalar().create(T_OFFSET)?.write_raw(&[t_offset_us])?;
        Ok(Self {
            path: path.to_owned(),
            file: Some(file),
            order: StreamOrder::new(header.size, END_US),
            held: Vec::new(),
            columns,
            index: MsIndex::default(),
            index_held: Vec::new(),
            index_column,
            filter,
        })
    }

    /// Completes the file of a stream with this last stamp, and returns the number of events. The
    /// bytes are passed to the operating system; the caller syncs them if necessary.
    ///
    /// # Errors
    /// The stamp is outside `0..2^32`, or writing fails.
    pub fn finish(mut self, last_stamp_us: i64) -> Result<u64, EventFileError> {
        let count = self.order.count();
        // A stream may end after its last event, and the index covers it up to there.
        let end_us = last_stamp_us.max(self.order.last_us().unwrap_or(0));
        let Ok(end_us) = u32::try_from(end_us) else {
            let because = format!("the stream ends at {end_us} us, wanted 0 to {}", END_US - 1);
            return Err(EventFileError::Order { index: count, because });
        };
        self.store_chunks(self.held.len())?;
        let entries = self.index.complete(end_us);
        self.extend_index(count, entries)?;
        self.store_index(self.index_held.len())?;
        if let Some(file) = self.file.take() {
            file.close_no_sync()?;
        }
        Ok(count)
    }

    fn note_times(&mut self, first: u64, events: &[Event]) -> Result<(), EventFileError> {
        for (number, event) in (first..).zip(events) {
            let entries = self.index.settle(file_micros(event));
            self.extend_index(number, entries)?;
        }
        Ok(())
    }

    fn extend_index(&mut self, value: u64, mut entries: u64) -> Result<(), EventFileError> {
        while entries > 0 {
            // A long silence adds many entries at once. They are stored in chunks, not held
            // together.
            let now = entries.min(CHUNK as u64);
            self.index_held.extend(std::iter::repeat_n(value, usize::try_from(now).unwrap_or(CHUNK)));
            entries -= now;
            self.store_index(self.index_held.len() / CHUNK * CHUNK)?;
        }
        Ok(())
    }

    fn store_index(&mut self, count: usize) -> Result<(), EventFileError> {
        for chunk in self.index_held[..count].chunks(CHUNK) {
            let bytes: Vec<u8> = chunk.iter().flat_map(|v| v.to_le_bytes()).collect();
            self.index_column.store(chunk.len(), &self.filter.apply(&bytes, size_of::<u64>())?)?;
        }
        self.index_held.drain(..count);
        Ok(())
    }

    /// Writes the first `count` of the held events: whole chunks, except at the end of the stream.
    fn store_chunks(&mut self, count: usize) -> Result<(), EventFileError> {
        let filter = self.filter;
        for batch in self.held[..count].chunks(BATCH * CHUNK) {
            let chunks: Vec<&[Event]> = batch.chunks(CHUNK).collect();
            let layouts: Vec<_> = self.columns.iter().map(|column| (column.width, column.encode)).collect();
            let stored = chunks.par_iter().map(|events| {
                let bytes = layouts
                    .par_iter()
                    .map(|(width, encode)| filter.apply(&bytes_of(events, *encode), *width));
                bytes.collect::<Result<Vec<_>, _>>()
            });
            let stored: Vec<Vec<Vec<u8>>> = stored.collect::<Result<_, _>>()?;
            // In the order of the stream, whichever chunk was filtered first.
            for (events, bytes) in chunks.iter().zip(&stored) {
                for (column, bytes) in self.columns.iter_mut().zip(bytes) {
                    column.store(events.len(), bytes)?;
                }
            }
        }
        self.held.drain(..count);
        Ok(())
    }
}

impl EventSink for Writer {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        let first = self.order.count();
        // Before the index sees the events, so that a refused chunk leaves no entries.
        self.order.admit(events)?;
        self.note_times(first, events)?;
        self.held.extend_from_slice(events);
        if self.held.len() >= BATCH * CHUNK {
            // Whole chunks only: a shorter chunk is final.
            self.store_chunks(self.held.len() / CHUNK * CHUNK)?;
        }
        Ok(())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.file.is_some() {
            // If the removal fails, the file is left to the code that handles the original failure.
            let _ = files::remove(&self.path, Removal::File);
        }
    }
}

/// The microseconds as stored in the file.
fn file_micros(event: &Event) -> u32 {
    u32::try_from(event.t.floor_micros()).expect("the order admits 0 <= t < 2^32 us only")
}

fn write_attributes(file: &H5File, header: &StreamHeader) -> Result<(), EventFileError> {
    file.set_attr_numeric("width", &header.size.width)?;
    file.set_attr_numeric("height", &header.size.height)?;
    if let Some(law) = &header.law {
        file.set_attr_numeric("law_version", &law.version)?;
        file.set_attr_numeric("c_on", &law.c_on)?;
        file.set_attr_numeric("c_off", &law.c_off)?;
    }
    Ok(())
}

/// Appends an event's element to the bytes of a column, little endian.
type Encode = fn(&Event, &mut Vec<u8>);

/// A dataset that grows.
struct GrowingColumn {
    dataset: H5Dataset,
    /// True if its chunks are stored without a filter.
    plain: bool,
    width: usize,
    encode: Encode,
    len: usize,
}

impl GrowingColumn {
    fn create<T: H5Type>(
        group: &H5Group,
        name: &str,
        filter: ChunkFilter,
        encode: Encode,
    ) -> Result<Self, EventFileError> {
        let width = size_of::<T>();
        let growing = group.new_dataset::<T>().shape([0usize]).chunk(&[CHUNK]).max_shape(&[None]);
        let dataset = match filter.pipeline(width) {
            Some(pipeline) => growing.filter_pipeline(pipeline),
            None => growing,
        };
        Ok(Self { dataset: dataset.create(name)?, plain: filter == ChunkFilter::None, width, encode, len: 0 })
    }

    /// Stores the next filtered chunk of `count` elements: `CHUNK`, except for the last.
    fn store(&mut self, count: usize, bytes: &[u8]) -> Result<(), EventFileError> {
        let chunk = self.len / CHUNK;
        self.len += count;
        self.dataset.extend(&[self.len])?;
        if self.plain {
            return Ok(self.dataset.write_chunk(chunk, bytes)?);
        }
        // A mask of 0: no filter of the pipeline was left out.
        Ok(self.dataset.write_chunk_raw(chunk, bytes, 0)?)
    }
}

fn bytes_of(events: &[Event], encode: Encode) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(CHUNK * size_of::<u64>());
    events.iter().for_each(|event| encode(event, &mut bytes));
    bytes
}
