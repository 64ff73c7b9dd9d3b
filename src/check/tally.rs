//! One pass over an event stream, counting what the passes need. Its memory depends on the number of pixels and of
//! stops, never on the number of events.

use super::drift::DriftLaw;
use super::event_frame::fit::{Balance, Fit};
use crate::event::{Event, Polarity};
use crate::frames::anchors::Anchors;
use crate::image::Size;
use crate::units::Hertz;

/// Bins of the phase of event times within the frame interval.
const PHASES: usize = 16;

/// A stream, counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    /// Size of the sensor.
    pub size: Size,
    /// Events.
    pub events: u64,
    /// Of these, brighter.
    pub on: u64,
    /// Events whose pixel is not on the sensor.
    pub off_sensor: u64,
    /// Events that sort before the one in front of them, by `(t, y, x, p)`.
    pub disordered: u64,
    /// Events before the first stamp or after the last, in microseconds.
    pub off_time: u64,
    /// Events of the same microsecond, pixel and polarity as the one in front of them.
    pub repeated: u64,
    /// Events of the same microsecond and pixel as the one in front of them, but of the other polarity.
    pub contrary: u64,
    /// Different times, in microseconds.
    pub distinct_us: u64,
    /// Most events in one millisecond.
    pub peak_per_ms: u64,
    /// Pixels with at least one event.
    pub active_pixels: u64,
    /// Events by the phase of their time within the frame interval.
    pub phases: [u64; PHASES],
    /// What events and frames say at each anchor after the first; empty where the sensor's law does not allow it.
    pub fits: Vec<Fit>,
}

impl Tally {
    /// Of the events, darker.
    #[must_use]
    pub fn off(&self) -> u64 {
        self.events - self.on
    }

    /// Share of ON events; `None` where there are no events.
    #[must_use]
    pub fn on_share(&self) -> Option<f64> {
        (self.events > 0).then(|| self.on as f64 / self.events as f64)
    }
}

/// Counts a stream that comes in chunks.
#[derive(Debug)]
pub struct Observer<'a> {
    tally: Tally,
    size: Size,
    frames_per_us: f64,
    end_us: i64,
    previous: Option<Event>,
    millisecond: (i64, u64),
    counts: Counts,
    balance: Option<Balance<'a>>,
}

/// Events of each pixel since the first stamp.
#[derive(Debug)]
pub(super) struct Counts {
    pub(super) on: Vec<u32>,
    pub(super) off: Vec<u32>,
}

impl<'a> Observer<'a> {
    /// Before the first event of a sensor of `size`, whose stamps run from 0 to `end_us`. The anchors are what the
    /// sensor saw; without a law, or with fewer than two of them, events are not held against frames.
    ///
    /// # Panics
    /// If an anchor is of another size.
    #[must_use]
    pub fn new(size: Size, rate: Hertz, end_us: i64, seen: Option<(DriftLaw, &'a Anchors)>) -> Self {
        let counts = Counts { on: vec![0; size.pixels()], off: vec![0; size.pixels()] };
        let balance = seen.and_then(|(law, anchors)| Balance::new(size, law, anchors));
        let millisecond = (0, 0);
        let frames_per_us = rate.to_f64() * 1e-6;
        Self {
            tally: Tally::empty(size),
            size,
            frames_per_us,
            end_us,
            previous: None,
            millisecond,
            counts,
            balance,
        }
    }

    /// Counts a chunk.
    pub fn append(&mut self, events: &[Event]) {
        for event in events {
            self.see(*event);
        }
    }

    /// The tally, after the last event.
    #[must_use]
    pub fn finish(mut self) -> Tally {
        self.settle_until(i64::MAX);
        self.tally.peak_per_ms = self.tally.peak_per_ms.max(self.millisecond.1);
        let active = self.counts.on.iter().zip(&self.counts.off).filter(|(on, off)| **on + **off > 0);
        self.tally.active_pixels = active.count() as u64;
        self.tally.fits = self.balance.map_or_else(Vec::new, Balance::into_fits);
        self.tally
    }

    fn see(&mut self, event: Event) {
        let t_us = event.t.floor_micros();
        self.settle_until(t_us);
        self.count_neighbours(event);
        self.count_time(t_us);
        let tally = &mut self.tally;
        tally.events += 1;
        tally.on += u64::from(event.polarity == Polarity::On);
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        if x >= width || y >= height {
            tally.off_sensor += 1;
            return;
        }
        let counts = match event.polarity {
            Polarity::On => &mut self.counts.on,
            Polarity::Off => &mut self.counts.off,
        };
        counts[y * width + x] += 1;
    }

    /// Takes stock at every anchor up to `t_us`: the events that lie before it are all counted.
    fn settle_until(&mut self, t_us: i64) {
        let Some(balance) = &mut self.balance else { return };
        while balance.next_us().is_some_and(|stop| t_us > stop) {
            balance.settle(&self.counts);
        }
    }

    fn count_neighbours(&mut self, event: Event) {
        let tally = &mut self.tally;
        let Some(previous) = self.previous.replace(event) else {
            tally.distinct_us = 1;
            return;
        };
        let (before, after) = (previous.file_order(), event.file_order());
        let same_place = (before.0, before.1, before.2) == (after.0, after.1, after.2);
        tally.disordered += u64::from(after < before);
        tally.repeated += u64::from(same_place && before.3 == after.3);
        tally.contrary += u64::from(same_place && before.3 != after.3);
        tally.distinct_us += u64::from(after.0 != before.0);
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number from 0 to PHASES")]
    fn count_time(&mut self, t_us: i64) {
        let ms = t_us.div_euclid(1000);
        if ms != self.millisecond.0 {
            self.tally.peak_per_ms = self.tally.peak_per_ms.max(self.millisecond.1);
            self.millisecond = (ms, 0);
        }
        self.millisecond.1 += 1;
        self.tally.off_time += u64::from(t_us < 0 || t_us > self.end_us);
        // The middle of the microsecond, so that no frame's stamp lies on the edge of a bin.
        let phase = ((t_us as f64 + 0.5) * self.frames_per_us).rem_euclid(1.0);
        self.tally.phases[((phase * PHASES as f64) as usize).min(PHASES - 1)] += 1;
    }
}

impl Tally {
    fn empty(size: Size) -> Self {
        Self {
            size,
            events: 0,
            on: 0,
            off_sensor: 0,
            disordered: 0,
            off_time: 0,
            repeated: 0,
            contrary: 0,
            distinct_us: 0,
            peak_per_ms: 0,
            active_pixels: 0,
            phases: [0; PHASES],
            fits: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Label;
    use crate::units::Timestamp;

    fn event(t_us: i64, x: u16, y: u16, polarity: Polarity) -> Event {
        Event { t: Timestamp::from_micros(t_us), x, y, polarity, label: Label::Signal }
    }

    fn tally(events: &[Event]) -> Tally {
        let size = Size { width: 4, height: 3 };
        let mut observer = Observer::new(size, Hertz("1000".parse().unwrap()), 10_000, None);
        for chunk in events.chunks(2) {
            observer.append(chunk);
        }
        observer.finish()
    }

    #[test]
    fn a_stream_is_counted() {
        use Polarity::{Off, On};
        let found = tally(&[
            event(10, 0, 0, On),
            event(10, 0, 0, On),
            event(500, 3, 2, Off),
            event(500, 3, 2, On),
            event(9999, 1, 1, On),
            event(10_001, 4, 0, Off),
            event(10_000, 0, 3, Off),
        ]);
        assert_eq!((found.events, found.on, found.off()), (7, 4, 3));
        assert_eq!((found.repeated, found.contrary), (1, 1));
        assert_eq!((found.disordered, found.off_time, found.off_sensor), (1, 1, 2));
        assert_eq!((found.distinct_us, found.active_pixels, found.peak_per_ms), (5, 3, 4));
        // Frame interval 1000 us in 16 bins of 62.5 us: 10 is in bin 0, 500 in bin 8, 9999 in bin 15.
        assert_eq!((found.phases[0], found.phases[8], found.phases[15]), (4, 2, 1));
    }

    #[test]
    fn no_events_are_a_stream_too() {
        let found = tally(&[]);
        assert_eq!((found.events, found.distinct_us, found.on_share()), (0, 0, None));
    }
}
