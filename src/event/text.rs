//! Event streams as text, a line an event: time, column, row, polarity.
//!
//! What is written has integer microseconds and says so: `.txt` separates by spaces under a comment that names unit and
//! sensor, `.csv` by commas under a line of names. What is read may have either separator, a line of names or of the
//! sensor's two sizes, comments after `#`, and polarities 0 and 1 or -1 and 1. Integer times are microseconds, as the
//! published simulators write them; a time with a fraction is in a unit that only its author knows, and must be told.

mod reader;
mod writer;

pub use reader::{Reader, TimeUnit};
pub use writer::Writer;

/// What separates the columns of what is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Table {
    /// Spaces.
    Txt,
    /// Commas.
    Csv,
}

/// Names of the columns, in the order of what is written.
const NAMES: [&str; 4] = ["t", "x", "y", "p"];

/// Times at and after this are refused: internal times are nanoseconds in 64 bits.
const END_US: i64 = i64::MAX / 1000;
