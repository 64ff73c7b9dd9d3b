//! Event streams as HDF5 in the layout of DSEC (Gehrig et al., RA-L 2021; GitHub uzh-rpg/DSEC), readable by any HDF5
//! library, as it is written by default without a plug-in.
//!
//! | path | type | content |
//! |---|---|---|
//! | `events/x`, `events/y` | u16 | column and row |
//! | `events/p` | u8 | 1 brighter, 0 darker |
//! | `events/label` | u8 | 1 signal, 0 noise; only where the stream has labels |
//! | `events/t` | u32 | microseconds since `t_offset`, non-decreasing |
//! | `ms_to_idx` | u64 | entry `k`: number of the first event with `t >= 1000 k` |
//! | `t_offset` | i64 | microseconds, 0 unless the stream has times that 32 bits do not hold |
//! | attributes of the root | | `width`, `height`, `law_version` (u32), `c_on`, `c_off` (f64) |
//!
//! `ms_to_idx` reaches one entry past the last millisecond, so that DSEC's slicer reaches the tail: its length is
//! `floor(t_end / 1000) + 2`, with `t_end` the later of the last event and the last stamp.
//!
//! Noise are events that the pixel's brightness did not make: those of hot pixels and shot noise, and those of whose
//! threshold brightness has gone less than half since the pixel's event before (`sensor/label.rs` has the whole).
//!
//! All columns are chunked by 65,536 elements, and shuffled and deflated unless another [`Filter`] is asked for. The file
//! is of the oldest kind (superblock 0, symbol tables, B-tree indices), which every HDF5 reader knows, and holds no time
//! of its writing: equal streams are equal bytes.

mod attributes;
mod filter;
mod index;
mod outside;
mod reader;
mod writer;

pub use filter::{Filter, FilterError};
pub use reader::Reader;
pub use writer::Writer;

use rust_hdf5::Hdf5Error;

use super::EventFileError;

const X: &str = "events/x";
const Y: &str = "events/y";
const P: &str = "events/p";
const T: &str = "events/t";
const LABEL: &str = "events/label";
const MS_TO_IDX: &str = "ms_to_idx";
const T_OFFSET: &str = "t_offset";

/// Elements of a chunk.
const CHUNK: usize = 65_536;

/// Times are u32.
const END_US: i64 = 1 << 32;

/// How a file is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Options {
    /// How chunks are stored.
    pub filter: Filter,
    /// What the times of the file count from, in microseconds.
    pub t_offset_us: i64,
}

impl Options {
    /// The same for a stream from `first_us` to `last_us`: its times count from 0 where 32 bits hold them, since some
    /// readers know no offset, and else from its first stamp, as in DSEC.
    #[must_use]
    pub fn spanning(self, first_us: i64, last_us: i64) -> Self {
        let held = 0..END_US;
        let absolute = held.contains(&first_us) && held.contains(&last_us);
        Self { t_offset_us: if absolute { 0 } else { first_us }, ..self }
    }
}

/// The offsets that leave the times room in nanoseconds.
const OFFSETS_US: std::ops::RangeInclusive<i64> = i64::MIN / 1000 + 1..=i64::MAX / 1000 - END_US;

impl From<Hdf5Error> for EventFileError {
    fn from(e: Hdf5Error) -> Self {
        match e {
            Hdf5Error::Io(e) => Self::Io(e),
            other => Self::Container(other.to_string()),
        }
    }
}
