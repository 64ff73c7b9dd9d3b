//! Reading, message by message.

use super::message::{EventMessage, PacketEncoding};
use super::opcode;
use super::record::{RecordHead, RecordReader, damaged};
use super::topics::EventTopics;
use crate::evt::packet::PacketDecoder;
use crate::{Event, EventFileError, EventLabel, EventSource, Polarity, StreamHeader};
use gs2e_files as files;
use gs2e_files::budget::MAX_PER_BYTE;
use gs2e_image::Size;
use gs2e_num::units::Timestamp;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

/// Maximum size of a message of events, bytes. One in a chunk whose compressed form is large may be larger
/// in proportion.
const MAX_MESSAGE: usize = 16 << 20;

/// Bytes of events that are decoded at a time. A word of 2 bytes holds up to 12 events of 16 bytes.
const BLOCK: usize = 1 << 16;

/// Minimum number of events in a chunk, except in the last one.
const CHUNK: usize = 4096;

/// Bytes before the content of a message: channel, sequence, two times.
const MESSAGE_HEAD: u64 = 22;

/// Reads the events of one topic. Their order is not checked. Times are those of the sensor: with `evt3`
/// they count from the last overflow of its clock before the recording, with `mono` they are those of ROS.
pub struct Reader<R = File> {
    records: RecordReader<R>,
    topics: EventTopics,
    /// The message that is being decoded, and the place of its next word.
    message: Option<(PlacedMessage, usize)>,
    size: Size,
    encoding: PacketEncoding,
    decoder: PacketDecoder,
}

/// A message, its bytes, and the place to name in errors.
struct PlacedMessage {
    fields: EventMessage,
    bytes: Vec<u8>,
    at: u64,
}

impl<R> std::fmt::Debug for Reader<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader")
            .field("topics", &self.topics)
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

impl Reader {
    /// Opens a recording, and reads up to the first message of the topic. Without a `topic` the recording
    /// must have one of events only.
    ///
    /// # Errors
    /// The file is no complete MCAP file, has no such topic or several, or the first message is damaged or
    /// of another encoding.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Self, EventFileError> {
        Self::new(files::open(path)?, topic)
    }
}

impl<R: Read + Seek + Send + 'static> Reader<R> {
    /// Reads a recording up to the first message of the topic, as [`Reader::open`] does.
    ///
    /// # Errors
    /// As those of [`Reader::open`].
    pub fn new(recording: R, topic: Option<&str>) -> Result<Self, EventFileError> {
        let mut records = RecordReader::new(recording)?;
        let mut topics = EventTopics::new(topic);
        let Some(first) = next_message(&mut records, &mut topics)? else {
            return Err(EventFileError::Container(topics.explain_absence()));
        };
        let (size, encoding) = (first.fields.size, first.fields.encoding);
        if size.pixels() == 0 {
            return Err(damaged(first.at, &format!("a sensor of {size}")));
        }
        let decoder = PacketDecoder::default();
        let mut reader = Self { records, topics, message: None, size, encoding, decoder };
        reader.begin(first)?;
        Ok(reader)
    }

    /// The properties that the recording states.
    #[must_use]
    pub fn header(&self) -> StreamHeader {
        StreamHeader { size: self.size, law: None, labelled: false }
    }

    /// Begins with a message.
    fn begin(&mut self, message: PlacedMessage) -> Result<(), EventFileError> {
        let EventMessage { seq, stamp_ns, size, encoding, .. } = message.fields;
        if (size, encoding) != (self.size, self.encoding) {
            let because = format!(
                "packet {seq} has {size} pixels in {encoding:?}, those before it {} in {:?}",
                self.size, self.encoding
            );
            return Err(damaged(message.at, &because));
        }
        self.decoder.begin(seq, stamp_ns);
        let first = message.fields.events.start;
        self.message = Some((message, first));
        Ok(())
    }

    /// Decodes the next words of the present message. Returns false if it has no more.
    fn decode_block(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        let Some((message, place)) = &mut self.message else { return Ok(false) };
        let words = message.words(*place);
        let decoded = match self.encoding {
            PacketEncoding::Evt3 => self.decoder.decode(words, self.size, out),
            PacketEncoding::Mono => decode_mono(words, message.fields.time_base, self.size, out),
        };
        decoded.map_err(|(offset, because)| {
            let offset = *place + offset - message.fields.events.start;
            damaged(message.at, &format!("packet {}, byte {offset}: {because}", message.fields.seq))
        })?;
        *place += words.len();
        Ok(!words.is_empty())
    }
}

impl PlacedMessage {
    /// The words from a place on, a block at most.
    fn words(&self, place: usize) -> &[u8] {
        &self.bytes[place..self.fields.events.end.min(place + BLOCK)]
    }
}

impl<R: Read + Seek + Send + 'static> EventSource for Reader<R> {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        while out.len() < CHUNK {
            if self.decode_block(out)? {
                continue;
            }
            self.message = None;
            match next_message(&mut self.records, &mut self.topics)? {
                Some(message) => self.begin(message)?,
                None => break,
            }
        }
        Ok(!out.is_empty())
    }

    fn untimed(&self) -> u64 {
        self.decoder.untimed()
    }
}

/// The next message of the chosen topic.
fn next_message<R: Read + Seek + Send + 'static>(
    records: &mut RecordReader<R>,
    topics: &mut EventTopics,
) -> Result<Option<PlacedMessage>, EventFileError> {
    while let Some(head) = records.next()? {
        match head.opcode {
            opcode::SCHEMA => {
                let id = u16::from_le_bytes(records.bytes(head)?);
                topics.add_schema(id, &records.text(head)?);
            }
            opcode::CHANNEL => {
                let [id, schema] = [records.bytes(head)?, records.bytes(head)?].map(u16::from_le_bytes);
                let (topic, encoding) = (records.text(head)?, records.text(head)?);
                topics
                    .add_channel(id, schema, topic, &encoding)
                    .map_err(|because| damaged(head.at, &because))?;
            }
            opcode::MESSAGE => {
                let channel = u16::from_le_bytes(records.bytes(head)?);
                if topics.is_chosen(channel) {
                    return read_message(records, head).map(Some);
                }
            }
            _ => {}
        }
    }
    Ok(None)
}

/// Reads the message of the present record, whose channel was read.
fn read_message<R: Read + Seek + Send + 'static>(
    records: &mut RecordReader<R>,
    head: RecordHead,
) -> Result<PlacedMessage, EventFileError> {
    let _sequence_and_times: [u8; 20] = records.bytes(head)?;
    let stored = usize::try_from(head.stored).unwrap_or(usize::MAX);
    let limit = MAX_MESSAGE.max(stored.saturating_mul(MAX_PER_BYTE)) as u64;
    // These bytes have been read, so the record is at least as long.
    let length = head.length - MESSAGE_HEAD;
    if length > limit {
        let because = format!("a message of {length} bytes, wanted at most {limit}");
        return Err(damaged(head.at, &because));
    }
    let bytes = records.rest(head)?;
    let fields = EventMessage::parse(&bytes).map_err(|because| damaged(head.at, &because))?;
    Ok(PlacedMessage { fields, bytes, at: head.at })
}

/// Decodes `mono`: one event per 8 bytes. The error has the offset of the event.
fn decode_mono(
    words: &[u8],
    time_base: u64,
    size: Size,
    out: &mut Vec<Event>,
) -> Result<(), (usize, String)> {
    let (words, _) = words.as_chunks::<8>();
    for (number, word) in words.iter().enumerate() {
        let [t0, t1, t2, t3, x0, x1, y0, y1] = *word;
        let since = u32::from_le_bytes([t0, t1, t2, t3]);
        // The highest bit is the polarity, so the row has 15.
        let (x, y) = (u16::from_le_bytes([x0, x1]), u16::from_le_bytes([y0, y1 & 0x7f]));
        let t = time_base.checked_add(since.into()).and_then(|t| i64::try_from(t).ok());
        let fault = |because| (number * 8, because);
        let t = t.ok_or_else(|| fault(format!("t = {time_base} + {since} ns, wanted less than 2^63")))?;
        if u32::from(x) >= size.width || u32::from(y) >= size.height {
            return Err(fault(format!("pixel ({x}, {y}) is outside the sensor of {size}")));
        }
        let polarity = if y1 & 0x80 == 0 { Polarity::Off } else { Polarity::On };
        out.push(Event { t: Timestamp(t), x, y, polarity, label: EventLabel::Signal });
    }
    Ok(())
}
