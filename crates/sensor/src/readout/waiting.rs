//! The events that wait for the bus, in the order of an arbiter. No pixel has two of them.

use super::ArbiterOrder;
use gs2e_event::Event;
use std::collections::{BTreeMap, VecDeque};

/// The waiting events.
#[derive(Debug)]
pub(super) struct WaitingEvents {
    order: ArbiterOrder,
    /// Events to be read next: all of them without an arbiter, otherwise the line that was granted.
    next: VecDeque<Event>,
    /// Events of the other lines, by row and column or by column and row.
    lines: BTreeMap<u16, BTreeMap<u16, Event>>,
    /// Line that was granted last. The one after it comes first.
    granted: Option<u16>,
    count: usize,
}

impl WaitingEvents {
    pub(super) fn new(order: ArbiterOrder) -> Self {
        Self { order, next: VecDeque::new(), lines: BTreeMap::new(), granted: None, count: 0 }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    pub(super) fn push(&mut self, event: Event) {
        self.count += 1;
        let (line, place) = match self.order {
            ArbiterOrder::Rows => (event.y, event.x),
            ArbiterOrder::Columns => (event.x, event.y),
            ArbiterOrder::None => return self.next.push_back(event),
        };
        // A pixel waits with one event only, so this replaces none.
        self.lines.entry(line).or_default().insert(place, event);
    }

    /// Removes the event that is read next.
    pub(super) fn pop(&mut self) -> Option<Event> {
        if self.next.is_empty() {
            self.grant();
        }
        let event = self.next.pop_front()?;
        self.count -= 1;
        Some(event)
    }

    /// Grants the bus to the next line with events.
    fn grant(&mut self) {
        let after = self.granted.and_then(|line| line.checked_add(1)).unwrap_or(0);
        // Cyclic: behind the last line with events comes the first one again.
        let found = self.lines.range(after..).next().or_else(|| self.lines.iter().next());
        let Some(line) = found.map(|(line, _)| *line) else { return };
        self.granted = Some(line);
        self.next.extend(self.lines.remove(&line).into_iter().flat_map(BTreeMap::into_values));
    }
}
