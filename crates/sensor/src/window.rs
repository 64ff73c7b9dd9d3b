//! Sorts the events of consecutive windows of time into file order.
//!
//! Windows may end inside a microsecond, and files are also sorted within a microsecond. Events in
//! the last, incomplete microsecond of a window therefore wait for the next window.

use gs2e_event::{Event, EventLabel, EventSink, Polarity};
use gs2e_num::units::Timestamp;

/// An event as one number that sorts in file order and then by nanoseconds: microseconds since the
/// window's first (highest bits), row (16 bits), column (16 bits), then a number below [`REST`]
/// made of polarity, nanoseconds in the microsecond, and label. The label is last, so it does not
/// change the order of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PackedEvent(u64);

/// Longest window, ns. Its events fit [`PackedEvent`], including the partial microseconds at both
/// ends.
pub(super) const MAX_WINDOW_NS: i64 = 1000 << 20;

/// Two polarities, 1000 nanoseconds, two labels.
const REST: u64 = 4000;
/// Factor of the polarity in the rest. The last bit is the label.
const POLARITY: u64 = 2000;
/// Factor of a microsecond: rows, columns and the rest.
const MICRO: u64 = REST << 32;

// A window of the longest kind may begin and end inside microseconds, so it can touch one more.
const _: () = assert!(u64::MAX / MICRO > MAX_WINDOW_NS.cast_unsigned() / 1000 + 1);

impl PackedEvent {
    /// An event `ns` nanoseconds after the start of the window's first microsecond.
    pub(super) fn new(ns: u64, [x, y]: [u16; 2], polarity: Polarity, label: EventLabel) -> Self {
        let (us, rest) = (ns / 1000, ns % 1000);
        debug_assert!(us < u64::MAX / MICRO, "an event {ns} ns after the window's start is within it");
        let place = us << 32 | u64::from(y) << 16 | u64::from(x);
        Self(place * REST + polarity as u64 * POLARITY + (rest << 1 | label as u64))
    }

    fn micros(self) -> i64 {
        (self.0 / MICRO).cast_signed()
    }

    /// Microsecond, row and column of the event.
    fn place(self) -> u64 {
        self.0 / REST
    }

    #[expect(clippy::cast_possible_truncation, reason = "fields of 16 bits")]
    fn event(self, first_us: i64) -> Event {
        let (place, rest) = (self.place(), self.0 % REST);
        Event {
            t: Timestamp((first_us + self.micros()) * 1000 + ((rest % POLARITY) >> 1).cast_signed()),
            x: place as u16,
            y: (place >> 16) as u16,
            polarity: if rest >= POLARITY { Polarity::On } else { Polarity::Off },
            label: if self.0 & 1 == 1 { EventLabel::Signal } else { EventLabel::Noise },
        }
    }
}

/// The events of the open window, and those that wait for it to end.
#[derive(Debug, Default)]
pub(super) struct EventWindow {
    /// First microsecond of the open window.
    first_us: i64,
    events: Vec<PackedEvent>,
    chunk: Vec<Event>,
    sorted: Vec<PackedEvent>,
    /// Number of events per microsecond; then the place of the next event of each.
    places: Vec<u32>,
    /// Number of pairs of events of one pixel in one microsecond.
    pub(super) same_us_same_pixel: u64,
}

impl EventWindow {
    /// Adds events of the open window in any order, and leaves `events` empty.
    pub(super) fn add(&mut self, events: &mut Vec<PackedEvent>) {
        self.events.append(events);
    }

    /// Counting sort by microsecond. Within a microsecond there are few events, often already in
    /// order.
    #[expect(clippy::cast_possible_truncation, reason = "an event's microsecond has 21 bits")]
    fn sort(&mut self) {
        let Self { events, sorted, places, .. } = self;
        // Time has the highest bits of an event, so the largest event is the latest.
        let last = events.iter().max().map_or(0, |event| event.micros().cast_unsigned() as usize);
        if last > MAX_MICROS {
            return events.sort_unstable();
        }
        places.clear();
        places.resize(last + 2, 0);
        let micros = |event: &PackedEvent| event.micros().cast_unsigned() as usize;
        // Counted one place further on: after the sum, each place is the start of its microsecond.
        events.iter().for_each(|event| places[micros(event) + 1] += 1);
        for i in 1..places.len() {
            places[i] += places[i - 1];
        }
        sorted.resize(events.len(), PackedEvent(0));
        for event in &*events {
            let place = &mut places[micros(event)];
            sorted[*place as usize] = *event;
            *place += 1;
        }
        // After the placement, each place is the end of its microsecond.
        let mut start = 0;
        for end in places.iter().map(|end| *end as usize) {
            sorted[start..end].sort_unstable();
            start = end;
        }
        std::mem::swap(events, sorted);
    }

    /// Passes on the events before the microsecond `end_us`, at which the next window begins.
    pub(super) fn close(&mut self, end_us: i64, sink: &mut dyn EventSink) -> std::io::Result<()> {
        let finished = end_us - self.first_us;
        self.sort();
        let count = self.events.partition_point(|event| event.micros() < finished);
        self.same_us_same_pixel += coincident_pairs(&self.events[..count]);
        // In parts, so that the unpacked events of a large window are never in memory together.
        for part in self.events[..count].chunks(CHUNK) {
            self.chunk.clear();
            self.chunk.extend(part.iter().map(|event| event.event(self.first_us)));
            sink.append(&self.chunk)?;
        }
        self.events.drain(..count);
        // The events that wait are packed again relative to the next window.
        for event in &mut self.events {
            event.0 -= finished.cast_unsigned() * MICRO;
        }
        self.first_us = end_us;
        Ok(())
    }
}

/// Longer windows are sorted by comparison, without one counter per microsecond.
const MAX_MICROS: usize = 4096;

/// Maximum number of events passed to a sink at once.
const CHUNK: usize = 1 << 16;

/// Pairs in one microsecond and pixel: two events are one pair, three are three.
fn coincident_pairs(sorted: &[PackedEvent]) -> u64 {
    // Packed events of one place differ in polarity, nanosecond and label at most.
    let same = |a: &PackedEvent, b: &PackedEvent| a.place() == b.place();
    sorted.chunk_by(same).map(|group| (group.len() * (group.len() - 1) / 2) as u64).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(ns: i64, x: u16, y: u16, polarity: Polarity) -> Event {
        Event { t: Timestamp(ns), x, y, polarity, label: EventLabel::Signal }
    }

    /// Closes windows at these times, each with its events, and returns the events that were passed
    /// on.
    fn run(windows: &[(i64, &[Event])], end_us: i64) -> (Vec<Vec<Event>>, u64) {
        let mut state = EventWindow::default();
        let mut outputs = Vec::new();
        for &(end, events) in windows {
            let base = state.first_us * 1000;
            let ns = |e: &Event| (e.t.0 - base).cast_unsigned();
            let pack = |e: &Event| PackedEvent::new(ns(e), [e.x, e.y], e.polarity, e.label);
            state.add(&mut events.iter().map(pack).collect());
            let mut sink = Vec::new();
            state.close(end.div_euclid(1000), &mut sink).unwrap();
            outputs.push(sink);
        }
        let mut rest = Vec::new();
        state.close(end_us, &mut rest).unwrap();
        outputs.push(rest);
        (outputs, state.same_us_same_pixel)
    }

    #[test]
    fn a_window_keeps_its_unfinished_microsecond() {
        use Polarity::{Off, On};
        let [a, b, c] = [event(1_047_999, 0, 0, On), event(1_048_001, 9, 1, Off), event(1_048_570, 3, 1, On)];
        let [d, e] = [event(1_048_577, 5, 0, Off), event(2_000_000, 65_535, 65_535, On)];
        let (outputs, same) = run(&[(1 << 20, &[c, a, b]), (2 << 20, &[e, d])], 2098);
        assert_eq!(outputs, [vec![a], vec![d, c, b, e], vec![]]);
        assert_eq!(same, 0);
    }

    #[test]
    fn labels_go_along_and_order_nothing_that_files_tell_apart() {
        let at = |ns, x, label| Event { label, ..event(ns, x, 0, Polarity::On) };
        let (signal, noise) = (EventLabel::Signal, EventLabel::Noise);
        let sorted = [at(7100, 1, signal), at(7200, 1, noise), at(7100, 2, noise), at(8000, 0, signal)];
        let [a, b, c, d] = sorted;
        assert_eq!(run(&[(1 << 20, &[d, b, c, a])], 1049).0[0], sorted);
    }

    #[test]
    fn the_longest_window_holds_its_last_nanosecond() {
        // The window begins in the last nanosecond of a microsecond, so its end is farthest from
        // the start of that microsecond.
        let last = MAX_WINDOW_NS.cast_unsigned() + 999;
        let event = PackedEvent::new(last, [65_535; 2], Polarity::On, EventLabel::Signal).event(0);
        assert_eq!(event.t, Timestamp(last.cast_signed()));
    }

    #[test]
    fn pairs_in_a_microsecond_are_counted() {
        let at = |ns, x| event(ns, x, 0, Polarity::On);
        let (outputs, same) = run(&[(1 << 20, &[at(7900, 1), at(7100, 1), at(7500, 2), at(7200, 1)])], 1049);
        assert_eq!(outputs[0], [at(7100, 1), at(7200, 1), at(7900, 1), at(7500, 2)]);
        assert_eq!(same, 3);
    }
}
