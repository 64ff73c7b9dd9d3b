//! Inflating packets, into memory that serves all of them.

use super::PacketCompression;
use gs2e_files::budget;
use std::io::{self, Read};

/// Maximum size of an inflated packet, bytes: 2^20 events. A packet whose compressed form is large
/// may be larger in proportion.
const MAX_PACKET: usize = 16 << 20;

/// Size of the head of an LZ4 frame without optional fields: magic number, two bytes of properties, checksum
/// ("LZ4 frame format description", v1.6.4).
const HEAD: usize = 7;

/// The magic number.
const MAGIC: [u8; 4] = [0x04, 0x22, 0x4d, 0x18];
/// Properties: the version, and whether blocks are independent. The other bits are checksums of the content
/// and the optional fields.
const VERSION: u8 = 0x40;
/// See [`VERSION`].
const INDEPENDENT: u8 = 0x20;

/// Mark in the size of a block that is not compressed.
const UNCOMPRESSED: u32 = 1 << 31;

/// Number of bytes before a block that it may refer to, where blocks are not independent.
const WINDOW: usize = 1 << 16;

/// Inflates packets.
#[derive(Debug)]
pub(super) struct Inflater {
    compression: PacketCompression,
    /// Zeros and what is left of earlier packets follow the bytes of the last one.
    bytes: Vec<u8>,
    /// A head that the decoder of the library has accepted.
    known: Option<[u8; HEAD]>,
}

impl Inflater {
    pub(super) fn new(compression: PacketCompression) -> Self {
        Self { compression, bytes: Vec::new(), known: None }
    }

    /// The buffer in a packet.
    pub(super) fn inflate<'a>(&'a mut self, packet: &'a [u8]) -> io::Result<&'a [u8]> {
        if self.compression == PacketCompression::None {
            return Ok(packet);
        }
        let limit = MAX_PACKET.max(packet.len().saturating_mul(budget::MAX_PER_BYTE));
        let blocks = self.known.and_then(|head| inflate_blocks(packet, head, limit, &mut self.bytes));
        if let Some(length) = blocks {
            return Ok(&self.bytes[..length]);
        }
        self.bytes.clear();
        // One byte above the limit shows that there is more.
        let mut take = |from: &mut dyn Read| from.take(limit as u64 + 1).read_to_end(&mut self.bytes);
        match self.compression {
            PacketCompression::Zstd => take(&mut zstd::Decoder::new(packet)?),
            _ => take(&mut lz4_flex::frame::FrameDecoder::new(packet)),
        }?;
        if self.bytes.len() > limit {
            let because = format!(
                "it decompresses to more than {limit} bytes, the limit for a packet of {} bytes",
                packet.len()
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, because));
        }
        self.known = packet.first_chunk().copied().filter(is_plain).or(self.known);
        Ok(&self.bytes)
    }
}

/// Returns true if a head has neither checksums of the content nor optional fields.
fn is_plain(head: &[u8; HEAD]) -> bool {
    head.starts_with(&MAGIC) && head[4] & !INDEPENDENT == VERSION
}

/// Inflates the blocks of an LZ4 frame with a known head, and returns the number of bytes. The decoder of the
/// library has memory of its own for each frame, and copies the bytes once more. `None` for anything unusual,
/// which is left to that decoder: damage above all.
fn inflate_blocks(frame: &[u8], head: [u8; HEAD], limit: usize, bytes: &mut Vec<u8>) -> Option<usize> {
    let mut rest = frame.strip_prefix(&head)?;
    let [_, _, _, _, properties, size, _] = head;
    // 4 to 7 for 64 KiB to 4 MiB.
    let block_size = 1_usize << (8 + 2 * (size >> 4));
    let mut filled = 0;
    loop {
        let (word, after) = rest.split_first_chunk()?;
        let word = u32::from_le_bytes(*word);
        if word == 0 {
            return Some(filled);
        }
        let length = usize::try_from(word & !UNCOMPRESSED).ok().filter(|length| *length <= block_size)?;
        let block;
        (block, rest) = after.split_at_checked(length)?;
        if bytes.len() < filled + block_size {
            bytes.resize(filled + block_size, 0);
        }
        let (before, room) = bytes.split_at_mut(filled);
        let room = &mut room[..block_size];
        let added = if word & UNCOMPRESSED != 0 {
            room[..length].copy_from_slice(block);
            length
        } else if properties & INDEPENDENT != 0 {
            lz4_flex::block::decompress_into(block, room).ok()?
        } else {
            let window = &before[filled.saturating_sub(WINDOW)..];
            lz4_flex::block::decompress_into_with_dict(block, room, window).ok()?
        };
        filled += added;
        // The decoder of the library ends at an empty block.
        if added == 0 || filled > limit {
            return None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
    use std::io::Write as _;

    /// Bytes without repeats.
    fn noise(length: u32) -> impl Iterator<Item = u8> {
        (0..length).map(|i| i.wrapping_mul(2_654_435_769).to_be_bytes()[0])
    }

    /// Bytes with repeats near and far, up to three blocks of 64 KiB.
    fn content(length: u32) -> Vec<u8> {
        (0..length)
            .zip(noise(length))
            .flat_map(|(i, noise)| [(i / 50).to_le_bytes()[0], noise >> 6, 0])
            .collect()
    }

    fn frame(info: &FrameInfo, content: &[u8]) -> Vec<u8> {
        let mut encoder = FrameEncoder::with_frame_info(info.clone(), Vec::new());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    /// The content of a packet, by an inflater that has seen `before`.
    fn inflated(before: &[u8], packet: &[u8]) -> Result<Vec<u8>, String> {
        let mut inflater = Inflater::new(PacketCompression::Lz4);
        inflater.inflate(before).unwrap();
        inflater.inflate(packet).map(<[u8]>::to_vec).map_err(|e| e.to_string())
    }

    /// A frame of a known kind gives the same bytes, or the same error, as one of an unknown kind, whole and
    /// damaged.
    #[test]
    fn known_frames_are_inflated_like_others() {
        let plain = FrameInfo::new().block_size(BlockSize::Max64KB);
        let linked = plain.clone().block_mode(BlockMode::Linked);
        let summed = plain.clone().content_checksum(true).block_checksums(true);
        let sized = plain.clone().content_size(Some(3 * 4000));
        let large = FrameInfo::new().block_size(BlockSize::Max256KB);
        let random: Vec<u8> = noise(9000).collect();
        for info in [plain, linked, summed, sized, large] {
            let before = frame(&info, &content(4000));
            for content in [content(4000), random.clone(), content(0), content(60_000)] {
                if info.content_size.is_some_and(|size| size != content.len() as u64) {
                    continue;
                }
                let sound = frame(&info, &content);
                assert_eq!(inflated(&before, &sound).unwrap(), content, "{info:?}");
                let step = sound.len() / 150 + 1;
                for at in (0..sound.len()).filter(|at| at % step == 0 || *at < 16 || at + 6 > sound.len()) {
                    let mut flipped = sound.clone();
                    flipped[at] ^= 0x11;
                    for damaged in [&sound[..at], &flipped] {
                        assert_eq!(inflated(&before, damaged), inflated(&[], damaged), "{info:?} {at}");
                    }
                }
            }
        }
    }
}
