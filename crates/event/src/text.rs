//! Event streams as text, one line per event: time, column, row, polarity.
//!
//! Written files have integer microseconds and say so in a comment, with the sensor size: `.txt` uses
//! spaces, `.csv` uses commas and a line of names. Files to be read may have either
//! separator, a line of names or of the sensor's two sizes, comments after `#`, and polarities 0
//! and 1 or -1 and 1. Integer times are microseconds, as in the published simulators. For times
//! with a fraction, the user must give the unit.

mod reader;
mod writer;

pub use reader::{Reader, TextTimeUnit};
pub use writer::Writer;

/// Separator of the columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnSeparator {
    /// Spaces.
    Txt,
    /// Commas.
    Csv,
}

/// Names of the columns, in the order in which they are written.
const NAMES: [&str; 4] = ["t", "x", "y", "p"];

/// Times from this on are refused: internal times are nanoseconds in 64 bits.
const END_US: i64 = i64::MAX / 1000;
