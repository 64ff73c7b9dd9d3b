//! Event streams as text, one line per event: time, column, row, polarity.
//!
//! Written files have integer microseconds and say so in a comment, with the sensor size: `.txt` uses
//! spaces, `.csv` uses commas and a line of names. Files to be read may have either
//! separator, a line of names or of the sensor's two sizes, comments after `#`, and polarities 0
//! and 1 or -1 and 1. Integer times are microseconds, as in the published simulators. For times
//! with a fraction, the user must give the unit.
//!
//! # Examples
//! ```
//! use gs2e_event::text::{ColumnSeparator, Reader, Writer};
//! use gs2e_event::{EventSink as _, EventSource as _};
//!
//! let mut reader = Reader::new("# t x y p in us; sensor 4x3\n5 0 1 1\n".as_bytes(), None, None)?;
//! let mut events = Vec::new();
//! reader.next_chunk(&mut events)?;
//! let mut bytes = Vec::new();
//! let mut writer = Writer::new(&mut bytes, ColumnSeparator::Csv, reader.header().size)?;
//! writer.append(&events)?;
//! assert_eq!(writer.finish()?, 1);
//! assert_eq!(bytes, b"# t x y p in us; sensor 4x3\nt,x,y,p\n5,0,1,1\n");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod plain;
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
