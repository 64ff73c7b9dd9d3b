//! Reading, chunk by chunk.

use super::attributes::RootAttributes;
use super::index::MsIndex;
use super::layout::{CHUNK, LABEL, MS_TO_IDX, OFFSETS_US, P, T, T_OFFSET, X, Y};
use super::outside;
use crate::{
    Event, EventFileError, EventLabel, EventSource, LawStamp, Polarity, StreamHeader, set_labels, wrong_value,
};
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use rust_hdf5::{H5Dataset, H5File, H5Type};
use std::panic::AssertUnwindSafe;
use std::path::Path;

/// Maximum number of elements per byte of the file: zlib's ratio is below 1,032.
const MAX_PER_BYTE: u64 = 1_040;

/// Maximum number of elements read at once, and in a chunk: the library allocates a whole chunk.
const MAX_AT_ONCE: usize = 1 << 20;

/// Reads one stream.
///
/// It checks that the bytes are an event stream: the datasets, their types and lengths, and
/// polarities and labels of 0 and 1. The checks measure whether the events are sorted and on the
/// sensor.
pub struct Reader {
    header: Option<StreamHeader>,
    offset_us: i64,
    x: H5Dataset,
    y: H5Dataset,
    p: H5Dataset,
    t: H5Dataset,
    labels: Option<H5Dataset>,
    /// Width of the times.
    width: TimeWidth,
    /// The index; `None` in files of programs that do not write one.
    ms_to_idx: Option<H5Dataset>,
    count: usize,
    step: usize,
    next: usize,
}

/// Type of the times in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimeWidth {
    /// 32 bits without sign, as in DSEC and in this program's files.
    Bits32,
    /// 64 bits with sign, as other programs write them.
    Bits64,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader")
            .field("header", &self.header)
            .field("count", &self.count)
            .finish_non_exhaustive()
    }
}

/// Number of entries of an index up to the last time that 32 bits can hold, plus one.
const MAX_ENTRIES: usize = u32::MAX as usize / 1000 + 2;

impl Reader {
    /// Opens a file and reads the properties of the stream.
    ///
    /// # Errors
    /// It is not an HDF5 file, a dataset is missing or of another type, or their lengths differ.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        guard_panics(|| Self::open_unguarded(path))
    }

    fn open_unguarded(path: &Path) -> Result<Self, EventFileError> {
        let opened = files::open(path)?;
        let bytes = opened.metadata()?.len();
        // Before the library opens the file, because it follows virtual datasets at once.
        outside::refuse_virtual(opened)?;
        let file = H5File::options().no_locking().open(path)?;
        outside::refuse_links(&file, &[X, Y, P, T, LABEL, MS_TO_IDX, T_OFFSET])?;
        let (t, count, width) = open_times(&file)?;
        // The number of elements is a claim of the file, and memory is taken by it.
        if count as u64 > bytes.saturating_mul(MAX_PER_BYTE) {
            let because = format!("{count} elements, more than a file of {bytes} bytes can hold");
            return Err(EventFileError::Dataset { dataset: T, because });
        }
        let has = |wanted: &str| file.dataset_names().iter().any(|name| name == wanted);
        let labelled = has(LABEL);
        let labels = labelled.then(|| column_of_length::<u8>(&file, LABEL, count)).transpose()?;
        let reader = Self {
            header: read_header(path)?.map(|header| StreamHeader { labelled, ..header }),
            offset_us: if has(T_OFFSET) { read_offset(&file)? } else { 0 },
            x: column_of_length::<u16>(&file, X, count)?,
            y: column_of_length::<u16>(&file, Y, count)?,
            p: column_of_length::<u8>(&file, P, count)?,
            step: step_of(&t),
            t,
            labels,
            width,
            ms_to_idx: has(MS_TO_IDX)
                .then(|| open_column::<u64>(&file, MS_TO_IDX))
                .transpose()?
                .map(|of| of.0),
            count,
            next: 0,
        };
        Ok(reader)
    }

    /// The properties of the stream; `None` for a file without `width` and `height`, for example
    /// DSEC's own files.
    #[must_use]
    pub fn header(&self) -> Option<StreamHeader> {
        self.header
    }

    /// Origin of the times in the file. It is added to the times of returned events.
    #[must_use]
    pub fn offset_us(&self) -> i64 {
        self.offset_us
    }

    /// Returns true if the events are labelled.
    #[must_use]
    pub fn labelled(&self) -> bool {
        self.labels.is_some()
    }

    /// Number of events.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count as u64
    }

    /// `ms_to_idx`: entry `k` is the index of the first event with `t >= 1000 k` in the file's own
    /// times. It is not compared with the times here; see [`Reader::verify_index`].
    ///
    /// # Errors
    /// It has more entries than 32-bit times have milliseconds, or cannot be read.
    pub fn index(&self) -> Result<Vec<u64>, EventFileError> {
        let (dataset, entries) = self.index_dataset()?;
        if entries == 0 { Ok(Vec::new()) } else { read_elements(dataset, MS_TO_IDX, 0, entries) }
    }

    /// Makes the next chunk the one with event `number`; the end if there are fewer events.
    pub fn seek(&mut self, number: u64) {
        let number = usize::try_from(number).map_or(self.count, |number| number.min(self.count));
        // To the start of a step, so that each chunk is still decompressed once.
        self.next = if number == self.count { number } else { number - number % self.step };
    }

    /// `ms_to_idx`, and its length.
    fn index_dataset(&self) -> Result<(&H5Dataset, usize), EventFileError> {
        let refusal = |because| EventFileError::Dataset { dataset: MS_TO_IDX, because };
        let dataset = self.ms_to_idx.as_ref().ok_or_else(|| refusal("it is missing".to_owned()))?;
        let entries = dataset.total_elements();
        if entries > MAX_ENTRIES {
            let because =
                format!("{entries} entries, at most {MAX_ENTRIES} for times of 32 bits were wanted");
            return Err(refusal(because));
        }
        Ok((dataset, entries))
    }

    /// Compares `ms_to_idx` with its definition, in one pass over the times.
    ///
    /// # Errors
    /// The first wrong entry; or the times are not sorted, so that no index is right.
    pub fn verify_index(&self) -> Result<(), EventFileError> {
        let (dataset, entries) = self.index_dataset()?;
        let mut stored = StoredIndex { dataset, len: entries, at: 0, held: Vec::new() };
        let (mut index, mut last) = (MsIndex::default(), 0);
        for start in (0..self.count).step_by(self.step) {
            let times: Vec<u32> = read_elements(&self.t, T, start, self.step.min(self.count - start))?;
            for (number, t) in (start as u64..).zip(times) {
                if t < last {
                    // An unsorted stream has no index, so its times are the fault to name.
                    return Err(wrong_value(T, number, t, format!("at least {last}, the previous time")));
                }
                last = t;
                stored.expect(number, index.settle(t))?;
            }
        }
        stored.expect(self.count as u64, index.complete(last))?;
        // Entries beyond the definition must equal the number of events.
        let rest = (stored.len - stored.at) as u64;
        stored.expect(self.count as u64, rest)
    }

    /// Times of some events, us, in the file's own clock.
    fn times(&self, first: usize, count: usize) -> Result<Vec<i64>, EventFileError> {
        Ok(match self.width {
            TimeWidth::Bits32 => {
                read_elements::<u32>(&self.t, T, first, count)?.into_iter().map(i64::from).collect()
            }
            TimeWidth::Bits64 => read_elements(&self.t, T, first, count)?,
        })
    }

    /// The time of event `number`, from that in the file's own clock.
    fn time(&self, number: u64, t: i64) -> Result<Timestamp, EventFileError> {
        let us = self.offset_us.checked_add(t).filter(|us| OFFSETS_US.contains(us));
        let wanted = "a time that fits in 64 bits of nanoseconds";
        us.map(Timestamp::from_micros).ok_or_else(|| wrong_value(T, number, t, wanted))
    }
}

impl EventSource for Reader {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        let count = self.step.min(self.count - self.next);
        if count == 0 {
            return Ok(false);
        }
        let first = self.next;
        let (t, p) = (self.times(first, count)?, read_elements::<u8>(&self.p, P, first, count)?);
        let (x, y) = (
            read_elements::<u16>(&self.x, X, first, count)?,
            read_elements::<u16>(&self.y, Y, first, count)?,
        );
        for (number, i) in (first as u64..).zip(0..count) {
            let polarity = Polarity::from_number(p[i]);
            let polarity = polarity.ok_or_else(|| wrong_value(P, number, p[i], "0 or 1"))?;
            let t = self.time(number, t[i])?;
            out.push(Event { t, x: x[i], y: y[i], polarity, label: EventLabel::Signal });
        }
        if let Some(labels) = &self.labels {
            set_labels(out, read_elements::<u8>(labels, LABEL, first, count)?, LABEL, first as u64)?;
        }
        self.next += count;
        Ok(true)
    }
}

/// The stored `ms_to_idx`, read once.
struct StoredIndex<'a> {
    dataset: &'a H5Dataset,
    len: usize,
    at: usize,
    held: Vec<u64>,
}

impl StoredIndex<'_> {
    /// Requires that the next `entries` entries equal `value`.
    fn expect(&mut self, value: u64, entries: u64) -> Result<(), EventFileError> {
        for _ in 0..entries {
            let found = self.next()?;
            if found != value {
                return Err(wrong_value(MS_TO_IDX, self.at as u64 - 1, found, value.to_string()));
            }
        }
        Ok(())
    }

    fn next(&mut self) -> Result<u64, EventFileError> {
        if self.at == self.len {
            let because =
                format!("{} entries, wanted more: it must reach one past the last millisecond", self.len);
            return Err(EventFileError::Dataset { dataset: MS_TO_IDX, because });
        }
        let within = self.at % CHUNK;
        if within == 0 {
            self.held = read_elements(self.dataset, MS_TO_IDX, self.at, CHUNK.min(self.len - self.at))?;
        }
        self.at += 1;
        Ok(self.held[within])
    }
}

/// The times, with their number and width.
fn open_times(file: &H5File) -> Result<(H5Dataset, usize, TimeWidth), EventFileError> {
    let is_wide = file.dataset(T).is_ok_and(|t| t.datatype().is_ok_and(|found| found == i64::hdf5_type()));
    let (width, opened) = if is_wide {
        (TimeWidth::Bits64, open_column::<i64>(file, T)?)
    } else {
        (TimeWidth::Bits32, open_column::<u32>(file, T)?)
    };
    Ok((opened.0, opened.1, width))
}

/// A one-dimensional dataset of `T`, with its length.
fn open_column<T: H5Type>(file: &H5File, name: &'static str) -> Result<(H5Dataset, usize), EventFileError> {
    let refusal = |because| EventFileError::Dataset { dataset: name, because };
    let dataset = file.dataset(name).map_err(|e| refusal(e.to_string()))?;
    outside::refuse_external(&dataset, name)?;
    let (found, wanted) = (dataset.datatype()?, T::hdf5_type());
    if found != wanted {
        return Err(refusal(format!("its type is {found}, wanted {wanted}")));
    }
    let chunk = dataset.chunk_dims().unwrap_or_default().iter().fold(1, |n: usize, &d| n.saturating_mul(d));
    match *dataset.shape() {
        _ if chunk > MAX_AT_ONCE => {
            Err(refusal(format!("its chunks have {chunk} elements, wanted at most {MAX_AT_ONCE}")))
        }
        [len] => Ok((dataset, len)),
        ref shape => Err(refusal(format!("its shape is {shape:?}, wanted one dimension"))),
    }
}

fn column_of_length<T: H5Type>(
    file: &H5File,
    name: &'static str,
    wanted: usize,
) -> Result<H5Dataset, EventFileError> {
    match open_column::<T>(file, name)? {
        (dataset, len) if len == wanted => Ok(dataset),
        (_, len) => {
            let because = format!("{len} elements, wanted {wanted} as in `{T}`");
            Err(EventFileError::Dataset { dataset: name, because })
        }
    }
}

fn read_elements<T: H5Type>(
    dataset: &H5Dataset,
    name: &'static str,
    start: usize,
    count: usize,
) -> Result<Vec<T>, EventFileError> {
    guard_panics(|| {
        dataset.read_slice(&[start], &[count]).map_err(|e| EventFileError::Dataset {
            dataset: name,
            because: format!("elements {start} to {} cannot be read: {e}", start + count - 1),
        })
    })
}

/// Runs code of rust-hdf5. Version 0.7.9 panics on some damaged files (a datatype with an
/// overflowing size); the panic becomes an error.
pub(super) fn guard_panics<T>(read: impl FnOnce() -> Result<T, EventFileError>) -> Result<T, EventFileError> {
    std::panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(EventFileError::Container(
            "the HDF5 structure is damaged: the HDF5 library cannot report how".to_owned(),
        ))
    })
}

/// Whole chunks are read, so that each is decompressed once; several small ones at a time.
fn step_of(dataset: &H5Dataset) -> usize {
    match dataset.chunk_dims().as_deref() {
        Some(&[chunk]) if (1..CHUNK).contains(&chunk) => CHUNK / chunk * chunk,
        Some(&[chunk]) => chunk.clamp(1, MAX_AT_ONCE),
        _ => CHUNK,
    }
}

fn read_offset(file: &H5File) -> Result<i64, EventFileError> {
    let refusal = |because| EventFileError::Dataset { dataset: T_OFFSET, because };
    let dataset = file.dataset(T_OFFSET).map_err(|e| refusal(e.to_string()))?;
    outside::refuse_external(&dataset, T_OFFSET)?;
    match *dataset.read_raw::<i64>().map_err(|e| refusal(e.to_string()))? {
        [us] if OFFSETS_US.contains(&us) => Ok(us),
        ref found => Err(refusal(format!("{found:?}, wanted one time that fits in 64 bits of nanoseconds"))),
    }
}

fn read_header(path: &Path) -> Result<Option<StreamHeader>, EventFileError> {
    let attributes = RootAttributes::read(path)?;
    let (Some(width), Some(height)) = (attributes.value("width"), attributes.value("height")) else {
        return Ok(None);
    };
    let law = match (attributes.value("law_version"), attributes.value("c_on"), attributes.value("c_off")) {
        (Some(version), Some(c_on), Some(c_off)) => Some(LawStamp { version, c_on, c_off }),
        _ => None,
    };
    Ok(Some(StreamHeader { size: Size { width, height }, law, labelled: false }))
}
