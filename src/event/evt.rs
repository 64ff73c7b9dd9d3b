//! Event streams as Prophesee's raw files: a header of lines that begin with `%`, then words of 32 (EVT 2.0) or 16 bits
//! (EVT 3.0), little-endian (Metavision SDK documentation, "RAW file format", "EVT 2.0", "EVT 3.0").
//!
//! Both code a time by the parts of it that change, so that a reader keeps the rest. Events before the first full time
//! of a recording have none: they are left out, and counted.

mod evt2;
mod evt3;
mod header;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::Writer;

/// Which of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// 32-bit words, one an event.
    Evt2,
    /// 16-bit words; rows, times and runs of pixels are shared by events.
    Evt3,
}

/// Columns and rows have 11 bits.
const EDGE: u32 = 1 << 11;

/// Times at and after this are refused: internal times are nanoseconds in 64 bits.
const END_US: i64 = i64::MAX / 1000;
