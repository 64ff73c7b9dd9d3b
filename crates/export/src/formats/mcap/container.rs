//! Writing an MCAP file: chunks with their indexes, then a summary (mcap.dev, "MCAP Format Specification").
//!
//! One chunk is in memory at a time. The index of a chunk takes some 200 bytes until the end.

mod fields;
mod summary;

use fields::{record, text};
use gs2e_event::mcap::{CDR, MAGIC, opcode};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

/// Bytes of messages after which a chunk is complete. Viewers read whole chunks.
const CHUNK_BYTES: usize = 1 << 20;

/// Level of zstd, its own default.
const LEVEL: i32 = 3;

const COMPRESSION: &str = "zstd";

/// A file that is being written.
#[derive(Debug)]
pub(super) struct McapWriter {
    file: SummedFile,
    schemas: Vec<Schema>,
    channels: Vec<Channel>,
    chunk: Chunk,
    indexes: Vec<ChunkIndex>,
    metadata: Vec<MetadataIndex>,
}

/// A schema. Numbers begin at 1: 0 stands for none.
#[derive(Debug)]
struct Schema {
    name: &'static str,
    encoding: &'static str,
    definition: String,
}

/// A channel, and the number of its messages.
#[derive(Debug)]
struct Channel {
    schema: u16,
    topic: &'static str,
    messages: u64,
}

/// The records of a chunk that is not complete.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    /// First and last time.
    span: Option<[u64; 2]>,
    /// Time and offset of each message, by channel.
    messages: BTreeMap<u16, Vec<[u64; 2]>>,
}

/// Entry of the summary for a chunk.
#[derive(Debug)]
struct ChunkIndex {
    span: [u64; 2],
    offset: u64,
    length: u64,
    /// Offset of the index of each channel.
    messages: BTreeMap<u16, u64>,
    messages_length: u64,
    compressed: u64,
    uncompressed: u64,
}

/// Entry of the summary for a list of names and values.
#[derive(Debug)]
struct MetadataIndex {
    offset: u64,
    length: u64,
    name: &'static str,
}

/// A file with its length and the sum of its bytes so far.
#[derive(Debug)]
struct SummedFile {
    file: BufWriter<File>,
    at: u64,
    sum: crc32fast::Hasher,
}

impl SummedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.sum.update(bytes);
        self.file.write_all(bytes)
    }
}

/// Messages of a channel that was written.
#[derive(Debug)]
pub(super) struct ChannelCount {
    pub(super) topic: &'static str,
    pub(super) kind: &'static str,
    pub(super) messages: u64,
}

impl McapWriter {
    /// Creates a file.
    pub(super) fn create(path: &Path, profile: &str, library: &str) -> io::Result<Self> {
        let file = BufWriter::new(File::create_new(path)?);
        let mut file = SummedFile { file, at: 0, sum: crc32fast::Hasher::new() };
        file.write(MAGIC)?;
        file.write(&record(opcode::HEADER, &[text(profile), text(library)].concat()))?;
        let (schemas, channels, chunk) = (Vec::new(), Vec::new(), Chunk::default());
        Ok(Self { file, schemas, channels, chunk, indexes: Vec::new(), metadata: Vec::new() })
    }

    /// Writes a list of names and values.
    pub(super) fn add_metadata(&mut self, name: &'static str, values: &[(&str, String)]) -> io::Result<()> {
        let pairs: Vec<u8> =
            values.iter().flat_map(|(key, value)| [text(key), text(value)].concat()).collect();
        let bytes = record(opcode::METADATA, &[text(name), fields::sized(&pairs)].concat());
        let (offset, length) = (self.file.at, bytes.len() as u64);
        self.metadata.push(MetadataIndex { offset, length, name });
        self.file.write(&bytes)
    }

    /// Adds a channel, and its schema if it is new. Returns the number of the channel.
    pub(super) fn add_channel(
        &mut self,
        topic: &'static str,
        name: &'static str,
        encoding: &'static str,
        definition: impl FnOnce() -> String,
    ) -> u16 {
        let place = self.schemas.iter().position(|schema| schema.name == name).unwrap_or_else(|| {
            self.schemas.push(Schema { name, encoding, definition: definition() });
            let place = self.schemas.len() - 1;
            self.chunk.records.extend(self.schema_record(place));
            place
        });
        let channel = number(self.channels.len());
        self.channels.push(Channel { schema: number(place + 1), topic, messages: 0 });
        self.chunk.records.extend(self.channel_record(usize::from(channel)));
        channel
    }

    fn schema_record(&self, place: usize) -> Vec<u8> {
        let Schema { name, encoding, definition } = &self.schemas[place];
        let id = number(place + 1).to_le_bytes();
        record(opcode::SCHEMA, &[&id[..], &text(name), &text(encoding), &text(definition)].concat())
    }

    fn channel_record(&self, place: usize) -> Vec<u8> {
        let Channel { schema, topic, .. } = &self.channels[place];
        let ids = [number(place).to_le_bytes(), schema.to_le_bytes()];
        // Without metadata.
        let end = [text(topic), text(CDR), fields::sized(&[])].concat();
        record(opcode::CHANNEL, &[ids.as_flattened(), &end].concat())
    }

    /// Writes a message at a time, ns. Times may not go back.
    pub(super) fn write_message(&mut self, channel: u16, t_ns: u64, message: &[u8]) -> io::Result<()> {
        let Channel { messages, .. } = &mut self.channels[usize::from(channel)];
        // Readers use it to see gaps, so a turn of 32 bits does no harm.
        let [a, b, c, d, ..] = messages.to_le_bytes();
        *messages += 1;
        let offset = self.chunk.records.len() as u64;
        let t = t_ns.to_le_bytes();
        let head = [&channel.to_le_bytes()[..], &[a, b, c, d], &t, &t].concat();
        self.chunk.records.extend(fields::head(opcode::MESSAGE, head.len() + message.len()));
        self.chunk.records.extend(head);
        self.chunk.records.extend(message);
        self.chunk.messages.entry(channel).or_default().push([t_ns, offset]);
        let [first, last] = self.chunk.span.unwrap_or([t_ns; 2]);
        self.chunk.span = Some([first.min(t_ns), last.max(t_ns)]);
        if self.chunk.records.len() >= CHUNK_BYTES { self.finish_chunk() } else { Ok(()) }
    }

    /// Writes the collected chunk, and an index of its messages for each channel.
    fn finish_chunk(&mut self) -> io::Result<()> {
        let Chunk { records, span, messages } = std::mem::take(&mut self.chunk);
        let Some(span) = span else { return Ok(()) };
        let stored = zstd::bulk::compress(&records, LEVEL)?;
        let uncompressed = records.len() as u64;
        let offset = self.file.at;
        let head = [
            &fields::numbers(&[span[0], span[1], uncompressed])[..],
            // The format sums the records before compression ("Chunk", field `uncompressed_crc`).
            &crc32fast::hash(&records).to_le_bytes(),
            &text(COMPRESSION),
            &(stored.len() as u64).to_le_bytes(),
        ];
        let head = head.concat();
        self.file.write(&fields::head(opcode::CHUNK, head.len() + stored.len()))?;
        self.file.write(&head)?;
        self.file.write(&stored)?;
        let end = self.file.at;
        let mut places = BTreeMap::new();
        for (channel, entries) in &messages {
            places.insert(*channel, self.file.at);
            let entries = fields::sized(&fields::numbers(entries.as_flattened()));
            self.file
                .write(&record(opcode::MESSAGE_INDEX, &[&channel.to_le_bytes()[..], &entries].concat()))?;
        }
        self.indexes.push(ChunkIndex {
            span,
            offset,
            length: end - offset,
            messages: places,
            messages_length: self.file.at - end,
            compressed: stored.len() as u64,
            uncompressed,
        });
        Ok(())
    }

    /// First and last time; 0 without messages.
    pub(super) fn span(&self) -> [u64; 2] {
        let spans = self.indexes.iter().map(|index| index.span).chain(self.chunk.span);
        spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default()
    }

    /// The channels with the numbers of their messages.
    pub(super) fn counts(&self) -> Vec<ChannelCount> {
        let kind = |channel: &Channel| self.schemas[usize::from(channel.schema) - 1].name;
        let count = |channel: &Channel| ChannelCount {
            topic: channel.topic,
            kind: kind(channel),
            messages: channel.messages,
        };
        self.channels.iter().map(count).collect()
    }

    /// Completes the file.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.finish_chunk()?;
        let sum = self.file.sum.clone().finalize();
        self.file.write(&record(opcode::DATA_END, &sum.to_le_bytes()))?;
        // The sum of the data section ends with `DataEnd`; the footer has one of the summary alone.
        self.file.sum = crc32fast::Hasher::new();
        self.write_summary()?;
        self.file.write(MAGIC)?;
        self.file.file.flush()
    }
}

/// The number of a schema or channel: there are a few.
fn number(place: usize) -> u16 {
    u16::try_from(place).expect("a recording has a few channels")
}
