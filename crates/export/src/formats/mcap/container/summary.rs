//! The summary at the end of a file: schemas, channels, statistics, indexes, and where each of them begins.

use super::fields::{numbers, record, sized, text};
use super::{COMPRESSION, ChunkIndex, McapWriter, MetadataIndex};
use gs2e_event::mcap::opcode;
use std::io;

impl McapWriter {
    /// Writes the summary. The sum of the file begins with it.
    pub(super) fn write_summary(&mut self) -> io::Result<()> {
        let start = self.file.at;
        let groups: [(u8, Vec<Vec<u8>>); 5] = [
            (opcode::SCHEMA, (0..self.schemas.len()).map(|place| self.schema_record(place)).collect()),
            (opcode::CHANNEL, (0..self.channels.len()).map(|place| self.channel_record(place)).collect()),
            (opcode::STATISTICS, vec![self.statistics()]),
            (opcode::CHUNK_INDEX, self.indexes.iter().map(chunk_index).collect()),
            (opcode::METADATA_INDEX, self.metadata.iter().map(metadata_index).collect()),
        ];
        let mut offsets = Vec::new();
        for (opcode, records) in groups.iter().filter(|(_, records)| !records.is_empty()) {
            let at = self.file.at;
            records.iter().try_for_each(|record| self.file.write(record))?;
            let place = [&[*opcode][..], &numbers(&[at, self.file.at - at])].concat();
            offsets.extend(record(opcode::SUMMARY_OFFSET, &place));
        }
        let offsets_start = self.file.at;
        self.file.write(&offsets)?;
        // The sum covers the record up to the field that holds it.
        let footer = record(opcode::FOOTER, &[&numbers(&[start, offsets_start])[..], &[0; 4]].concat());
        let (summed, _) = footer.split_at(footer.len() - 4);
        self.file.write(summed)?;
        let sum = self.file.sum.clone().finalize();
        self.file.write(&sum.to_le_bytes())
    }

    fn statistics(&self) -> Vec<u8> {
        let messages: u64 = self.channels.iter().map(|channel| channel.messages).sum();
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes();
        let counts = (0..).zip(&self.channels).flat_map(|(id, channel): (u16, _)| {
            [&id.to_le_bytes()[..], &channel.messages.to_le_bytes()].concat()
        });
        let counts: Vec<u8> = counts.collect();
        let content = [
            &messages.to_le_bytes()[..],
            &super::number(self.schemas.len()).to_le_bytes(),
            &count(self.channels.len()),
            // No attachments.
            &count(0),
            &count(self.metadata.len()),
            &count(self.indexes.len()),
            &numbers(&self.span()),
            &sized(&counts),
        ];
        record(opcode::STATISTICS, &content.concat())
    }
}

fn chunk_index(index: &ChunkIndex) -> Vec<u8> {
    let places = index.messages.iter();
    let places: Vec<u8> =
        places.flat_map(|(id, at)| [&id.to_le_bytes()[..], &at.to_le_bytes()].concat()).collect();
    let content = [
        numbers(&[index.span[0], index.span[1], index.offset, index.length]),
        sized(&places),
        numbers(&[index.messages_length]),
        text(COMPRESSION),
        numbers(&[index.compressed, index.uncompressed]),
    ];
    record(opcode::CHUNK_INDEX, &content.concat())
}

fn metadata_index(index: &MetadataIndex) -> Vec<u8> {
    let place = numbers(&[index.offset, index.length]);
    record(opcode::METADATA_INDEX, &[place, text(index.name)].concat())
}
