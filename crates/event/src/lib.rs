//! Events, their sinks, and their order in files.
//!
//! # Examples
//! ```
//! use gs2e_event::{Event, EventSource as _, Polarity, text};
//!
//! let csv = "# t x y p in us; sensor 4x3\n5 0 1 1\n7 3 2 0\n";
//! let mut reader = text::Reader::new(csv.as_bytes(), None, None)?;
//! let mut events: Vec<Event> = Vec::new();
//! assert!(reader.next_chunk(&mut events)?);
//! assert_eq!(events.len(), 2);
//! assert_eq!((events[1].x, events[1].y, events[1].polarity), (3, 2, Polarity::Off));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod aedat4;
pub mod evt;
pub mod file;
pub mod h5;
pub mod mcap;
pub mod npz;
pub mod order;
pub mod picture;
pub mod sorted;
pub mod survey;
pub mod text;

use gs2e_image::Size;
use gs2e_num::units::Timestamp;

/// Direction of a brightness change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Polarity {
    /// Darker; 0 in files.
    Off = 0,
    /// Brighter; 1 in files.
    On = 1,
}

impl Polarity {
    /// The polarity for a number in a file.
    #[must_use]
    pub fn from_number(stored: u8) -> Option<Self> {
        [Self::Off, Self::On].get(usize::from(stored)).copied()
    }
}

/// The cause of an event, where events are labelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(u8)]
pub enum EventLabel {
    /// Noise of the sensor; 0 in files.
    Noise = 0,
    /// A change of brightness; 1 in files. All events of a stream without labels have this label.
    #[default]
    Signal = 1,
}

impl EventLabel {
    /// The label for a number in a file.
    #[must_use]
    pub fn from_number(stored: u8) -> Option<Self> {
        [Self::Noise, Self::Signal].get(usize::from(stored)).copied()
    }
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Time, in nanoseconds since the first stamp.
    pub t: Timestamp,
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Polarity.
    pub polarity: Polarity,
    /// Signal or noise, if the stream has labels ([`StreamHeader::labelled`]).
    pub label: EventLabel,
}

impl Event {
    /// The total order of all files: `(t in us, y, x, polarity)`. It covers everything that files
    /// store, so the order in which threads or tiles delivered the events has no effect.
    #[must_use]
    #[inline]
    pub fn file_order(&self) -> (i64, u16, u16, Polarity) {
        (self.t.floor_micros(), self.y, self.x, self.polarity)
    }

    /// [`Event::file_order`] as one number, which is compared without branches.
    #[inline]
    pub(crate) fn packed_order(&self) -> u128 {
        // Flipping the sign moves negative times before the others.
        let t_us = (self.t.floor_micros() ^ i64::MIN).cast_unsigned();
        let place = u64::from(self.y) << 32 | u64::from(self.x) << 16 | self.polarity as u64;
        u128::from(t_us) << 64 | u128::from(place)
    }
}

/// Takes events in chunks, sorted by [`Event::file_order`] within and between chunks.
pub trait EventSink {
    /// Appends a chunk.
    ///
    /// # Errors
    /// The bytes cannot be written.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()>;
}

impl EventSink for Vec<Event> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.extend_from_slice(events);
        Ok(())
    }
}

/// Yields events in chunks, in the order of the file.
pub trait EventSource {
    /// Replaces `out` by the next chunk. Returns `false`, with an empty `out`, after the last.
    ///
    /// # Errors
    /// The file cannot be read, or has a value that no event can have.
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError>;

    /// Number of events so far that were dropped because the file has no time for them.
    fn untimed(&self) -> u64 {
        0
    }
}

/// Properties of a stream that an event file states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamHeader {
    /// Columns and rows of the sensor.
    pub size: Size,
    /// The simulation of the stream; `None` if it was not simulated, or the file does not say.
    pub law: Option<LawStamp>,
    /// True if its events are labelled as signal or noise.
    pub labelled: bool,
}

/// The simulation law of a stream, as stored in event files.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawStamp {
    /// Revision of the simulating stage.
    pub version: u32,
    /// Log contrast of one ON event: a brightness factor of `exp(c_on)`.
    pub c_on: f64,
    /// Log contrast of one OFF event.
    pub c_off: f64,
}

/// The reason why an event file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum EventFileError {
    /// An error of the operating system.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The container of the events is damaged, or of another kind.
    #[error("{0}")]
    Container(String),
    /// A dataset is missing, or differs from the format.
    #[error("dataset `{dataset}`: {because}")]
    Dataset {
        /// Its path in the file.
        dataset: &'static str,
        /// The value found and the value wanted.
        because: String,
    },
    /// A value that no event can have.
    #[error("`{dataset}`[{index}] is {found}, wanted {wanted}")]
    Value {
        /// Path of the dataset in the file.
        dataset: &'static str,
        /// Index of the element.
        index: u64,
        /// Its value.
        found: i128,
        /// The value wanted.
        wanted: String,
    },
    /// An event that violates the contract of a stream.
    #[error("event {index}: {because}")]
    Order {
        /// Its index in the stream.
        index: u64,
        /// The value found and the value wanted.
        because: String,
    },
}

/// The error for a value that no event can have.
pub(crate) fn wrong_value(
    dataset: &'static str,
    index: u64,
    found: impl Into<i128>,
    wanted: impl Into<String>,
) -> EventFileError {
    EventFileError::Value { dataset, index, found: found.into(), wanted: wanted.into() }
}

/// Sets the labels of events from the numbers in a dataset, from index `first` on.
pub(crate) fn set_labels(
    events: &mut [Event],
    stored: impl IntoIterator<Item = u8>,
    dataset: &'static str,
    first: u64,
) -> Result<(), EventFileError> {
    for ((number, event), stored) in (first..).zip(events).zip(stored) {
        let label = EventLabel::from_number(stored);
        event.label = label.ok_or_else(|| wrong_value(dataset, number, stored, "0 or 1"))?;
    }
    Ok(())
}

impl From<EventFileError> for std::io::Error {
    fn from(e: EventFileError) -> Self {
        match e {
            EventFileError::Io(e) => e,
            other => Self::new(std::io::ErrorKind::InvalidData, other),
        }
    }
}
