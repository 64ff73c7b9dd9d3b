//! Events, the sinks that take them, and the order they have in files.

pub mod aedat4;
pub mod evt;
pub mod file;
pub mod h5;
pub mod npz;
pub mod order;
pub mod picture;
pub mod sorted;
pub mod text;

use crate::image::Size;
use crate::units::Timestamp;

/// Direction of a brightness change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Polarity {
    /// Darker; 0 in files.
    Off = 0,
    /// Brighter; 1 in files.
    On = 1,
}

/// Whether the pixel's brightness made an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(u8)]
pub enum Label {
    /// A sensor's noise; 0 in files.
    Noise = 0,
    /// A change of brightness; 1 in files. What every event of a stream without labels has.
    #[default]
    Signal = 1,
}

impl Label {
    /// The label that a file holds as this number.
    #[must_use]
    pub fn of(stored: u8) -> Option<Self> {
        match stored {
            0 => Some(Self::Noise),
            1 => Some(Self::Signal),
            _ => None,
        }
    }
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// When, in nanoseconds since the first stamp.
    pub t: Timestamp,
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Brighter or darker.
    pub polarity: Polarity,
    /// Signal or noise, where the stream has labels ([`Header::labelled`]).
    pub label: Label,
}

impl Event {
    /// The one total order of every file: `(t in us, y, x, polarity)`. It is total over what files store, so the
    /// order in which threads or tiles delivered the events cannot show.
    #[must_use]
    pub fn file_order(&self) -> (i64, u16, u16, Polarity) {
        (self.t.floor_micros(), self.y, self.x, self.polarity)
    }
}

/// Takes events in chunks, sorted by [`Event::file_order`] within and across chunks.
pub trait EventSink {
    /// Appends a chunk.
    ///
    /// # Errors
    /// When the bytes cannot be written.
    fn append(&mut self, events: &[Event]) -> std::io::Result<()>;
}

impl EventSink for Vec<Event> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.extend_from_slice(events);
        Ok(())
    }
}

/// Gives events in chunks, in the order of the file.
pub trait EventSource {
    /// Replaces `out` by the next chunk; `false`, and an empty `out`, after the last.
    ///
    /// # Errors
    /// When the file cannot be read, or holds a value that is no event.
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError>;

    /// Events so far that the file gives no time for, and that were left out.
    fn untimed(&self) -> u64 {
        0
    }
}

/// What an event file says about its stream beside the events.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// Columns and rows of the sensor.
    pub size: Size,
    /// How the stream was simulated; `None` where it was not, or nobody said.
    pub law: Option<LawStamp>,
    /// Whether its events are labelled as signal or noise.
    pub labelled: bool,
}

/// The law that a stream was simulated by, as event files carry it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawStamp {
    /// Revision of the simulating stage.
    pub version: u32,
    /// Log contrast of one ON event: a brightness factor of `exp(c_on)`.
    pub c_on: f64,
    /// Log contrast of one OFF event.
    pub c_off: f64,
}

/// Why an event file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum EventFileError {
    /// The operating system refuses.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The container around the events is damaged or of another kind.
    #[error("{0}")]
    Container(String),
    /// A dataset is missing, or is not what the format prescribes.
    #[error("dataset `{dataset}`: {because}")]
    Dataset {
        /// Its path in the file.
        dataset: &'static str,
        /// What was found and what was wanted.
        because: String,
    },
    /// A value that no event can have.
    #[error("`{dataset}`[{index}] is {found}, wanted {wanted}")]
    Value {
        /// Path of the dataset in the file.
        dataset: &'static str,
        /// Which element.
        index: u64,
        /// Its value.
        found: i128,
        /// What was wanted.
        wanted: String,
    },
    /// An event that breaks the contract of a stream.
    #[error("event {index}: {because}")]
    Order {
        /// Its number in the stream.
        index: u64,
        /// What was found and what was wanted.
        because: String,
    },
}

impl From<EventFileError> for std::io::Error {
    fn from(e: EventFileError) -> Self {
        match e {
            EventFileError::Io(e) => e,
            other => Self::new(std::io::ErrorKind::InvalidData, other),
        }
    }
}
