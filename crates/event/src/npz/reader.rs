//! Reading: all arrays are decompressed in parallel streams.

use super::{ARRAYS, LABEL, SIZE};
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, set_labels, wrong_value};
use flate2::CrcReader;
use flate2::read::DeflateDecoder;
use gs2e_files as files;
use gs2e_image::{Size, npy};
use gs2e_num::units::Timestamp;
use npyz::NpyHeader;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use zip::{CompressionMethod, ZipArchive};

/// Number of events in a chunk.
const CHUNK: usize = 65_536;

/// Reads one stream.
///
/// It checks that the arrays are an event stream: names, types and lengths, times from 0, and
/// polarities and labels of 0 and 1. The checks measure whether the events are sorted.
#[derive(Debug)]
pub struct Reader {
    columns: [ArrayColumn; 4],
    labels: Option<ArrayColumn>,
    size: Option<Size>,
    count: u64,
    next: u64,
}

impl Reader {
    /// Opens an archive and reads the headers of its arrays.
    ///
    /// # Errors
    /// It is not a zip archive, an array is missing or of another type, or their lengths differ.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        Self::new(|| files::open(path))
    }

    /// Reads the headers of the arrays of an archive. Each call of `open` gives the archive from its begin:
    /// the arrays are read side by side, each by a reader of its own.
    ///
    /// # Errors
    /// It is not a zip archive, an array is missing or of another type, or their lengths differ.
    pub fn new<R: Read + Seek + 'static>(
        mut open: impl FnMut() -> io::Result<R>,
    ) -> Result<Self, EventFileError> {
        let mut archive = ZipArchive::new(BufReader::new(open()?))?;
        let [t, x, y, p] = ARRAYS.map(|(name, kind)| ArrayColumn::open(&mut open, &mut archive, name, kind));
        let columns = [t?, x?, y?, p?];
        let (name, kind) = LABEL;
        let labelled = archive.index_for_name(&format!("{name}.npy")).is_some();
        let labels = labelled.then(|| ArrayColumn::open(&mut open, &mut archive, name, kind)).transpose()?;
        let count = columns[0].count;
        for column in columns.iter().chain(&labels) {
            if column.count != count {
                let because = format!("{} elements, wanted {count} as in `t`", column.count);
                return Err(EventFileError::Dataset { dataset: column.name, because });
            }
        }
        let size = stored_size(&mut open, &mut archive)?;
        Ok(Self { columns, labels, size, count, next: 0 })
    }

    /// The sensor's size, if the archive states it.
    #[must_use]
    pub fn size(&self) -> Option<Size> {
        self.size
    }

    /// Number of events.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns true if the events are labelled.
    #[must_use]
    pub fn labelled(&self) -> bool {
        self.labels.is_some()
    }

    /// Compares the checksums of all arrays, after everything is read.
    fn verify(&mut self) -> Result<(), EventFileError> {
        self.columns.iter_mut().chain(&mut self.labels).try_for_each(ArrayColumn::verify)
    }

    fn decode_event(number: u64, t: [u8; 8], x: [u8; 2], y: [u8; 2], p: u8) -> Result<Event, EventFileError> {
        let t = i64::from_le_bytes(t);
        if !(0..END_US).contains(&t) {
            return Err(wrong_value("t", number, t, format!("0 to {}", END_US - 1)));
        }
        let polarity = Polarity::from_number(p).ok_or_else(|| wrong_value("p", number, p, "0 or 1"))?;
        let (x, y) = (u16::from_le_bytes(x), u16::from_le_bytes(y));
        Ok(Event { t: Timestamp::from_micros(t), x, y, polarity, label: EventLabel::Signal })
    }
}

/// The array `size`, if there is one.
fn stored_size<R: Read + Seek + 'static>(
    open: impl FnMut() -> io::Result<R>,
    archive: &mut ZipArchive<BufReader<R>>,
) -> Result<Option<Size>, EventFileError> {
    let (name, kind) = SIZE;
    if archive.index_for_name(&format!("{name}.npy")).is_none() {
        return Ok(None);
    }
    let mut column = ArrayColumn::open(open, archive, name, kind)?;
    if column.count != 2 {
        let because = format!("{} elements, wanted 2: columns and rows", column.count);
        return Err(EventFileError::Dataset { dataset: name, because });
    }
    let sides = column.read::<4>(0, 2)?;
    column.verify()?;
    let side = |i: usize| {
        let side = i32::from_le_bytes(sides[i]);
        u32::try_from(side).map_err(|_| wrong_value(name, i as u64, side, "1 to 65536"))
    };
    Ok(Some(Size { width: side(0)?, height: side(1)? }))
}

impl EventSource for Reader {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        let first = self.next;
        let count = usize::try_from(self.count - first).map_or(CHUNK, |left| left.min(CHUNK));
        if count == 0 {
            // A stream without events has no last chunk, after which the sums are compared.
            if self.count == 0 {
                self.verify()?;
            }
            return Ok(false);
        }
        let [t, x, y, p] = &mut self.columns;
        let (t, x) = (t.read::<8>(first, count)?, x.read::<2>(first, count)?);
        let (y, p) = (y.read::<2>(first, count)?, p.read::<1>(first, count)?);
        for (number, i) in (first..).zip(0..count) {
            out.push(Self::decode_event(number, t[i], x[i], y[i], p[i][0])?);
        }
        if let Some(column) = &mut self.labels {
            let labels = column.read::<1>(first, count)?.into_iter().flatten();
            set_labels(out, labels, LABEL.0, first)?;
        }
        self.next += count as u64;
        // A checksum covers a whole array, so it can be compared only after the last chunk.
        if self.next == self.count {
            self.verify()?;
        }
        Ok(true)
    }
}

/// One array, read by a reader of its own.
struct ArrayColumn {
    name: &'static str,
    count: u64,
    crc32: u32,
    data: CrcReader<Box<dyn Read>>,
}

impl std::fmt::Debug for ArrayColumn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArrayColumn")
            .field("name", &self.name)
            .field("count", &self.count)
            .finish_non_exhaustive()
    }
}

impl ArrayColumn {
    fn open<R: Read + Seek + 'static>(
        mut open: impl FnMut() -> io::Result<R>,
        archive: &mut ZipArchive<BufReader<R>>,
        name: &'static str,
        kind: &str,
    ) -> Result<Self, EventFileError> {
        let refusal = |because: String| EventFileError::Dataset { dataset: name, because };
        let entry = archive.by_name(&format!("{name}.npy")).map_err(|e| refusal(e.to_string()))?;
        let start =
            entry.data_start().ok_or_else(|| refusal("its offset in the archive is unknown".to_owned()))?;
        let (method, crc32, len) = (entry.compression(), entry.crc32(), entry.compressed_size());
        let mut file = open()?;
        file.seek(SeekFrom::Start(start))?;
        // Limited to the entry, so that a damaged stream cannot read into the next one.
        let stored = BufReader::new(file.take(len));
        let data: Box<dyn Read> = match method {
            CompressionMethod::Stored => Box::new(stored),
            CompressionMethod::Deflated => Box::new(DeflateDecoder::new(stored)),
            other => return Err(refusal(format!("compressed with {other}, wanted deflate"))),
        };
        // Around the decoder: the archive has the checksum of the plain bytes.
        let mut data = CrcReader::new(data);
        // The parser can be made to take very long, so it gets checked headers only.
        let head = npy::checked_header(&mut data).map_err(|e| refusal(e.to_string()))?;
        let header = NpyHeader::from_reader(&head[..]).map_err(|e| refusal(e.to_string()))?;
        let (found, shape) = (header.dtype().descr(), header.shape());
        match shape {
            &[count] if found == format!("'{kind}'") => Ok(Self { name, count, crc32, data }),
            _ => Err(refusal(format!(
                "an array of type {found} and shape {shape:?}, wanted type '{kind}' and one dimension"
            ))),
        }
    }

    /// The next `count` elements of `N` bytes.
    fn read<const N: usize>(&mut self, first: u64, count: usize) -> Result<Vec<[u8; N]>, EventFileError> {
        let mut elements = vec![[0; N]; count];
        match self.data.read_exact(elements.as_flattened_mut()) {
            Ok(()) => Ok(elements),
            Err(e) => {
                let because = format!("elements {first} to {} cannot be read: {e}", first + count as u64 - 1);
                Err(EventFileError::Dataset { dataset: self.name, because })
            }
        }
    }

    /// Compares the array's checksum with the archive's, after everything is read.
    fn verify(&mut self) -> Result<(), EventFileError> {
        let refusal = |because| EventFileError::Dataset { dataset: self.name, because };
        // Reads to the end of the entry: bytes after the last element are in the checksum too.
        let extra = io::copy(&mut self.data, &mut io::sink())?;
        if extra > 0 {
            return Err(refusal(format!("{extra} bytes follow its {} elements", self.count)));
        }
        match self.data.crc().sum() {
            sum if sum == self.crc32 => Ok(()),
            sum => Err(refusal(format!("its checksum is {sum:08x}, the archive says {:08x}", self.crc32))),
        }
    }
}
