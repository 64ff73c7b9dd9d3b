//! A reader of MCAP files and of messages in CDR, by their specifications and without the code of the
//! program. It checks what it reads: sums, lengths, indexes and statistics.

use std::collections::BTreeMap;
use std::path::Path;

/// A message.
#[derive(Debug, Clone)]
pub(super) struct Message {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    /// Nanoseconds.
    pub(super) log_time: i64,
    pub(super) data: Vec<u8>,
}

/// A channel with its schema: topic, type, encodings, definition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Channel {
    pub(super) topic: String,
    pub(super) kind: String,
    pub(super) schema_encoding: String,
    pub(super) message_encoding: String,
    pub(super) definition: String,
}

/// A record with its offset.
#[derive(Debug, Clone)]
pub(super) struct Record {
    pub(super) opcode: u8,
    pub(super) at: usize,
    pub(super) content: Vec<u8>,
}

/// A whole file.
pub(super) struct McapFile {
    pub(super) bytes: Vec<u8>,
    /// Records outside of chunks.
    pub(super) records: Vec<Record>,
    pub(super) channels: BTreeMap<u16, Channel>,
    all: Vec<Message>,
}

/// Fields of records and messages.
pub(super) struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    /// True for CDR, whose numbers are at multiples of their size.
    is_aligned: bool,
}

impl<'a> Fields<'a> {
    pub(super) fn record(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, is_aligned: false }
    }

    /// Fields of a message in little-endian CDR.
    pub(super) fn of(message: &'a [u8]) -> Self {
        assert_eq!(message[..4], [0, 1, 0, 0]);
        Self { bytes: &message[4..], at: 0, is_aligned: true }
    }

    fn number<const N: usize>(&mut self) -> [u8; N] {
        if self.is_aligned {
            self.at = self.at.next_multiple_of(N);
        }
        self.at += N;
        self.bytes[self.at - N..self.at].try_into().unwrap()
    }

    pub(super) fn u8(&mut self) -> u8 {
        u8::from_le_bytes(self.number())
    }

    pub(super) fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.number())
    }

    pub(super) fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.number())
    }

    pub(super) fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.number())
    }

    pub(super) fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.number())
    }

    /// A list of bytes.
    pub(super) fn list(&mut self) -> &'a [u8] {
        let length = self.u32() as usize;
        self.at += length;
        &self.bytes[self.at - length..self.at]
    }

    /// A text. In CDR a zero ends it.
    pub(super) fn text(&mut self) -> String {
        let bytes = self.list();
        let bytes = if self.is_aligned { bytes.strip_suffix(&[0]).unwrap() } else { bytes };
        String::from_utf8(bytes.to_vec()).unwrap()
    }

    /// A header with this frame; returns its time, ns.
    pub(super) fn header(&mut self, frame: &str) -> i64 {
        let [seconds, nanoseconds] = [self.u32(), self.u32()].map(i64::from);
        assert!(nanoseconds < 1_000_000_000);
        assert_eq!(self.text(), frame);
        seconds * 1_000_000_000 + nanoseconds
    }

    pub(super) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.bytes.len()
    }
}

/// The records in these bytes, which they fill.
fn records(bytes: &[u8], first: usize) -> Vec<Record> {
    let (mut at, mut found) = (0, Vec::new());
    while at < bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let content = bytes[at + 9..at + 9 + length].to_vec();
        found.push(Record { opcode: bytes[at], at: first + at, content });
        at += 9 + length;
    }
    assert_eq!(at, bytes.len());
    found
}

impl McapFile {
    pub(super) fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let magic = b"\x89MCAP0\r\n";
        assert_eq!((&bytes[..8], &bytes[bytes.len() - 8..]), (&magic[..], &magic[..]));
        let outer = records(&bytes[8..bytes.len() - 8], 8);
        let mut file = Self { bytes, records: outer, channels: BTreeMap::new(), all: Vec::new() };
        let mut schemas: BTreeMap<u16, [String; 3]> = BTreeMap::new();
        for record in file.records.clone().iter().filter(|record| record.opcode == 6) {
            for inner in records(&chunk(record), 0) {
                let mut fields = Fields::record(&inner.content);
                match inner.opcode {
                    3 => {
                        let id = fields.u16();
                        schemas.insert(id, [fields.text(), fields.text(), fields.text()]);
                    }
                    4 => {
                        let (id, schema) = (fields.u16(), fields.u16());
                        let [kind, schema_encoding, definition] = schemas[&schema].clone();
                        let (topic, message_encoding) = (fields.text(), fields.text());
                        let channel = Channel { topic, kind, schema_encoding, message_encoding, definition };
                        file.channels.insert(id, channel);
                    }
                    5 => {
                        let (channel, sequence) = (fields.u16(), fields.u32());
                        assert!(file.channels.contains_key(&channel));
                        let times = [fields.u64(), fields.u64()];
                        assert_eq!(times[0], times[1]);
                        let log_time = times[0] as i64;
                        let data = fields.rest().to_vec();
                        file.all.push(Message { channel, sequence, log_time, data });
                    }
                    other => panic!("a record of kind {other} in a chunk"),
                }
            }
        }
        file
    }

    /// The messages of a topic, in the order of the file.
    pub(super) fn messages(&self, topic: &str) -> Vec<Message> {
        let is_topic = |message: &&Message| self.channels[&message.channel].topic == topic;
        self.all.iter().filter(is_topic).cloned().collect()
    }

    pub(super) fn all(&self) -> &[Message] {
        &self.all
    }

    /// The records of a kind outside of chunks.
    pub(super) fn of_kind(&self, opcode: u8) -> Vec<&Record> {
        self.records.iter().filter(|record| record.opcode == opcode).collect()
    }

    /// Names and values of the metadata of this name.
    pub(super) fn metadata(&self, name: &str) -> BTreeMap<String, String> {
        let mut fields = Fields::record(&self.of_kind(0x0c)[0].content);
        assert_eq!(fields.text(), name);
        let mut pairs = Fields::record(fields.list());
        let mut found = BTreeMap::new();
        while !pairs.is_at_end() {
            found.insert(pairs.text(), pairs.text());
        }
        found
    }
}

/// The records of a chunk.
pub(super) fn chunk(record: &Record) -> Vec<u8> {
    let mut fields = Fields::record(&record.content);
    let _times = [fields.u64(), fields.u64()];
    let (length, sum) = (fields.u64(), fields.u32());
    assert_eq!(fields.text(), "zstd");
    assert_eq!(fields.u64() as usize, fields.rest().len());
    let bytes = zstd::decode_all(fields.rest()).unwrap();
    assert_eq!((bytes.len() as u64, crc(&bytes)), (length, sum));
    bytes
}

/// CRC-32 of ISO 3309, bit by bit.
pub(super) fn crc(bytes: &[u8]) -> u32 {
    static TABLE: std::sync::OnceLock<[u32; 256]> = std::sync::OnceLock::new();
    let table = TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            (0..8).fold(byte as u32, |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        })
    });
    !bytes.iter().fold(!0, |c, byte| table[usize::from(c as u8 ^ byte)] ^ c >> 8)
}
