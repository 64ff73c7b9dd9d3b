//! Chunks as a file stores them.

use super::ChunkFilter;
use super::layout::CHUNK;
use rust_hdf5::format::messages::filter::{
    FILTER_DEFLATE, FILTER_LZ4, FILTER_SHUFFLE, FILTER_ZSTD, FLAG_OPTIONAL, Filter as Stage, FilterPipeline,
};
use std::io;
use zlib_rs::{DeflateConfig, ReturnCode};

/// Block size of LZ4, bytes: the filter's default, which no chunk here exceeds.
const LZ4_BLOCK: u32 = 1 << 30;

impl ChunkFilter {
    /// The filter's parameters in the file, for elements of `width` bytes; `None` without a filter.
    pub(super) fn pipeline(self, width: usize) -> Option<FilterPipeline> {
        let stage = |id, cd_values| Stage { id, flags: FLAG_OPTIONAL, cd_values };
        let compressor = match self {
            Self::None => return None,
            Self::Gzip(level) => stage(FILTER_DEFLATE, vec![level]),
            Self::Zstd(level) => stage(FILTER_ZSTD, vec![level]),
            Self::Lz4 => stage(FILTER_LZ4, vec![LZ4_BLOCK]),
        };
        let width = u32::try_from(width).expect("elements are a few bytes");
        Some(FilterPipeline { filters: vec![stage(FILTER_SHUFFLE, vec![width]), compressor] })
    }

    /// The stored form of a chunk of little-endian elements of `width` bytes, padded with zeros to
    /// a whole chunk, as the format requires.
    pub(super) fn apply(self, bytes: &[u8], width: usize) -> io::Result<Vec<u8>> {
        match self {
            Self::None => {
                let mut whole = bytes.to_vec();
                whole.resize(CHUNK * width, 0);
                Ok(whole)
            }
            Self::Gzip(level) => Ok(deflate_bytes(&shuffle_bytes(bytes, width), level)),
            Self::Zstd(level) => {
                let level = i32::try_from(level).expect("levels are small");
                zstd::bulk::compress(&shuffle_bytes(bytes, width), level)
            }
            Self::Lz4 => Ok(lz4_block(&shuffle_bytes(bytes, width))),
        }
    }
}

fn shuffle_bytes(bytes: &[u8], width: usize) -> Vec<u8> {
    // Zeros in the places of missing elements pad the last chunk.
    let mut shuffled = vec![0; CHUNK * width];
    for (i, element) in bytes.chunks_exact(width).enumerate() {
        for (k, &byte) in element.iter().enumerate() {
            shuffled[k * CHUNK + i] = byte;
        }
    }
    shuffled
}

/// A stream of zlib. `zlib-rs` makes it in 0.56 of the time of `miniz_oxide`, 3 % smaller, and the same on
/// every processor.
fn deflate_bytes(bytes: &[u8], level: u32) -> Vec<u8> {
    let level = i32::try_from(level).expect("levels are small");
    let mut out = vec![0; zlib_rs::compress_bound(bytes.len())];
    let (stream, code) = zlib_rs::compress_slice(&mut out, bytes, DeflateConfig::new(level));
    assert_eq!(code, ReturnCode::Ok, "a deflated chunk fits the bound on its size");
    let length = stream.len();
    out.truncate(length);
    out
}

/// One block in the layout of the registered filter: total length, block length, stored length (big
/// endian), and the block, which is stored plain if it does not shrink.
fn lz4_block(bytes: &[u8]) -> Vec<u8> {
    let len = u32::try_from(bytes.len()).expect("a chunk is small");
    let packed = lz4_flex::block::compress(bytes);
    let block = if packed.len() < bytes.len() { &packed } else { bytes };
    let stored = u32::try_from(block.len()).expect("a chunk is small");
    let mut out = Vec::with_capacity(16 + block.len());
    out.extend(u64::from(len).to_be_bytes());
    out.extend(len.to_be_bytes());
    out.extend(stored.to_be_bytes());
    out.extend(block);
    out
}
