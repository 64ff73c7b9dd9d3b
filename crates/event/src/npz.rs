//! Event streams as NumPy archives: arrays `t` (int64, us), `x`, `y` (uint16) and `p` (uint8, 1
//! brighter, 0 darker). A stream with labels also has `label` (uint8, 1 signal, 0 noise). The last array is
//! `size` (int32): columns and rows of the sensor; archives of other programs may lack it.
//!
//! Entries are deflated and have the date 1980-01-01, the first day of the zip format: equal
//! streams are equal bytes.
//!
//! # Examples
//! ```
//! use gs2e_event::npz::{Reader, SpooledColumns};
//! use gs2e_event::{EventSink as _, EventSource as _, text};
//! use std::io::Cursor;
//!
//! let mut text = text::Reader::new("# t x y p in us; sensor 4x3\n5 0 1 1\n".as_bytes(), None, None)?;
//! let (mut written, mut read) = (Vec::new(), Vec::new());
//! text.next_chunk(&mut written)?;
//! let mut columns = SpooledColumns::new(&text.header(), &std::env::temp_dir())?;
//! columns.append(&written)?;
//! let mut archive = Cursor::new(Vec::new());
//! columns.write_archive(&mut archive)?;
//! Reader::new(|| Ok(Cursor::new(archive.get_ref().clone())))?.next_chunk(&mut read)?;
//! assert_eq!(read, written);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod reader;
mod writer;

pub use reader::Reader;
pub use writer::{SpooledColumns, Writer};

use super::EventFileError;
use zip::result::ZipError;

/// Names of the arrays and their types in NumPy's notation, in the order of the archive.
const ARRAYS: [(&str, &str); 4] = [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "|u1")];

/// The last array, if the stream has labels.
const LABEL: (&str, &str) = ("label", "|u1");

/// The array with the sensor's columns and rows.
const SIZE: (&str, &str) = ("size", "<i4");

impl From<ZipError> for EventFileError {
    fn from(e: ZipError) -> Self {
        match e {
            ZipError::Io(e) => Self::Io(e),
            other => Self::Container(other.to_string()),
        }
    }
}
