//! Event streams as Prophesee's raw files: a header of lines that begin with `%`, then words of 32
//! (EVT 2.0) or 16 bits (EVT 3.0), little-endian (Metavision SDK documentation, "RAW file format",
//! "EVT 2.0", "EVT 3.0").
//!
//! Both encode a time by its changed parts, so a reader keeps the other parts. Events before the
//! first complete time of a recording have no time; they are dropped and counted.
//!
//! # Examples
//! ```
//! use gs2e_event::evt::{EvtVersion, Reader, Writer};
//! use gs2e_event::{Event, EventLabel, EventSink as _, EventSource as _, Polarity};
//! use gs2e_image::Size;
//! use gs2e_num::units::Timestamp;
//!
//! let t = Timestamp::from_micros(20);
//! let event = Event { t, x: 3, y: 1, polarity: Polarity::On, label: EventLabel::Signal };
//! let mut bytes = Vec::new();
//! let mut writer = Writer::new(&mut bytes, EvtVersion::Evt3, Size { width: 4, height: 3 })?;
//! writer.append(&[event])?;
//! writer.finish()?;
//! let mut events = Vec::new();
//! Reader::new(&bytes[..])?.next_chunk(&mut events)?;
//! assert_eq!(events, [event]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
