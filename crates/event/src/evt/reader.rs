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

/// Number of words that are looked at together.
pub(super) const GROUP: usize = 8;

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
    /// The last bytes that were read. Their memory serves all reads.
    block: Vec<u8>,
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

    /// Takes the first words that are usual, and returns their number: events on the sensor, and what hardly
    /// changes the state. It is fast, and may take fewer than it could.
    fn take_usual(&mut self, words: &[u8], found: &mut DecodedWords<'_>) -> usize;

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

    /// Returns true if the sensor has this pixel.
    #[inline]
    pub(super) fn has(&self, x: u16, y: u16) -> bool {
        (u32::from(x) < self.size.width) & (u32::from(y) < self.size.height)
    }

    /// The last column and row.
    pub(super) fn last_pixel(&self) -> [u32; 2] {
        [self.size.width - 1, self.size.height - 1]
    }

    /// Adds events without a check.
    #[inline]
    pub(super) fn extend(&mut self, events: &[Event]) {
        self.events.extend_from_slice(events);
    }

    /// Adds events without a check, one by one.
    #[inline]
    pub(super) fn extend_with(&mut self, events: impl Iterator<Item = Event>) {
        self.events.extend(events);
    }

    /// Adds an event if it is on the sensor and in the range of times.
    pub(super) fn push(&mut self, t_us: i64, [x, y]: [u16; 2], polarity: Polarity) -> Result<(), String> {
        if !self.has(x, y) {
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
        // Blocks are larger than the buffer, and pass it by.
        Self::new(BufReader::new(files::open(path)?))
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
            block: Vec::with_capacity(BLOCK),
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
            let block = &mut self.block;
            block.clear();
            self.input.by_ref().take(BLOCK as u64).read_to_end(block)?;
            if block.is_empty() {
                return Ok(false);
            }
            let mut found = DecodedWords::new(out, self.header.size);
            match &mut self.state {
                WordState::Evt2(state) => decode_words(state, block, self.offset, &mut found),
                WordState::Evt3(state) => decode_words(state, block, self.offset, &mut found),
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
    let (count, rest) = (block.len() / D::BYTES, block.len() % D::BYTES);
    let at = |word: usize| offset + (word * D::BYTES) as u64;
    let mut number = 0;
    while number < count {
        number += decoder.take_usual(&block[number * D::BYTES..], found);
        // As many as are looked at together: one of them was not usual.
        let words = block[number * D::BYTES..].chunks_exact(D::BYTES).take(GROUP);
        for (word, number) in words.zip(number..) {
            decoder
                .take(word, found)
                .map_err(|because| EventFileError::Container(format!("byte {}: {because}", at(number))))?;
        }
        number += GROUP;
    }
    if rest > 0 {
        let because =
            format!("byte {}: {rest} bytes of a {}-byte word: the file is truncated", at(count), D::BYTES);
        return Err(EventFileError::Container(because));
    }
    Ok(())
}
