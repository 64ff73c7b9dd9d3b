//! Counts of an event stream, taken in one pass.
//!
//! # Examples
//! ```
//! use gs2e_event::survey::EventSurvey;
//! use gs2e_event::text;
//!
//! // Five ON events.
//! let text = "# t x y p in us; sensor 4x3\n0 0 0 1\n1 0 0 1\n2 0 0 1\n3 0 0 1\n4 0 0 1\n";
//! let survey = EventSurvey::measure_stream(&mut text::Reader::new(text.as_bytes(), None, None)?)?;
//! assert_eq!((survey.events, survey.on), (5, 5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{Event, EventFileError, EventLabel, EventSource, Polarity};
use gs2e_num::units::Timestamp;

/// Counts of a stream.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EventSurvey {
    /// Number of events.
    pub events: u64,
    /// Number of ON events.
    pub on: u64,
    /// Number of events labelled as signal; all of a stream without labels.
    pub signal: u64,
    /// The earliest and the latest event; `None` without events.
    pub span: Option<(Timestamp, Timestamp)>,
    /// Number of events that are earlier than the event before them.
    pub backward: u64,
    /// Number of events for which the file has no time.
    pub untimed: u64,
}

impl EventSurvey {
    /// Reads a stream to its end.
    ///
    /// # Errors
    /// The stream cannot be read.
    pub fn measure_stream(source: &mut dyn EventSource) -> Result<Self, EventFileError> {
        let (mut found, mut chunk, mut previous) = (Self::default(), Vec::new(), None);
        while source.next_chunk(&mut chunk)? {
            found.count(&chunk, &mut previous);
        }
        found.untimed = source.untimed();
        Ok(found)
    }

    /// Counts a chunk. The sums are kept apart from `self`, where each event would wait for the one before.
    fn count(&mut self, events: &[Event], previous: &mut Option<Timestamp>) {
        let Some(start) = events.first() else { return };
        let mut before = previous.unwrap_or(start.t);
        let (mut first, mut last) = self.span.unwrap_or((start.t, start.t));
        let (mut on, mut signal, mut backward) = (0, 0, 0);
        for event in events {
            on += u64::from(event.polarity == Polarity::On);
            signal += u64::from(event.label == EventLabel::Signal);
            backward += u64::from(event.t < before);
            (first, last) = (first.min(event.t), last.max(event.t));
            before = event.t;
        }
        self.events += events.len() as u64;
        self.on += on;
        self.signal += signal;
        self.backward += backward;
        self.span = Some((first, last));
        *previous = Some(before);
    }

    /// Events per second; `None` if all events have one time.
    #[must_use]
    pub fn rate(&self) -> Option<f64> {
        let (first, last) = self.span?;
        // The difference of two stamps may exceed 64 bits.
        let seconds = (i128::from(last.0) - i128::from(first.0)) as f64 / 1e9;
        (seconds > 0.0).then(|| self.events as f64 / seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source of chunks.
    struct Chunks(Vec<Vec<Event>>);

    impl EventSource for Chunks {
        fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
            out.clear();
            let more = !self.0.is_empty();
            if more {
                out.extend(self.0.remove(0));
            }
            Ok(more)
        }
    }

    fn event(us: i64, polarity: Polarity, label: EventLabel) -> Event {
        Event { t: Timestamp::from_micros(us), x: 0, y: 0, polarity, label }
    }

    #[test]
    fn events_are_counted_across_chunks() {
        use EventLabel::{Noise, Signal};
        use Polarity::{Off, On};
        let first = vec![event(10, On, Signal), event(10, Off, Noise), event(30, On, Signal)];
        let second = vec![event(20, On, Noise), event(2_000_010, Off, Signal)];
        let found = EventSurvey::measure_stream(&mut Chunks(vec![first, second])).unwrap();
        let span = Some((Timestamp::from_micros(10), Timestamp::from_micros(2_000_010)));
        assert_eq!(found, EventSurvey { events: 5, on: 3, signal: 3, span, backward: 1, untimed: 0 });
        // Five events in two seconds.
        assert!((found.rate().unwrap() - 2.5).abs() < 1e-12);
    }

    #[test]
    fn a_stream_without_duration_has_no_rate() {
        let one = vec![event(5, Polarity::On, EventLabel::Signal)];
        assert_eq!(EventSurvey::measure_stream(&mut Chunks(vec![one])).unwrap().rate(), None);
        assert_eq!(EventSurvey::measure_stream(&mut Chunks(vec![])).unwrap().rate(), None);
    }
}
