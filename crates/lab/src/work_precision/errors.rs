//! Comparison of two event streams: counts, matches and times.
//!
//! Events are matched per pixel and polarity, in order, each at most once. Of two events that are
//! farther apart than the tolerance, the earlier one stays unmatched. Of two nearer events, one is
//! skipped if its successor is nearer to the other stream's event, and that event is nearer to this
//! successor than its own successor is.

use gs2e_event::{Event, EventSink};
use serde::Serialize;
use std::io;

/// Tolerances of the F1 scores, us.
pub(crate) const WITHIN_US: [i64; 3] = [10, 100, 1000];

/// Number of bits for the time of a packed event, ns: 137 s.
const TIME_BITS: u32 = 37;
/// Number of bits for its pixel.
const PIXEL_BITS: u32 = u64::BITS - TIME_BITS - 1;

/// Events of 8 bytes each: pixel, polarity and time from the highest bit down, so that their
/// numerical order is that by pixel, polarity and time.
#[derive(Debug, Clone, Default)]
pub(crate) struct CompactEvents {
    width: u64,
    events: Vec<u64>,
}

impl CompactEvents {
    /// An empty stream of a sensor with this width.
    #[must_use]
    pub(crate) fn new(width: u32) -> Self {
        Self { width: u64::from(width), events: Vec::new() }
    }

    /// All events, sorted.
    #[must_use]
    pub(crate) fn sorted(mut self) -> Vec<u64> {
        self.events.sort_unstable();
        self.events
    }

    fn pack(&self, event: &Event) -> io::Result<u64> {
        let pixel = u64::from(event.y) * self.width + u64::from(event.x);
        let t = u64::try_from(event.t.0).ok().filter(|t| t >> TIME_BITS == 0 && pixel >> PIXEL_BITS == 0);
        let t = t.ok_or_else(|| io::Error::other("a study takes 137 s and 67 million pixels at most"))?;
        Ok((pixel << 1 | event.polarity as u64) << TIME_BITS | t)
    }
}

impl EventSink for CompactEvents {
    fn append(&mut self, events: &[Event]) -> io::Result<()> {
        self.events.reserve(events.len());
        for event in events {
            let packed = self.pack(event)?;
            self.events.push(packed);
        }
        Ok(())
    }
}

/// Number of pixels with an event in a sorted stream.
#[must_use]
pub fn active_pixels(sorted: &[u64]) -> usize {
    // The bit above the time is the polarity.
    sorted.chunk_by(|a, b| a >> (TIME_BITS + 1) == b >> (TIME_BITS + 1)).count()
}

/// Errors of a stream against a reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StreamErrors {
    /// Number of events.
    pub events: usize,
    /// Number of events of the reference.
    pub reference: usize,
    /// Difference of the two numbers, relative to the reference.
    pub count: f64,
    /// Absolute differences summed over pixels and polarities, relative to the reference.
    pub miscount: f64,
    /// F1 scores of matches within 10, 100 and 1000 us.
    pub f1: [f64; 3],
    /// Median time between matched events (within 1000 us), us; `None` without matches.
    pub median_us: Option<f64>,
    /// The 99 % quantile of these times, us.
    pub p99_us: Option<f64>,
}

impl StreamErrors {
    /// Compares two sorted streams ([`CompactEvents::sorted`]).
    #[must_use]
    pub(crate) fn compare_streams(found: &[u64], reference: &[u64]) -> Self {
        let mut miscount = 0;
        let mut matched = [0; 3];
        let mut apart = Vec::with_capacity(found.len().min(reference.len()));
        for (a, b) in pixel_pairs(found, reference) {
            miscount += a.len().abs_diff(b.len());
            for (sum, within) in matched.iter_mut().zip(WITHIN_US) {
                // Times are collected at the widest tolerance only, or they would count three
                // times.
                let widest = within == WITHIN_US[2];
                *sum += match_events(a, b, within * 1000, |ns| {
                    if widest {
                        apart.push(ns)
                    }
                });
            }
        }
        let of_all = (reference.len() as f64).max(1.0);
        let both = (found.len() + reference.len()) as f64;
        Self {
            events: found.len(),
            reference: reference.len(),
            count: found.len().abs_diff(reference.len()) as f64 / of_all,
            miscount: miscount as f64 / of_all,
            f1: matched.map(|n: usize| if both > 0.0 { 2.0 * n as f64 / both } else { 1.0 }),
            median_us: nearest_rank(&mut apart, 50),
            p99_us: nearest_rank(&mut apart, 99),
        }
    }
}

/// The nearest rank at a percentage, us.
fn nearest_rank(ns: &mut [i64], percent: usize) -> Option<f64> {
    let at = (ns.len() * percent).div_ceil(100).checked_sub(1)?;
    Some(*ns.select_nth_unstable(at).1 as f64 * 1e-3)
}

/// The events of each pixel and polarity in both streams.
fn pixel_pairs<'a>(a: &'a [u64], b: &'a [u64]) -> impl Iterator<Item = (&'a [u64], &'a [u64])> {
    let group = |event: &u64| event >> TIME_BITS;
    let (mut a, mut b) = (a, b);
    std::iter::from_fn(move || {
        // Both streams are sorted, so the lower of both first groups comes next.
        let first = a.first().into_iter().chain(b.first()).map(group).min()?;
        let take = |events: &mut &'a [u64]| {
            let (own, rest) = events.split_at(events.iter().take_while(|e| group(e) == first).count());
            *events = rest;
            own
        };
        Some((take(&mut a), take(&mut b)))
    })
}

/// Number of matches of one pixel's events of one polarity, and the time of each, ns.
#[expect(clippy::cast_possible_wrap, reason = "times have 37 bits")]
fn match_events(a: &[u64], b: &[u64], within: i64, mut take: impl FnMut(i64)) -> usize {
    let apart = |i: usize, j: usize| match (a.get(i), b.get(j)) {
        // The upper bits of both are equal, so the difference is that of the times.
        (Some(a), Some(b)) => (*a as i64 - *b as i64).abs(),
        _ => i64::MAX,
    };
    let (mut i, mut j, mut count) = (0, 0, 0);
    while i < a.len() && j < b.len() {
        let here = apart(i, j);
        // Skipping an event pays only if the successor is nearer from both sides.
        let pass_a = apart(i + 1, j) < here && apart(i + 1, j) < apart(i + 1, j + 1);
        let pass_b = apart(i, j + 1) < here && apart(i, j + 1) < apart(i + 1, j + 1);
        let (step_a, step_b) = match (here <= within, a[i] < b[j]) {
            (true, _) if pass_a => (1, 0),
            (true, _) if pass_b => (0, 1),
            (true, _) => {
                take(here);
                count += 1;
                (1, 1)
            }
            (false, true) => (1, 0),
            (false, false) => (0, 1),
        };
        (i, j) = (i + step_a, j + step_b);
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::{EventLabel, Polarity};
    use gs2e_num::units::Timestamp;

    fn packed(events: &[(u16, i64, Polarity)]) -> Vec<u64> {
        let mut sink = CompactEvents::new(4);
        let events: Vec<Event> = events
            .iter()
            .map(|(pixel, us, polarity)| Event {
                t: Timestamp::from_micros(*us),
                x: pixel % 4,
                y: pixel / 4,
                polarity: *polarity,
                label: EventLabel::Signal,
            })
            .collect();
        sink.append(&events).unwrap();
        sink.sorted()
    }

    const ON: Polarity = Polarity::On;
    const OFF: Polarity = Polarity::Off;

    #[test]
    fn planted_errors_are_counted() {
        let reference =
            packed(&[(0, 100, ON), (0, 5000, ON), (5, 100, OFF), (5, 9000, OFF), (6, 1, ON), (7, 700, ON)]);
        // Late by 8 us; by 80; of the other polarity; early by 800; missing; one more.
        let found = packed(&[
            (0, 108, ON),
            (0, 5080, ON),
            (5, 100, ON),
            (5, 8200, OFF),
            (7, 700, ON),
            (7, 9_999, ON),
            (11, 3, OFF),
        ]);
        let errors = StreamErrors::compare_streams(&found, &reference);
        assert_eq!((errors.events, errors.reference), (7, 6));
        // One OFF less and one ON more at 5; 6 lacks one; 7 and 11 have one more each.
        assert!((errors.miscount - 5.0 / 6.0).abs() < 1e-12 && (errors.count - 1.0 / 6.0).abs() < 1e-12);
        let f1 = [2, 3, 4].map(|matched| f64::from(2 * matched) / 13.0);
        assert!(errors.f1.iter().zip(f1).all(|(a, b)| (a - b).abs() < 1e-12), "{errors:?}");
        // 0, 8, 80 and 800 us.
        assert_eq!((errors.median_us, errors.p99_us), (Some(8.0), Some(800.0)));
        assert_eq!(active_pixels(&found), 4);
        let same = StreamErrors::compare_streams(&reference, &reference);
        assert_eq!((same.miscount, same.f1, same.p99_us), (0.0, [1.0; 3], Some(0.0)));
    }

    /// A train of events 300 us apart without its third: the others keep their partners.
    #[test]
    fn a_missing_event_does_not_shift_the_matches_after_it() {
        let train = |skip: i64, late: i64| -> Vec<(u16, i64, Polarity)> {
            (0..20).filter(|k| *k != skip).map(|k| (3, 1000 + 300 * k + late, ON)).collect()
        };
        let errors = StreamErrors::compare_streams(&packed(&train(2, 20)), &packed(&train(-1, 0)));
        assert_eq!((errors.median_us, errors.p99_us), (Some(20.0), Some(20.0)), "{errors:?}");
        let other = StreamErrors::compare_streams(&packed(&train(-1, 0)), &packed(&train(2, 20)));
        assert_eq!(other.p99_us, Some(20.0), "{other:?}");
    }

    #[test]
    fn nothing_is_without_error() {
        let errors = StreamErrors::compare_streams(&[], &[]);
        assert_eq!((errors.count, errors.f1, errors.median_us), (0.0, [1.0; 3], None));
    }
}
