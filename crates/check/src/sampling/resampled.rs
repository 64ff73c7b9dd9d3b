//! Some intervals of a stream with its frames and with twice as many, event by event.

use gs2e_event::{Event, Polarity};
use serde::{Deserialize, Serialize};

/// The comparison of some intervals of a stream with twice the frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResampledIntervals {
    /// Number of intervals.
    pub intervals: usize,
    /// Number of events in them, in one row of four.
    pub events: u64,
    /// Number of events with twice the frames.
    pub at_twice: u64,
    /// Number of events of the same pixel and polarity in both, paired in order.
    pub paired: u64,
    /// Median time between the two events of a pair, us; `None` without pairs.
    pub shift_us: Option<f64>,
    /// The error between frames that the recipe allows, in thresholds, if it states one.
    pub tolerance: Option<f64>,
}

impl ResampledIntervals {
    /// Pairs the events of each pixel and polarity in their order.
    #[must_use]
    pub fn pair_events(intervals: usize, events: Vec<Event>, at_twice: Vec<Event>) -> Self {
        let key = |e: &Event| (e.y, e.x, e.polarity == Polarity::Off);
        let counts = [&events, &at_twice].map(|events| events.len() as u64);
        let [first, second] = [events, at_twice].map(|mut events| {
            events.sort_by_key(|e| (key(e), e.t));
            events
        });
        let (groups, mut others) = (first.chunk_by(|a, b| key(a) == key(b)), &second[..]);
        let mut shifts_ns = Vec::new();
        for group in groups {
            // Groups and events are in the order of one key, so the search never goes back.
            let start = others.partition_point(|e| key(e) < key(&group[0]));
            let alike = others[start..].iter().take_while(|e| key(e) == key(&group[0]));
            shifts_ns.extend(group.iter().zip(alike).map(|(a, b)| a.t.0.abs_diff(b.t.0)));
            others = &others[start..];
        }
        shifts_ns.sort_unstable();
        let shift_us = shifts_ns.get(shifts_ns.len() / 2).map(|ns| *ns as f64 * 1e-3);
        let paired = shifts_ns.len() as u64;
        Self { intervals, events: counts[0], at_twice: counts[1], paired, shift_us, tolerance: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::EventLabel;
    use gs2e_num::units::Timestamp;

    fn event(t_us: i64, x: u16, polarity: Polarity) -> Event {
        Event { t: Timestamp::from_micros(t_us), x, y: 0, polarity, label: EventLabel::Signal }
    }

    #[test]
    fn events_are_paired_within_pixel_and_polarity() {
        use Polarity::{Off, On};
        let few = vec![event(10, 3, On), event(50, 3, On), event(20, 1, Off), event(30, 9, On)];
        let more =
            vec![event(14, 3, On), event(60, 3, On), event(70, 3, On), event(20, 1, On), event(33, 9, On)];
        let found = ResampledIntervals::pair_events(4, few, more);
        // 3 ON: 10 with 14, 50 with 60; 9 ON: 30 with 33; the OFF of 1 has no partner. Sorted: 3,
        // 4, 10.
        let wanted = ResampledIntervals {
            intervals: 4,
            events: 4,
            at_twice: 5,
            paired: 3,
            shift_us: Some(4.0),
            tolerance: None,
        };
        assert_eq!(found, wanted);
        assert_eq!(ResampledIntervals::pair_events(1, Vec::new(), Vec::new()).shift_us, None);
    }
}
