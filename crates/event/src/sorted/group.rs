//! The events of one microsecond, each packed into a number that sorts.

use super::CHUNK;
use crate::{Event, EventLabel, Polarity};
use gs2e_num::units::Timestamp;

/// The events of one microsecond, each in 64 bits: row, column, polarity, label, nanoseconds.
#[derive(Debug, Default)]
pub(super) struct EventGroup {
    us: i64,
    packed: Vec<u64>,
    /// Number of events that were passed on.
    given: usize,
}

/// Number of bits of the label and of the nanoseconds below a microsecond. Both have no part in the
/// order of files.
const UNORDERED_BITS: u32 = 1 + NANO_BITS;

const NANO_BITS: u32 = 10;

impl EventGroup {
    pub(super) fn len(&self) -> usize {
        self.packed.len()
    }

    /// The microsecond of the events, if there are any.
    pub(super) fn us(&self) -> Option<i64> {
        (!self.packed.is_empty()).then_some(self.us)
    }

    pub(super) fn extend(&mut self, us: i64, events: &[Event]) {
        self.us = us;
        self.packed.extend(events.iter().map(|event| pack(us, event)));
    }

    /// Sorts the events into the order of files. Events that are equal in it keep their order.
    pub(super) fn sort(&mut self) {
        let key = |packed: &u64| packed >> UNORDERED_BITS;
        if !self.packed.is_sorted_by_key(key) {
            self.packed.sort_by_key(key);
        }
    }

    /// Appends the next events, at most `count`, to `out`. Returns true if more are left. After the
    /// last, the group is empty.
    pub(super) fn give(&mut self, count: usize, out: &mut Vec<Event>) -> bool {
        let end = self.packed.len().min(self.given + count);
        out.extend(self.packed[self.given..end].iter().map(|packed| unpack(self.us, *packed)));
        self.given = end;
        if end < self.packed.len() {
            return true;
        }
        // Groups of this size are rare, so their memory is freed.
        self.packed =
            if self.packed.capacity() > CHUNK { Vec::new() } else { std::mem::take(&mut self.packed) };
        self.packed.clear();
        self.given = 0;
        false
    }
}

fn pack(us: i64, event: &Event) -> u64 {
    // The rest below a whole microsecond: at least 0 and below 1000.
    let nanos = event.t.0.abs_diff(us * 1000);
    let place = u64::from(event.y) << 16 | u64::from(event.x);
    let kind = (event.polarity as u64) << 1 | event.label as u64;
    (place << 2 | kind) << NANO_BITS | nanos
}

fn unpack(us: i64, packed: u64) -> Event {
    let bits = |from: u32, count: u32| packed >> from & ((1 << count) - 1);
    let side = |from: u32| u16::try_from(bits(from, 16)).expect("16 bits");
    let nanos = i64::try_from(bits(0, NANO_BITS)).expect("10 bits");
    let (is_signal, is_on) = (bits(NANO_BITS, 1) == 1, bits(NANO_BITS + 1, 1) == 1);
    Event {
        t: Timestamp(us * 1000 + nanos),
        x: side(NANO_BITS + 2),
        y: side(NANO_BITS + 18),
        polarity: if is_on { Polarity::On } else { Polarity::Off },
        label: if is_signal { EventLabel::Signal } else { EventLabel::Noise },
    }
}
