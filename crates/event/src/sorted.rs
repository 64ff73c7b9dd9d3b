//! Sorts the events of each microsecond into the order of files. A camera delivers them as they
//! come.
//!
//! # Examples
//! ```
//! use gs2e_event::sorted::SortedEvents;
//! use gs2e_event::{EventSource as _, text};
//!
//! // Two events of one microsecond, the lower row first.
//! let text = "# t x y p in us; sensor 4x3\n5 0 2 1\n5 0 1 1\n";
//! let mut reader = text::Reader::new(text.as_bytes(), None, None)?;
//! let mut events = Vec::new();
//! SortedEvents::new(&mut reader).next_chunk(&mut events)?;
//! assert_eq!(events.iter().map(|event| event.y).collect::<Vec<_>>(), [1, 2]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod group;

use group::EventGroup;

use super::{Event, EventFileError, EventSource};

/// Maximum number of events in one microsecond, 2^22. They wait in memory for one another, 8 bytes
/// each.
const MAX_SIMULTANEOUS: usize = 1 << 22;

/// Maximum number of waiting events that are passed on at once.
const CHUNK: usize = 65_536;

/// Sorts the events of each microsecond by [`Event::file_order`].
pub struct SortedEvents<'a> {
    source: &'a mut dyn EventSource,
    /// The source's last chunk, and the number of its events that were taken.
    chunk: Vec<Event>,
    taken: usize,
    /// The events of the last microsecond so far. More events of it may follow.
    waiting: EventGroup,
    /// True if no event of the waiting microsecond can follow.
    complete: bool,
    /// Number of events passed on.
    given: u64,
    ended: bool,
}

impl<'a> SortedEvents<'a> {
    /// Wraps a source.
    pub fn new(source: &'a mut dyn EventSource) -> Self {
        let (chunk, waiting) = (Vec::new(), EventGroup::default());
        Self { source, chunk, taken: 0, waiting, complete: false, given: 0, ended: false }
    }

    /// Takes the source's next chunk, and from it the events of the waiting microsecond.
    fn advance(&mut self) -> Result<(), EventFileError> {
        self.ended = !self.source.next_chunk(&mut self.chunk)?;
        // Before anything is taken: sorting would hide times that go back.
        self.check()?;
        self.taken = self.wait()?;
        // Times do not go back, so an event of a later microsecond completes the waiting one.
        self.complete = self.ended || self.taken < self.chunk.len();
        if self.complete {
            self.waiting.sort();
        }
        Ok(())
    }

    /// Takes the events of the waiting microsecond at the start of the chunk, and returns their
    /// number.
    fn wait(&mut self) -> Result<usize, EventFileError> {
        let Some(us) = self.waiting.us().or(self.chunk.first().map(micros)) else { return Ok(0) };
        let count = self.chunk.iter().take_while(|event| micros(event) == us).count();
        // The last microsecond of one large chunk may exceed the limit by itself.
        let room = MAX_SIMULTANEOUS.saturating_sub(self.waiting.len());
        if count > room {
            let because = format!(
                "more than {MAX_SIMULTANEOUS} events at t = {us} us, the most that can be sorted in memory; \
                 are the times in the right unit?"
            );
            return Err(EventFileError::Order { index: self.given + MAX_SIMULTANEOUS as u64, because });
        }
        self.waiting.extend(us, &self.chunk[..count]);
        Ok(count)
    }

    /// Appends the rest of the chunk to `out`, except for its last microsecond, which waits.
    fn give_rest(&mut self, out: &mut Vec<Event>) {
        let rest = &self.chunk[self.taken..];
        let last = rest.last().map(micros);
        // Times do not go back, so the last microsecond is at the end and can be searched by bisection.
        let (settled, waiting) = rest.split_at(rest.partition_point(|event| Some(micros(event)) < last));
        let first = out.len();
        out.extend_from_slice(settled);
        // One pass is enough where the chunk is sorted already.
        if !out[first..].is_sorted_by_key(Event::packed_order) {
            // Stable, so that equal events keep the order of the source.
            out[first..].sort_by_key(Event::file_order);
        }
        // These come from a single chunk, so their number is not checked here.
        last.into_iter().for_each(|us| self.waiting.extend(us, waiting));
        self.complete = false;
    }

    /// Checks that times do not go back. No order of reading could correct that.
    fn check(&self) -> Result<(), EventFileError> {
        let mut last = self.waiting.us();
        // The usual chunk, without a division per event.
        let follows = self.chunk.first().is_none_or(|first| last.is_none_or(|last| micros(first) >= last));
        if follows && self.chunk.is_sorted_by_key(|event| event.t) {
            return Ok(());
        }
        for (event, index) in self.chunk.iter().zip(self.given + self.waiting.len() as u64..) {
            let us = micros(event);
            if let Some(last) = last.filter(|last| us < *last) {
                let because = format!("t = {us} us, earlier than the previous {last} us");
                return Err(EventFileError::Order { index, because });
            }
            last = Some(us);
        }
        Ok(())
    }
}

impl std::fmt::Debug for SortedEvents<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SortedEvents").field("given", &self.given).finish_non_exhaustive()
    }
}

impl EventSource for SortedEvents<'_> {
    fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
        out.clear();
        while out.is_empty() && (self.complete || !self.ended) {
            if !self.complete {
                self.advance()?;
                continue;
            }
            // A large group is passed on in parts, so that no receiver holds it as a whole.
            if !self.waiting.give(CHUNK, out) {
                self.give_rest(out);
            }
        }
        self.given += out.len() as u64;
        Ok(!out.is_empty())
    }

    fn untimed(&self) -> u64 {
        self.source.untimed()
    }
}

fn micros(event: &Event) -> i64 {
    event.t.floor_micros()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    /// Gives chunk by chunk.
    struct Chunks(Vec<Vec<Event>>);

    impl EventSource for Chunks {
        fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
            *out = if self.0.is_empty() { Vec::new() } else { self.0.remove(0) };
            Ok(!out.is_empty())
        }
    }

    fn event(us: i64, x: u16) -> Event {
        Event { t: Timestamp::from_micros(us), x, y: 0, polarity: Polarity::On, label: EventLabel::Signal }
    }

    fn all(chunks: &[&[Event]]) -> Result<Vec<Event>, EventFileError> {
        let mut source = Chunks(chunks.iter().map(|chunk| chunk.to_vec()).collect());
        let mut sorted = SortedEvents::new(&mut source);
        let (mut events, mut chunk) = (Vec::new(), Vec::new());
        while sorted.next_chunk(&mut chunk)? {
            events.append(&mut chunk);
        }
        Ok(events)
    }

    #[test]
    fn a_microsecond_is_sorted_across_chunks() {
        let chunks: [&[Event]; 3] =
            [&[event(1, 5), event(2, 9)], &[event(2, 3)], &[event(2, 4), event(7, 0)]];
        let columns: Vec<u16> = all(&chunks).unwrap().iter().map(|e| e.x).collect();
        assert_eq!(columns, [5, 3, 4, 9, 0]);
    }

    #[test]
    fn times_that_go_back_are_named() {
        let error = all(&[&[event(1, 0), event(4, 0)], &[event(4, 1), event(3, 0)]]).unwrap_err();
        assert_eq!(error.to_string(), "event 3: t = 3 us, earlier than the previous 4 us");
        let error = all(&[&[event(4, 0)], &[event(4, 1)], &[event(3, 0)]]).unwrap_err();
        assert_eq!(error.to_string(), "event 2: t = 3 us, earlier than the previous 4 us");
    }

    /// Every field is kept. Events that are equal in the order of files stay as they came.
    #[test]
    fn events_keep_all_their_fields() {
        let (on, off) = (Polarity::On, Polarity::Off);
        let (signal, noise) = (EventLabel::Signal, EventLabel::Noise);
        let at = |ns, x, y, polarity, label| Event { t: Timestamp(ns), x, y, polarity, label };
        let [a, b, c, d] = [
            at(-1, 65_535, 65_535, on, noise),
            at(-999, 65_535, 65_535, off, signal),
            at(-1000, 0, 65_535, on, signal),
            at(-500, 0, 65_535, on, noise),
        ];
        assert_eq!(all(&[&[a], &[b, c], &[d]]).unwrap(), [c, d, b, a]);
    }

    /// More events at one time than are passed on at once, from the last pixel to the first, with
    /// other events around them.
    #[test]
    fn a_large_microsecond_goes_out_in_parts() {
        let mut events: Vec<Event> =
            (0..200_000).rev().map(|x| event(2, u16::try_from(x % 60_000).unwrap())).collect();
        events.extend([event(3, 1), event(3, 0), event(9, 0)]);
        events.insert(0, event(1, 7));
        let mut source = Chunks(events.chunks(30_000).map(<[Event]>::to_vec).collect());
        let mut sorted = SortedEvents::new(&mut source);
        let (mut found, mut chunk) = (Vec::new(), Vec::new());
        while sorted.next_chunk(&mut chunk).unwrap() {
            assert!(chunk.len() < 100_000, "{}", chunk.len());
            found.append(&mut chunk);
        }
        events.sort_by_key(Event::file_order);
        assert_eq!(found, events);
    }

    #[test]
    fn a_microsecond_has_a_limit() {
        struct Endless(u64);
        impl EventSource for Endless {
            fn next_chunk(&mut self, out: &mut Vec<Event>) -> Result<bool, EventFileError> {
                self.0 += 1;
                *out = vec![event(5, 0); 100_000];
                Ok(true)
            }
        }
        let mut endless = Endless(0);
        let error = SortedEvents::new(&mut endless).next_chunk(&mut Vec::new()).unwrap_err().to_string();
        assert!(error.starts_with("event 4194304: more than 4194304 events at t = 5 us, "), "{error}");
        assert_eq!(endless.0, 42, "it is refused by the chunk that goes beyond");
    }
}
