//! Filters of chunks.
//!
//! Every filter except `none` is a shuffle (all first bytes of the elements, all second bytes, …)
//! followed by a compressor. Every HDF5 library has deflate. Zstandard (registered filter 32015)
//! and LZ4 (32004) need the plug-ins in Python's `hdf5plugin` and Debian's `hdf5-plugin-*`.

use super::CHUNK;
use flate2::{Compress, Compression, FlushCompress, Status};
use rust_hdf5::format::messages::filter::{
    FILTER_DEFLATE, FILTER_LZ4, FILTER_SHUFFLE, FILTER_ZSTD, FLAG_OPTIONAL, Filter as Stage, FilterPipeline,
};
use std::fmt;
use std::io;
use std::str::FromStr;

/// Block size of LZ4, bytes: the filter's default, which no chunk here exceeds.
const LZ4_BLOCK: u32 = 1 << 30;

/// The filter of a file's chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChunkFilter {
    /// None: plain bytes.
    None,
    /// Deflate of this level, 0 to 9.
    Gzip(u32),
    /// Zstandard of this level, 1 to 19.
    Zstd(u32),
    /// LZ4, which has no levels here.
    Lz4,
}

impl Default for ChunkFilter {
    /// Readable by any HDF5 library, at a level where more time gains little.
    fn default() -> Self {
        Self::Gzip(4)
    }
}

impl fmt::Display for ChunkFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Gzip(level) => write!(f, "gzip:{level}"),
            Self::Zstd(level) => write!(f, "zstd:{level}"),
            Self::Lz4 => f.write_str("lz4"),
        }
    }
}

/// The reason why a text is not a [`ChunkFilter`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found `{0}`, wanted gzip[:0-9], zstd[:1-19], lz4 or none")]
pub struct FilterError(String);

impl FromStr for ChunkFilter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, level) = text.split_once(':').map_or((text, None), |(name, level)| (name, Some(level)));
        let level = |default: u32, range: std::ops::RangeInclusive<u32>| match level {
            None => Some(default),
            Some(level) => level.parse().ok().filter(|level| range.contains(level)),
        };
        let alone = |filter| (!text.contains(':')).then_some(filter);
        let found = match name {
            "gzip" => level(4, 0..=9).map(Self::Gzip),
            "zstd" => level(3, 1..=19).map(Self::Zstd),
            "lz4" => alone(Self::Lz4),
            "none" => alone(Self::None),
            _ => None,
        };
        found.ok_or_else(|| FilterError(text.to_owned()))
    }
}

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

fn deflate_bytes(bytes: &[u8], level: u32) -> Vec<u8> {
    // A stored block of zlib adds 5 bytes per 16 KiB or more, and 6 bytes per stream.
    let mut out = Vec::with_capacity(bytes.len() + bytes.len() / 1024 + 64);
    let status =
        Compress::new(Compression::new(level), true).compress_vec(bytes, &mut out, FlushCompress::Finish);
    assert!(matches!(status, Ok(Status::StreamEnd)), "a deflated chunk fits the bound on its size");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for text in ["none", "lz4", "gzip:0", "gzip:9", "zstd:1", "zstd:19"] {
            assert_eq!(text.parse::<ChunkFilter>().map(|filter| filter.to_string()), Ok(text.to_owned()));
        }
        assert_eq!("gzip".parse(), Ok(ChunkFilter::default()));
        assert_eq!("zstd".parse(), Ok(ChunkFilter::Zstd(3)));
        for text in ["", "blosc", "gzip:10", "gzip:", "zstd:0", "zstd:20", "lz4:1", "none:0", "gzip:-1"] {
            assert!(text.parse::<ChunkFilter>().is_err(), "{text}");
        }
    }
}
