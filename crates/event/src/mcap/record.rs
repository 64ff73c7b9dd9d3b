//! The records of a file in their order, those in chunks included. What a record says about lengths leads
//! to no allocation here.

use super::{MAGIC, opcode};
use crate::EventFileError;
use gs2e_files::budget::MAX_LINE;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::sync::{Arc, Mutex, PoisonError};

/// Size of the kind and the length of a record, bytes.
const HEAD: u64 = 9;

/// Largest window of a zstd stream, as a power of two: 32 MiB. Level 19 has a quarter of that.
const MAX_WINDOW: u32 = 25;

/// A file that is read at a place of its own.
struct FileAt<R> {
    file: Arc<Mutex<R>>,
    at: u64,
}

impl<R> FileAt<R> {
    /// The same file at another place.
    fn elsewhere(&self, at: u64) -> Self {
        Self { file: Arc::clone(&self.file), at }
    }
}

impl<R: Read + Seek> Read for FileAt<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        // A read that panicked has left no state but the place, which is set here.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.at))?;
        let count = file.read(out)?;
        self.at += count as u64;
        Ok(count)
    }
}

/// The records of a file.
pub(super) struct RecordReader<R> {
    length: u64,
    /// Offset of the next record outside of chunks.
    next: u64,
    /// The chunk that is being read.
    chunk: Option<OpenChunk>,
    /// The content of the present record, if it is outside of chunks.
    plain: FileAt<R>,
    /// Bytes of the present record that were not read yet.
    left: u64,
}

/// A record, with the place to name in errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordHead {
    /// Kind.
    pub(super) opcode: u8,
    /// Bytes of its content.
    pub(super) length: u64,
    /// Offset of the record, or of the chunk that holds it.
    pub(super) at: u64,
    /// Bytes in the file that stand for it: those of its chunk, if it is in one.
    pub(super) stored: u64,
}

/// A chunk.
struct OpenChunk {
    body: Box<dyn Read + Send>,
    at: u64,
    stored: u64,
    /// Bytes that were not read yet, by its own account.
    left: u64,
    /// Sum of its bytes; `None` if it states none.
    crc: Option<u32>,
    sum: crc32fast::Hasher,
}

impl<R: Read + Seek + Send + 'static> RecordReader<R> {
    /// Starts at the begin of a file, and checks that it is complete at both ends.
    pub(super) fn new(mut file: R) -> Result<Self, EventFileError> {
        let length = file.seek(SeekFrom::End(0))?;
        let plain = FileAt { file: Arc::new(Mutex::new(file)), at: MAGIC.len() as u64 };
        let edge = MAGIC.len() as u64;
        let magic = |at: u64| {
            let mut bytes = [0; MAGIC.len()];
            plain.elsewhere(at).read_exact(&mut bytes).map(|()| bytes == *MAGIC).unwrap_or(false)
        };
        if !magic(0) {
            return Err(damaged(0, "it does not begin as an MCAP file"));
        }
        if length < 2 * edge || !magic(length - edge) {
            return Err(damaged(length, "it does not end as an MCAP file does: it is truncated"));
        }
        Ok(Self { length, next: edge, chunk: None, plain, left: 0 })
    }

    /// The next record; `None` after the last one that holds data. The rest of the record before it is
    /// passed over.
    pub(super) fn next(&mut self) -> Result<Option<RecordHead>, EventFileError> {
        loop {
            let found = match &mut self.chunk {
                Some(chunk) => match chunk.next(std::mem::take(&mut self.left))? {
                    Some(head) => head,
                    None => {
                        self.chunk = None;
                        continue;
                    }
                },
                None => self.outer()?,
            };
            self.left = found.length;
            match found.opcode {
                opcode::DATA_END | opcode::FOOTER | opcode::CHUNK if self.chunk.is_some() => {
                    let because = format!("a chunk holds a record of kind {:#04x}", found.opcode);
                    return Err(damaged(found.at, &because));
                }
                opcode::DATA_END | opcode::FOOTER => return Ok(None),
                opcode::CHUNK => self.chunk = Some(self.open_chunk(found)?),
                _ => return Ok(Some(found)),
            }
        }
    }

    /// The next record outside of chunks.
    fn outer(&mut self) -> Result<RecordHead, EventFileError> {
        let at = self.next;
        let room = self.length - MAGIC.len() as u64;
        let cut = || damaged(at, "the file ends without the record of its end: it is truncated");
        let content = at.checked_add(HEAD).filter(|content| *content <= room).ok_or_else(cut)?;
        let mut head = [0; 9];
        self.plain.elsewhere(at).read_exact(&mut head)?;
        let (opcode, length) = parse_head(head);
        self.next = content.checked_add(length).filter(|end| *end <= room).ok_or_else(|| {
            damaged(at, &format!("a record of {length} bytes, and the file has {} left", room - content))
        })?;
        self.plain.at = content;
        self.left = length;
        Ok(RecordHead { opcode, length, at, stored: length })
    }

    /// Opens the chunk of the present record.
    fn open_chunk(&mut self, head: RecordHead) -> Result<OpenChunk, EventFileError> {
        let at = head.at;
        let _times: [u8; 16] = self.bytes(head)?;
        let left = u64::from_le_bytes(self.bytes(head)?);
        let crc = u32::from_le_bytes(self.bytes(head)?);
        let compression = self.text(head)?;
        let stored = u64::from_le_bytes(self.bytes(head)?);
        if stored != self.left {
            let because = format!("a chunk of {stored} bytes in a record with room for {}", self.left);
            return Err(damaged(at, &because));
        }
        let file = self.plain.elsewhere(self.plain.at);
        let body = decompressor(&compression, file.take(stored)).map_err(|e| damaged(at, &e.to_string()))?;
        // `next` passes over what is left of a record, and no record of the chunk has been begun.
        self.left = 0;
        Ok(OpenChunk {
            body,
            at,
            stored,
            left,
            // 0 means that the writer has computed no sum (MCAP's record `Chunk`).
            crc: (crc != 0).then_some(crc),
            sum: crc32fast::Hasher::new(),
        })
    }

    /// The next bytes of the present record.
    pub(super) fn bytes<const N: usize>(&mut self, head: RecordHead) -> Result<[u8; N], EventFileError> {
        let mut bytes = [0; N];
        self.left = self.left.checked_sub(N as u64).ok_or_else(|| {
            damaged(head.at, &format!("a record of kind {:#04x} ends within its fields", head.opcode))
        })?;
        match &mut self.chunk {
            Some(chunk) => chunk.read_into(&mut bytes)?,
            None => self.plain.read_exact(&mut bytes)?,
        }
        Ok(bytes)
    }

    /// The next text of the present record.
    pub(super) fn text(&mut self, head: RecordHead) -> Result<String, EventFileError> {
        let length = u64::from(u32::from_le_bytes(self.bytes(head)?));
        if length > MAX_LINE as u64 {
            let because = format!("a name of {length} bytes, wanted at most {MAX_LINE}");
            return Err(damaged(head.at, &because));
        }
        let bytes = self.take(head, length)?;
        String::from_utf8(bytes).map_err(|_| damaged(head.at, "a name that is not UTF-8"))
    }

    /// The rest of the present record.
    pub(super) fn rest(&mut self, head: RecordHead) -> Result<Vec<u8>, EventFileError> {
        self.take(head, self.left)
    }

    fn take(&mut self, head: RecordHead, length: u64) -> Result<Vec<u8>, EventFileError> {
        self.left = self.left.checked_sub(length).ok_or_else(|| {
            damaged(head.at, &format!("a record of kind {:#04x} ends within its fields", head.opcode))
        })?;
        match &mut self.chunk {
            Some(chunk) => chunk.take(length),
            None => {
                // Through `take`, not a buffer of `length` bytes: the length is a claim of the file.
                let mut bytes = Vec::new();
                self.plain.by_ref().take(length).read_to_end(&mut bytes)?;
                Ok(bytes)
            }
        }
    }
}

impl OpenChunk {
    /// Passes over `rest` bytes, and returns the next record; `None` at the end.
    fn next(&mut self, rest: u64) -> Result<Option<RecordHead>, EventFileError> {
        self.pass_over(rest)?;
        if self.left == 0 {
            let sum = self.sum.clone().finalize();
            return match self.crc {
                Some(crc) if crc != sum => {
                    Err(damaged(self.at, &format!("a chunk with the sum {sum:#010x}, wanted {crc:#010x}")))
                }
                _ => Ok(None),
            };
        }
        if self.left < HEAD {
            return Err(damaged(self.at, "a chunk ends within a record"));
        }
        let mut head = [0; 9];
        self.read_into(&mut head)?;
        let (opcode, length) = parse_head(head);
        if length > self.left {
            let because =
                format!("a record of {length} bytes in a chunk, and the chunk has {} left", self.left);
            return Err(damaged(self.at, &because));
        }
        Ok(Some(RecordHead { opcode, length, at: self.at, stored: self.stored }))
    }

    fn read_into(&mut self, out: &mut [u8]) -> Result<(), EventFileError> {
        let bytes = self.take(out.len() as u64)?;
        out.copy_from_slice(&bytes);
        Ok(())
    }

    /// The next bytes. Their number is at most that of the bytes left by the chunk's account.
    fn take(&mut self, length: u64) -> Result<Vec<u8>, EventFileError> {
        let mut bytes = Vec::new();
        let read = self.body.by_ref().take(length).read_to_end(&mut bytes);
        self.advance(read.map(|read| read as u64), length)?;
        self.sum.update(&bytes);
        Ok(bytes)
    }

    fn pass_over(&mut self, length: u64) -> Result<(), EventFileError> {
        // Read and not skipped, because the sum of the chunk covers these bytes too.
        let read = io::copy(&mut self.body.by_ref().take(length), &mut SumOnly(&mut self.sum));
        self.advance(read, length)
    }

    fn advance(&mut self, read: io::Result<u64>, wanted: u64) -> Result<(), EventFileError> {
        let read = read.map_err(|e| damaged(self.at, &format!("the chunk: {e}")))?;
        self.left = self.left.saturating_sub(read);
        if read < wanted {
            let because = format!("the chunk ends {} bytes before the length that it states", self.left);
            return Err(damaged(self.at, &because));
        }
        Ok(())
    }
}

/// Sums bytes, and keeps none.
struct SumOnly<'a>(&'a mut crc32fast::Hasher);

impl io::Write for SumOnly<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn decompressor(name: &str, stored: impl Read + Send + 'static) -> io::Result<Box<dyn Read + Send>> {
    let stored = BufReader::new(stored);
    Ok(match name {
        "" => Box::new(stored),
        "zstd" => {
            let mut decoder = zstd::Decoder::with_buffer(stored)?;
            decoder.window_log_max(MAX_WINDOW)?;
            Box::new(BufReader::new(decoder))
        }
        "lz4" => Box::new(BufReader::new(lz4_flex::frame::FrameDecoder::new(stored))),
        other => {
            let because = format!("a chunk compressed by `{other}`, wanted zstd, lz4 or nothing");
            return Err(io::Error::new(io::ErrorKind::Unsupported, because));
        }
    })
}

fn parse_head(bytes: [u8; 9]) -> (u8, u64) {
    let [opcode, length @ ..] = bytes;
    (opcode, u64::from_le_bytes(length))
}

/// A fault at an offset.
pub(super) fn damaged(at: u64, because: &str) -> EventFileError {
    EventFileError::Container(format!("byte {at}: {because}"))
}
