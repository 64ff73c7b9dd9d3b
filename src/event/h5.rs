//! Event streams as HDF5 in the layout of DSEC (Gehrig et al., RA-L 2021; GitHub uzh-rpg/DSEC), readable by any HDF5
//! library without a plug-in.
//!
//! | path | type | content |
//! |---|---|---|
//! | `events/x`, `events/y` | u16 | column and row |
//! | `events/p` | u8 | 1 brighter, 0 darker |
//! | `events/t` | u32 | microseconds since the first stamp, non-decreasing |
//! | `ms_to_idx` | u64 | entry `k`: number of the first event with `t >= 1000 k` |
//! | `t_offset` | i64 | 0 |
//! | attributes of the root | | `width`, `height`, `law_version` (u32), `c_on`, `c_off` (f64) |
//!
//! `ms_to_idx` reaches one entry past the last millisecond, so that DSEC's slicer reaches the tail: its length is
//! `floor(t_end / 1000) + 2`, with `t_end` the later of the last event and the last stamp.
//!
//! All columns are chunked by 65,536 elements, shuffled and deflated. The file is of the oldest kind (superblock 0,
//! symbol tables, B-tree indices), which every HDF5 reader knows, and holds no time: equal streams are equal bytes.

mod attributes;
mod index;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::Writer;

use rust_hdf5::Hdf5Error;

use super::EventFileError;

const X: &str = "events/x";
const Y: &str = "events/y";
const P: &str = "events/p";
const T: &str = "events/t";
const MS_TO_IDX: &str = "ms_to_idx";
const T_OFFSET: &str = "t_offset";

/// Elements of a chunk.
const CHUNK: usize = 65_536;

/// Times are u32.
const END_US: i64 = 1 << 32;

impl From<Hdf5Error> for EventFileError {
    fn from(e: Hdf5Error) -> Self {
        match e {
            Hdf5Error::Io(e) => Self::Io(e),
            other => Self::Container(other.to_string()),
        }
    }
}
