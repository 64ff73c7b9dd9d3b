//! Readout: the bus between the pixels and the stream, which passes on a limited number of events per
//! second.
//!
//! A pixel with an event requests the bus, and makes no other event until it is read: a further
//! event of a waiting pixel is lost. Events are stamped when they are read, as in sensors whose
//! stamps are made after the arbiter. Sources:
//!
//! - Lichtsteiner, Posch, Delbruck, IEEE JSSC 43, 2008: the pixel's request and acknowledge, and
//!   its reset after the acknowledgement.
//! - Brandli et al., IEEE JSSC 49, 2014 (DAVIS240) and Taverni et al., IEEE TCAS-II 65, 2018
//!   (DAVIS346): a row is arbitrated, and the events of this row are read in a burst. 12 million
//!   events per second is the figure that is quoted for the DAVIS346.
//! - Finateu et al., ISSCC 2020 (the Prophesee generation of the IMX636): rows again, and an event
//!   rate controller that drops events above a limit. A `queue` bounds the waiting events.
//!
//! The bus is a clock: in a busy period from `t0`, event `n` leaves at `t0 + ceil(n / rate)`, in
//! nanoseconds. Real arbiters need longer for a row with one event than for one of many in a burst;
//! one rate stands for both.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::Size;
//! # use gs2e_num::seed::Seed;
//! # use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//! # use gs2e_sensor::{SensorSettings, esim::EsimModel, simulate_one};
//! # use std::ops::ControlFlow::Continue;
//! use gs2e_sensor::readout::{ArbiterOrder, ReadoutBus};
//!
//! let bus = ReadoutBus { rate_mev_s: 1.0, arbiter: ArbiterOrder::Rows, queue: None };
//! let settings = SensorSettings { readout: Some(bus), ..SensorSettings::default() };
//! let model = EsimModel { settings, ..EsimModel::default() };
//! // 64 pixels brighten together: all events of a threshold are made at one time.
//! let samples = ArraySamples::Bytes([[50; 64], [100; 64]].concat());
//! let mut frames = ArrayFrames::new(Size { width: 8, height: 8 }, samples, &[0, 1000])?;
//! let mut events = Vec::new();
//! let account = simulate_one(&mut frames, &model, Seed(1), &mut events, &mut |_| Continue(()))?;
//! let counts = account.readout.ok_or("there is no bus")?;
//! assert_eq!((counts.made, counts.kept + counts.lost()), (3 * 64, 3 * 64));
//! // A million events per second are one per microsecond.
//! assert!(events.windows(2).all(|pair| pair[1].t.0 - pair[0].t.0 >= 1000));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod waiting;

use super::SimulationAccount;
use super::chain::{EventFilter, PassedEvents, PixelArray};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink};
use serde::{Deserialize, Serialize};
use std::io;
use waiting::WaitingEvents;

/// A bus of limited rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReadoutBus {
    /// Largest number of events, millions per second; above 0.
    pub rate_mev_s: f64,
    /// Order in which waiting events are read.
    pub arbiter: ArbiterOrder,
    /// Largest number of waiting events; further ones are lost. `None`: one per pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub queue: Option<u64>,
}

/// Order in which waiting events are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ArbiterOrder {
    /// Row after row, cyclically; the events that wait in a row are read together.
    #[default]
    Rows,
    /// Column after column, likewise.
    Columns,
    /// In the order of the events.
    None,
}

/// Counts of a readout. `kept` and the three kinds of lost events sum to `made`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReadoutAccount {
    /// Events of the pixels.
    pub made: u64,
    /// Events that were read.
    pub kept: u64,
    /// Events lost because another event of their pixel was waiting.
    pub lost_in_pixel: u64,
    /// Events lost because the queue was full.
    pub lost_in_queue: u64,
    /// Events that were still waiting at the last frame.
    pub unread: u64,
    /// Mean delay of the events that were read, us.
    pub mean_delay_us: f64,
    /// Largest delay, us.
    pub max_delay_us: f64,
}

impl ReadoutAccount {
    /// Events that are missing in the stream.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost_in_pixel + self.lost_in_queue + self.unread
    }
}

impl EventFilter for BusState {
    fn see(&mut self, frame: &DenseFrame) {
        self.last_ns = frame.t.0;
    }

    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> io::Result<()> {
        for event in events {
            let same = |first: &Event| first.t.floor_micros() == event.t.floor_micros();
            if !self.arriving.first().is_none_or(same) {
                self.serve_microsecond();
            }
            self.arriving.push(*event);
        }
        self.pass_on(sink)
    }

    /// Reads the waiting events up to the last frame, and passes on the rest.
    fn finish(
        &mut self,
        account: SimulationAccount,
        sink: &mut dyn EventSink,
    ) -> io::Result<SimulationAccount> {
        self.serve_microsecond();
        self.serve_until(self.last_ns);
        self.counts.unread = self.waiting.len() as u64;
        self.pass_first(self.read.len(), sink)?;
        self.counts.kept = self.passed.count;
        if self.counts.kept > 0 {
            self.counts.mean_delay_us /= self.counts.kept as f64;
        }
        Ok(SimulationAccount { readout: Some(self.counts), ..self.passed.settle(account) })
    }
}

/// Events collected before they are passed on.
const CHUNK: usize = 1 << 14;

/// The bus, and the events that wait for it.
#[derive(Debug)]
pub(super) struct BusState {
    /// Time of one event on the bus, ns; 0 for a bus without a limit.
    period_ns: f64,
    queue: u64,
    array: PixelArray,
    /// Start of the present busy period, ns.
    start_ns: i64,
    /// Events that were read in it.
    served: u64,
    waiting: WaitingEvents,
    /// True for pixels with a waiting event.
    requesting: Vec<bool>,
    /// Events of the present microsecond. Files are not sorted within one.
    arriving: Vec<Event>,
    /// Events that were read, in order of time.
    read: Vec<Event>,
    /// Stamp of the last frame, ns.
    last_ns: i64,
    counts: ReadoutAccount,
    passed: PassedEvents,
}

impl BusState {
    pub(super) fn new(bus: ReadoutBus, array: PixelArray) -> Self {
        Self {
            // Millions per second are events per microsecond, of 1000 ns.
            period_ns: 1e3 / bus.rate_mev_s,
            queue: bus.queue.unwrap_or(u64::MAX),
            array,
            // Before every event, so that the first one finds the bus free.
            start_ns: i64::MIN,
            served: 0,
            waiting: WaitingEvents::new(bus.arbiter),
            requesting: vec![false; array.size.pixels()],
            arriving: Vec::new(),
            read: Vec::new(),
            last_ns: 0,
            counts: ReadoutAccount::default(),
            passed: PassedEvents::new(&array),
        }
    }

    /// Serves the events of the collected microsecond in order of time.
    fn serve_microsecond(&mut self) {
        let mut arriving = std::mem::take(&mut self.arriving);
        arriving.sort_unstable_by_key(|event| (event.t, event.file_order()));
        arriving.drain(..).for_each(|event| self.arrive(event));
        self.arriving = arriving;
    }

    fn arrive(&mut self, event: Event) {
        // Before the event is judged: by its time, its pixel may be free again and the queue shorter.
        self.serve_until(event.t.0);
        self.counts.made += 1;
        let pixel = self.array.pixel(&event);
        if self.requesting[pixel] {
            self.counts.lost_in_pixel += 1;
        } else if self.waiting.is_empty() && self.slot_ns() <= event.t.0 {
            // The bus was idle, so slots are counted from this event on.
            (self.start_ns, self.served) = (event.t.0, 0);
            self.leave(event, event.t.0);
        } else if self.waiting.len() as u64 >= self.queue {
            self.counts.lost_in_queue += 1;
        } else {
            self.requesting[pixel] = true;
            self.waiting.push(event);
        }
    }

    /// Reads waiting events up to and including a time.
    fn serve_until(&mut self, end_ns: i64) {
        while !self.waiting.is_empty() && self.slot_ns() <= end_ns {
            let at_ns = self.slot_ns();
            if let Some(event) = self.waiting.pop() {
                let pixel = self.array.pixel(&event);
                self.requesting[pixel] = false;
                self.leave(event, at_ns);
            }
        }
    }

    /// The time at which the bus is free for the next event.
    #[expect(clippy::cast_possible_truncation, reason = "far below 2^63 for clips of any length")]
    fn slot_ns(&self) -> i64 {
        // From the start of the busy period and not from the previous event, so that rounding does
        // not accumulate. Rounded up, so that no window holds more events than the rate allows.
        self.start_ns.saturating_add((self.served as f64 * self.period_ns).ceil() as i64)
    }

    fn leave(&mut self, mut event: Event, at_ns: i64) {
        let delay_us = (at_ns - event.t.0) as f64 * 1e-3;
        // The sum; `finish` divides it.
        self.counts.mean_delay_us += delay_us;
        self.counts.max_delay_us = self.counts.max_delay_us.max(delay_us);
        self.served += 1;
        event.t.0 = at_ns;
        self.read.push(event);
    }

    /// Passes on the events of complete microseconds, if there are many.
    fn pass_on(&mut self, sink: &mut dyn EventSink) -> io::Result<()> {
        if self.read.len() < CHUNK {
            return Ok(());
        }
        // More events of the last microsecond may follow, and a file is sorted within each microsecond.
        let open = self.read.last().map_or(0, |event| event.t.floor_micros());
        let complete = self.read.partition_point(|event| event.t.floor_micros() < open);
        self.pass_first(complete, sink)
    }

    fn pass_first(&mut self, count: usize, sink: &mut dyn EventSink) -> io::Result<()> {
        let passed = &mut self.read[..count];
        // Stable: events in one place of the file order keep the order of their times.
        passed.sort_by_key(Event::file_order);
        passed.iter().for_each(|event| self.passed.add(event, self.array.pixel(event)));
        sink.append(passed)?;
        self.read.drain(..count);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::{EventLabel, Polarity};
    use gs2e_image::Size;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
    use gs2e_num::units::Timestamp;

    const SIZE: Size = Size { width: 64, height: 48 };

    fn event(ns: i64, x: u16, y: u16) -> Event {
        Event { t: Timestamp(ns), x, y, polarity: Polarity::On, label: EventLabel::Signal }
    }

    /// Events at random times and pixels, in file order.
    fn random_events(count: usize, span_ns: i64) -> Vec<Event> {
        let mut draws = Seed(5).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        #[expect(clippy::cast_possible_truncation, reason = "pixels of a small sensor")]
        let mut one = || {
            let t = draws.index(usize::try_from(span_ns).unwrap()) as i64;
            let pixel = draws.index(SIZE.pixels());
            let polarity = if draws.index(2) == 0 { Polarity::Off } else { Polarity::On };
            Event { polarity, ..event(t, (pixel % 64) as u16, (pixel / 64) as u16) }
        };
        let mut all: Vec<Event> = (0..count).map(|_| one()).collect();
        all.sort_by_key(|event| (event.file_order(), event.t));
        all
    }

    /// The stream behind a bus, fed in chunks of this many events, and its counts.
    fn through(
        bus: ReadoutBus,
        events: &[Event],
        chunk: usize,
        last_ns: i64,
    ) -> (Vec<Event>, ReadoutAccount) {
        let array = PixelArray { size: SIZE, origin: [0, 0], seed: Seed(1), labels: false };
        let (mut state, mut out) = (BusState::new(bus, array), Vec::new());
        state.last_ns = last_ns;
        for part in events.chunks(chunk) {
            state.take(part, &mut out).unwrap();
        }
        state.finish(SimulationAccount::default(), &mut out).unwrap();
        assert_eq!(state.counts.kept, out.len() as u64);
        (out, state.counts)
    }

    const ORDERS: [ArbiterOrder; 3] = [ArbiterOrder::Rows, ArbiterOrder::Columns, ArbiterOrder::None];

    fn bus(rate_mev_s: f64, arbiter: ArbiterOrder) -> ReadoutBus {
        ReadoutBus { rate_mev_s, arbiter, queue: None }
    }

    #[test]
    fn a_bus_without_a_limit_changes_nothing() {
        let events = random_events(60_000, 3_000_000);
        for order in ORDERS {
            let (out, counts) = through(bus(f64::INFINITY, order), &events, 1000, 3_000_000);
            assert!(out == events);
            assert_eq!((counts.made, counts.kept, counts.lost()), (60_000, 60_000, 0));
            assert_eq!(counts.max_delay_us.to_bits(), 0.0f64.to_bits());
        }
    }

    /// 3 ms of 50 million events per second: no window of 1 ms has more than 12,000 events.
    #[test]
    fn a_burst_leaves_at_the_rate_of_the_bus() {
        let events = random_events(150_000, 3_000_000);
        for (order, queue) in ORDERS.into_iter().flat_map(|order| [(order, None), (order, Some(40))]) {
            let asked = ReadoutBus { queue, ..bus(12.0, order) };
            let (out, counts) = through(asked, &events, 777, 5_000_000);
            assert_eq!(counts.kept + counts.lost(), 150_000);
            assert!(counts.lost() > 0 && counts.mean_delay_us > 0.0, "{order:?}: {counts:?}");
            assert_eq!(counts.lost_in_queue > 0, queue.is_some());
            assert!(out.is_sorted_by_key(Event::file_order));
            let mut times: Vec<i64> = out.iter().map(|event| event.t.0).collect();
            times.sort_unstable();
            let crowded = times.windows(12_001).filter(|w| w[12_000] - w[0] < 1_000_000).count();
            assert_eq!(crowded, 0, "{order:?}");
            // The bus is busy from the first event on: 3 ms give 36,000 events.
            let early = times.iter().filter(|t| **t <= 3_000_000).count();
            assert!((35_900..=36_001).contains(&early), "{order:?}: {early}");
            // At most 40 events wait, each for 83.3 ns.
            if queue.is_some() && order == ArbiterOrder::None {
                assert!(counts.max_delay_us <= 40.0 / 12.0 + 1e-3, "{counts:?}");
            }
            // The parts in which events arrive do not matter.
            assert!(through(asked, &events, 150_000, 5_000_000) == (out, counts));
        }
    }

    #[test]
    fn waiting_events_are_read_in_the_order_of_the_arbiter() {
        // One event per us. The first leaves at once, and the others meet a busy bus.
        let events = [event(0, 5, 9), event(10, 7, 3), event(20, 1, 8), event(30, 2, 3), event(40, 1, 3)];
        let mut sorted = events.to_vec();
        sorted.sort_by_key(Event::file_order);
        let t = |order, wanted: [(u16, u16, i64); 5]| {
            let found = through(bus(1.0, order), &sorted, 5, 1_000_000).0;
            let found: Vec<_> = found.iter().map(|e| (e.x, e.y, e.t.0)).collect();
            assert_eq!(found, wanted, "{order:?}");
        };
        t(ArbiterOrder::None, [(5, 9, 0), (7, 3, 1000), (1, 8, 2000), (2, 3, 3000), (1, 3, 4000)]);
        // The first row served is the lowest.
        t(ArbiterOrder::Rows, [(5, 9, 0), (1, 3, 1000), (2, 3, 2000), (7, 3, 3000), (1, 8, 4000)]);
        t(ArbiterOrder::Columns, [(5, 9, 0), (1, 3, 1000), (1, 8, 2000), (2, 3, 3000), (7, 3, 4000)]);
    }

    #[test]
    fn a_waiting_pixel_makes_no_event_and_the_rest_is_unread() {
        let events = [event(0, 0, 0), event(1000, 1, 0), event(2000, 1, 0), event(3000, 2, 0)];
        let (out, counts) = through(bus(0.1, ArbiterOrder::None), &events, 1, 15_000);
        let found: Vec<_> = out.iter().map(|e| (e.x, e.t.0)).collect();
        assert_eq!(found, [(0, 0), (1, 10_000)]);
        assert_eq!((counts.lost_in_pixel, counts.unread, counts.lost()), (1, 1, 2));
        assert!((counts.mean_delay_us - 4.5).abs() < 1e-12 && (counts.max_delay_us - 9.0).abs() < 1e-12);
    }
}
