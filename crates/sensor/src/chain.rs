//! The chain of a sensor: the pixels of its law, and the filters that their events pass on the way to
//! the stream.

use super::{SensorError, SensorPixels, SimulationAccount};
use crate::frames::DenseFrame;
use crate::noise::PixelSite;
use gs2e_event::{Event, EventLabel, EventSink, Polarity};
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use std::io;

/// A pixel array: its size, its place on the sensor, and its seed.
#[derive(Debug, Clone, Copy)]
pub struct PixelArray {
    pub(crate) size: Size,
    /// Position of the top-left pixel on the sensor.
    pub(crate) origin: [u16; 2],
    pub(crate) seed: Seed,
    /// True if events are labelled.
    pub(crate) labels: bool,
}

impl PixelArray {
    /// Checks that every pixel of a frame has coordinates that events can hold.
    pub(super) fn check_extent(&self) -> Result<(), SensorError> {
        let Self { size, origin: [x, y], .. } = *self;
        size.check_sensor().map_err(|e| SensorError::Setup(format!("frames of {e}")))?;
        // Coordinates are 16 bits wide: the pixel at 65535 is the last one that an event can name.
        let fits = |extent: u32, from: u16| u64::from(extent) + u64::from(from) <= 1 << 16;
        if fits(size.width, x) && fits(size.height, y) {
            return Ok(());
        }
        Err(SensorError::Setup(format!(
            "frames of {size} at ({x}, {y}) exceed the 65536 columns and rows that events can address"
        )))
    }

    /// Column and row of a pixel in the frame.
    pub(super) fn at(&self, pixel: usize) -> [u16; 2] {
        let width = self.size.width as usize;
        #[expect(clippy::cast_possible_truncation, reason = "pixel coordinates are below 2^16")]
        [(pixel % width) as u16, (pixel / width) as u16]
    }

    /// The place of a pixel on the sensor.
    pub(super) fn site(&self, pixel: usize) -> PixelSite {
        let ([x, y], [left, top]) = (self.at(pixel), self.origin);
        // `check_extent` keeps these sums within 16 bits.
        PixelSite { seed: self.seed, x: x + left, y: y + top }
    }

    /// The pixel of an event.
    pub(super) fn pixel(&self, event: &Event) -> usize {
        usize::from(event.y) * self.size.width as usize + usize::from(event.x)
    }

    /// Label of the events that noise makes. A stream without labels has `Signal` on every event.
    pub(super) fn noise_label(&self) -> EventLabel {
        if self.labels { EventLabel::Noise } else { EventLabel::Signal }
    }
}

/// A stage between the pixels of a law and the stream.
pub(super) trait EventFilter: std::fmt::Debug {
    /// Sees the next frame, before the events up to it.
    fn see(&mut self, _frame: &DenseFrame) {}

    /// Takes the next events in file order, and passes on those that are final.
    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> io::Result<()>;

    /// Passes on the rest, and turns the counts of the events taken into those of the events passed on.
    fn finish(
        &mut self,
        account: SimulationAccount,
        sink: &mut dyn EventSink,
    ) -> io::Result<SimulationAccount>;
}

/// The pixels of a law, and the filters behind them in the order in which events pass them.
#[derive(Debug)]
pub struct FilteredPixels {
    pixels: Box<dyn SensorPixels>,
    filters: Vec<Box<dyn EventFilter>>,
}

impl FilteredPixels {
    /// Pixels without filters.
    pub(super) fn new(pixels: impl SensorPixels + 'static) -> Self {
        Self { pixels: Box::new(pixels), filters: Vec::new() }
    }

    /// Adds a filter, if there is one.
    pub(super) fn behind<F: EventFilter + 'static>(mut self, filter: Option<F>) -> Self {
        self.filters.extend(filter.map(|filter| Box::new(filter) as Box<dyn EventFilter>));
        self
    }
}

impl SensorPixels for FilteredPixels {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        self.filters.iter_mut().for_each(|filter| filter.see(frame));
        self.pixels.advance(frame, &mut FilterSink { filters: &mut self.filters, sink })
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let mut account = self.pixels.finish(&mut FilterSink { filters: &mut self.filters, sink })?;
        // In the order of the chain: what a filter passes on at its end must still go through those behind
        // it.
        let mut filters = &mut self.filters[..];
        while let Some((filter, behind)) = filters.split_first_mut() {
            account = filter.finish(account, &mut FilterSink { filters: &mut *behind, sink: &mut *sink })?;
            filters = behind;
        }
        Ok(account)
    }
}

/// The sink in front of filters.
struct FilterSink<'a> {
    filters: &'a mut [Box<dyn EventFilter>],
    sink: &'a mut dyn EventSink,
}

impl EventSink for FilterSink<'_> {
    fn append(&mut self, events: &[Event]) -> io::Result<()> {
        match self.filters.split_first_mut() {
            Some((filter, filters)) => filter.take(events, &mut FilterSink { filters, sink: self.sink }),
            None => self.sink.append(events),
        }
    }
}

/// Passes on some of the events, and counts the others.
#[derive(Debug, Default)]
pub(super) struct EventSelection {
    /// Number of dropped ON events.
    pub(super) on: u64,
    /// Number of dropped OFF events.
    pub(super) off: u64,
    kept: Vec<Event>,
}

impl EventSelection {
    /// Passes on the events for which `keeps` is true.
    pub(super) fn pass(
        &mut self,
        events: &[Event],
        sink: &mut dyn EventSink,
        mut keeps: impl FnMut(&Event) -> bool,
    ) -> io::Result<()> {
        self.kept.clear();
        for event in events {
            if keeps(event) {
                self.kept.push(*event);
            } else if event.polarity == Polarity::On {
                self.on += 1;
            } else {
                self.off += 1;
            }
        }
        sink.append(&self.kept)
    }

    /// Number of dropped events.
    pub(super) fn dropped(&self) -> u64 {
        self.on + self.off
    }

    /// The counts of the events passed on.
    pub(super) fn settle(&self, account: SimulationAccount) -> SimulationAccount {
        let (on, off) = (account.on - self.on, account.off - self.off);
        SimulationAccount { events: account.events - self.dropped(), on, off, ..account }
    }
}

/// Counts of the events that a filter passes on in place of those that it takes.
#[derive(Debug)]
pub(super) struct PassedEvents {
    pub(super) count: u64,
    on: u64,
    /// Pairs of events of one pixel in the same microsecond.
    coincident: u64,
    /// Microsecond, row and column of the last event.
    place: Option<(i64, u16, u16)>,
    /// True for pixels with an event.
    fired: Vec<bool>,
}

impl PassedEvents {
    pub(super) fn new(array: &PixelArray) -> Self {
        Self { count: 0, on: 0, coincident: 0, place: None, fired: vec![false; array.size.pixels()] }
    }

    /// Counts the next event, in file order.
    pub(super) fn add(&mut self, event: &Event, pixel: usize) {
        let place = Some((event.t.floor_micros(), event.y, event.x));
        self.coincident += u64::from(place == self.place);
        self.place = place;
        self.count += 1;
        self.on += u64::from(event.polarity == Polarity::On);
        self.fired[pixel] = true;
    }

    /// The counts of a run with these events.
    pub(super) fn settle(&self, account: SimulationAccount) -> SimulationAccount {
        SimulationAccount {
            events: self.count,
            on: self.on,
            off: self.count - self.on,
            same_us_same_pixel: self.coincident,
            active_pixels: self.fired.iter().filter(|fired| **fired).count() as u64,
            ..account
        }
    }
}
