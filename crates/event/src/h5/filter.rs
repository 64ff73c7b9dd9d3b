//! Filters of chunks.
//!
//! Every filter except `none` is a shuffle (all first bytes of the elements, all second bytes, …)
//! followed by a compressor. Every HDF5 library has deflate. Zstandard (registered filter 32015)
//! and LZ4 (32004) need the plug-ins in Python's `hdf5plugin` and Debian's `hdf5-plugin-*`.

use std::fmt;
use std::str::FromStr;

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
