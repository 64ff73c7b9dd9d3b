//! Events, the sinks that take them, and the order they have in files.

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
