//! Event streams as Prophesee's raw files: a header of lines that begin with `%`, then words of 32
//! (EVT 2.0) or 16 bits (EVT 3.0), little-endian (Metavision SDK documentation, "RAW file format",
//! "EVT 2.0", "EVT 3.0").
//!
//! Both encode a time by its changed parts, so a reader keeps the other parts. Events before the
//! first complete time of a recording have no time; they are dropped and counted.

mod evt2;
mod evt3;
mod header;
pub mod packet;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::Writer;

/// The version of the format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EvtVersion {
    /// 32-bit words, one per event.
    Evt2,
    /// 16-bit words; events share rows, times and runs of pixels.
    Evt3,
}

/// Columns and rows have 11 bits.
const EDGE: u32 = 1 << 11;

/// Times from this on are refused: internal times are nanoseconds in 64 bits.
const END_US: i64 = i64::MAX / 1000;
