//! Reading, word by word.

use super::{EvtVersion, evt2, evt3, header};
use crate::order::END_US;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::fs::File;
use std::io::{BufRead, BufReader, Read as _};
use std::path::Path;

/// Number of bytes read at a time.
const BLOCK: usize = 1 << 18;

/// Reads one stream. Its order is not checked.
#[derive(Debug)]
pub struct Reader<R = BufReader<File>> {
    input: R,
    header: StreamHeader,
    state: WordState,
    /// Offset of the next word.
    offset: u64,
    untimed: u64,
}

#[derive(Debug)]
enum WordState {
    Evt2(evt2::Evt2Decoder),
    Evt3(evt3::Evt3Decoder),
}

/// Decodes words into events.
pub(super) trait WordDecoder {
    /// Size of a word, bytes.
    const BYTES: usize;

    /// Takes the next word. The error says what is wrong with it.
    fn take(&mut self, word: &[u8], found: &mut DecodedWords<'_>) -> Result<(), String>;
}

/// The decoded events.
pub(super) struct DecodedWords<'a> {
    events: &'a mut Vec<Event>,
    size: Size,
    /// Number of events before the first complete time or row.
    pub(super) untimed: u64,
}

impl<'a> DecodedWords<'a> {
    /// Decoded events go to `events`; those of a sensor of `size` are accepted.
    pub(super) fn new(events: &'a mut Vec<Event>, size: Size) -> Self {
        Self { events, size, untimed: 0 }
    }

    /// Adds an event if it is on the sensor and in the range of times.
    pub(super) fn push(&mut self, t_us: i64, [x, y]: [u16; 2], polarity: Polarity) -> Result<(), String> {
        if u32::from(x) >= self.size.width || u32::from(y) >= self.size.height {
            return Err(format!("pixel ({x}, {y}) is outside the sensor of {}", self.size));
        }
        if t_us >= END_US {
            return Err(format!("t = {t_us} us, wanted less than {END_US}"));
        }
        self.events.push(Event {
            t: Timestamp::from_micros(t_us),
            x,
            y,
            polarity,
            label: EventLabel::Signal,
        });
        Ok(())
    }
}

impl Reader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// The header does not name one of the two formats and the sensor size.
    pub fn open(path: &Path) -> Result<Self, EventFileError> {
        Self::new(BufReader::with_capacity(BLOCK, files::open(path)?))
    }
}

impl<R: BufRead> Reader<R> {
    /// Reads the header of a stream.
    ///
    /// # Errors
    /// The header does not name one of the two formats and the sensor size.
    pub fn new(mut input: R) -> Result<Self, EventFileError> {
        let (version, size, offset) = header::read_header(&mut input)?;
        let state = match version {
            EvtVersion::Evt2 => WordState::Evt2(evt2::Evt2Decoder::default()),
            EvtVersion::Evt3 => WordState::Evt3(evt3::Evt3Decoder::default()),
        };
        Ok(Self {
            input,
            header: StreamHeader { size, law: None, labelled: false },
            state,
            offset,
            untimed: 0,
        })
    }

    /// The properties that the file states.
    #[must_use]
    pub fn header(&self) -> StreamHeader {
        self.header
    }
}

impl<R: BufRead> EventSource for Reader<R> {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        // A block of time words has no events, so reading goes on until there is one.
        while out.is_empty() {
            // Blocks are full except at the end of the file, and a multiple of both sizes of words.
            // Only the last word of a file can be cut off.
            let mut block = Vec::with_capacity(BLOCK);
            self.input.by_ref().take(BLOCK as u64).read_to_end(&mut block)?;
            if block.is_empty() {
                return Ok(false);
            }
            let mut found = DecodedWords::new(out, self.header.size);
            match &mut self.state {
                WordState::Evt2(state) => decode_words(state, &block, self.offset, &mut found),
                WordState::Evt3(state) => decode_words(state, &block, self.offset, &mut found),
            }?;
            self.untimed += found.untimed;
            self.offset += block.len() as u64;
        }
        Ok(true)
    }

    fn untimed(&self) -> u64 {
        self.untimed
    }
}

fn decode_words<D: WordDecoder>(
    decoder: &mut D,
    block: &[u8],
    offset: u64,
    found: &mut DecodedWords<'_>,
) -> Result<(), EventFileError> {
    let words = block.chunks_exact(D::BYTES);
    let at = |word: usize| offset + (word * D::BYTES) as u64;
    let rest = words.remainder().len();
    let count = words.len();
    for (number, word) in words.enumerate() {
        decoder
            .take(word, found)
            .map_err(|because| EventFileError::Container(format!("byte {}: {because}", at(number))))?;
    }
    if rest > 0 {
        let because =
            format!("byte {}: {rest} bytes of a {}-byte word: the file is truncated", at(count), D::BYTES);
        return Err(EventFileError::Container(because));
    }
    Ok(())
}
