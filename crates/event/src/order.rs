//! The contract of a stream, verified for each chunk before any of it is written: sorted, in the
//! range of times, on the sensor.
//!
//! # Examples
//! ```
//! use gs2e_event::order::StreamOrder;
//! use gs2e_event::{Event, EventSource as _, text};
//! use gs2e_image::Size;
//!
//! let mut events: Vec<Event> = Vec::new();
//! text::Reader::new("# t x y p in us; sensor 4x3\n7 0 1 1\n5 0 1 1\n".as_bytes(), None, None)?
//!     .next_chunk(&mut events)?;
//! // The second event is earlier than the first.
//! let mut order = StreamOrder::new(Size { width: 4, height: 3 }, 1_000_000);
//! assert!(order.admit(&events).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{Event, EventFileError};
use gs2e_image::Size;

/// Times from this on are refused, us: internal times are nanoseconds in 64 bits.
pub(crate) const END_US: i64 = i64::MAX / 1000;

/// The state of a stream that is being written.
#[derive(Debug)]
pub struct StreamOrder {
    size: Size,
    end_us: i64,
    last: Option<Event>,
    count: u64,
}

impl StreamOrder {
    /// The contract of a stream on a sensor of `size`, with `0 <= t < end_us`.
    #[must_use]
    pub fn new(size: Size, end_us: i64) -> Self {
        Self { size, end_us, last: None, count: 0 }
    }

    /// Number of accepted events.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Microsecond of the last accepted event.
    #[must_use]
    pub fn last_us(&self) -> Option<i64> {
        self.last.map(|event| event.t.floor_micros())
    }

    /// Checks the next chunk.
    ///
    /// # Errors
    /// The first event that sorts before its predecessor in [`Event::file_order`], lies outside the
    /// sensor, or has a time that the file cannot hold.
    pub fn admit(&mut self, events: &[Event]) -> Result<(), EventFileError> {
        let mut last = self.last.map_or(0, |event| event.packed_order());
        let mut is_sound = true;
        // Without a branch per event: the first that is refused is looked for afterwards.
        for event in events {
            let key = event.packed_order();
            // Equal keys are in order: a pixel may make two events in one microsecond.
            is_sound &= (key >= last) & self.holds(event, event.t.floor_micros());
            last = key;
        }
        if is_sound {
            self.last = events.last().copied().or(self.last);
            self.count += events.len() as u64;
            return Ok(());
        }
        for event in events {
            let follows = self.last.is_none_or(|last| event.packed_order() >= last.packed_order());
            if !follows || !self.holds(event, event.t.floor_micros()) {
                return Err(self.refusal(event));
            }
            self.last = Some(*event);
            self.count += 1;
        }
        Ok(())
    }

    fn holds(&self, event: &Event, t_us: i64) -> bool {
        (0..self.end_us).contains(&t_us)
            & (u32::from(event.x) < self.size.width)
            & (u32::from(event.y) < self.size.height)
    }

    fn refusal(&self, event: &Event) -> EventFileError {
        let (t, y, x, p) = event.file_order();
        let because = if !(0..self.end_us).contains(&t) {
            format!("t = {t} us, wanted 0 to {}", self.end_us - 1)
        } else if self.holds(event, t) {
            // The event is sound by itself, so it conflicts with its predecessor.
            let last = self.last.expect("only an event with a predecessor can precede it");
            let (t0, y0, x0, p0) = last.file_order();
            format!(
                "(t us, y, x, polarity) = ({t}, {y}, {x}, {p:?}) follows ({t0}, {y0}, {x0}, {p0:?}); a stream is \
                 sorted in this order"
            )
        } else {
            format!("pixel ({x}, {y}) is outside the sensor of {}", self.size)
        };
        EventFileError::Order { index: self.count, because }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    #[test]
    fn a_stream_is_sorted_on_the_sensor_and_in_time() {
        let event =
            |ns, x, y| Event { t: Timestamp(ns), x, y, polarity: Polarity::On, label: EventLabel::Signal };
        let t = |second: Event, because: Option<&str>| {
            let mut order = StreamOrder::new(Size { width: 4, height: 3 }, 1 << 32);
            let result = order.admit(&[event(2_500, 2, 1), second]);
            match (result, because) {
                (Ok(()), None) => assert_eq!((order.count(), order.last_us()), (2, Some(second.t.0 / 1000))),
                (Err(e), Some(part)) => assert!(e.to_string().contains(part), "{e}"),
                (result, _) => panic!("{second:?}: {result:?}"),
            }
        };
        t(event(2_500, 2, 1), None);
        // Within one microsecond, positions define the order, not nanoseconds.
        t(event(2_100, 3, 1), None);
        t(event(2_900, 1, 1), Some("event 1: (t us, y, x, polarity) = (2, 1, 1, On) follows (2, 1, 2, On)"));
        t(event(1_999, 2, 1), Some("sorted"));
        t(event(3_000, 4, 1), Some("pixel (4, 1) is outside the sensor of 4x3"));
        t(event(3_000, 0, 3), Some("outside"));
        t(event((1 << 32) * 1000, 0, 0), Some("t = 4294967296 us, wanted 0 to 4294967295"));
        t(event(-1, 0, 0), Some("t = -1 us"));
    }
}
