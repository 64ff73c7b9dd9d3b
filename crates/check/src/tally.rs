//! One pass over an event stream that counts everything the checks need. Its memory depends on the
//! number of pixels and of anchors, not on the number of events.

mod busy;
mod course;
mod crowding;
mod labels;

pub use busy::BusyPixels;
pub use course::EventCourse;
pub use crowding::CrowdingSums;
pub use labels::LabelCounts;

use super::ahead::{AHEAD, load_ahead};
use super::drift::DriftLaw;
use super::event_frame::fit::{DriftBalance, FrameComparison};
use super::event_times::grid::{GridCounter, StampGrid};
use super::motion::warp::{self, FlowAt, WarpSharpness, WarpWindows};
use super::noise_floor::still::{StillPixelCounts, StillPixelWatch};
use crowding::CrowdingCounter;
use gs2e_event::{Event, Polarity};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
use gs2e_sensor::frames::anchors::AnchorFrames;
use labels::LabelWatch;

/// Bins of the phase of event times within the frame interval.
const PHASES: usize = 16;

/// The counts of a stream.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamTally {
    /// Size of the sensor.
    pub size: Size,
    /// Number of events.
    pub events: u64,
    /// Number of ON events.
    pub on: u64,
    /// Events with a pixel outside the sensor.
    pub off_sensor: u64,
    /// Events that sort before their predecessor, by `(t, y, x, p)`.
    pub disordered: u64,
    /// Events before the first stamp or after the last, in microseconds.
    pub off_time: u64,
    /// Events with the same microsecond, pixel and polarity as their predecessor.
    pub repeated: u64,
    /// Events with the same microsecond and pixel as their predecessor, but with the other
    /// polarity.
    pub contrary: u64,
    /// Expected number of both if the pixels fire at these mean rates and at random.
    pub repeats_by_chance: f64,
    /// Pairs of events of one pixel in the same microsecond: three events are three pairs.
    pub pairs: u64,
    /// Different times, in microseconds.
    pub distinct_us: u64,
    /// The grid on which the times lie.
    pub grid: StampGrid,
    /// Largest number of events in one millisecond.
    pub peak_per_ms: u64,
    /// Events by time.
    pub course: EventCourse,
    /// Pixels with at least one event.
    pub active_pixels: u64,
    /// Events by the phase of their time within the frame interval.
    pub phases: [u64; PHASES],
    /// Events in the dead time after another event of their pixel.
    pub too_soon: u64,
    /// Distribution of the events over the pixels.
    pub busy: BusyPixels,
    /// Pairs of events of one window that share a cell of the sensor.
    pub crowding: CrowdingSums,
    /// Comparison of events and frames; empty without frames.
    pub compared: FrameComparison,
    /// Effect of moving events along the flow, per window.
    pub sharpness: Vec<WarpSharpness>,
    /// Events per pixel of one window, in place and moved.
    pub window: Option<[Vec<u16>; 2]>,
    /// Events of pixels that see no change; `None` if these are unknown.
    pub still: Option<StillPixelCounts>,
    /// True if hot pixels are known, and left out of the comparisons with frames.
    pub hot_left_out: bool,
    /// Labels of the events; `None` if they have none, or if frames and law are unknown.
    pub labels: Option<LabelCounts>,
}

/// The references for a stream. Absent ones are not compared.
#[derive(Debug, Clone, Copy, Default)]
pub struct TallyReference<'a> {
    /// The sensor's law, and some of its frames.
    pub observed: Option<(DriftLaw, &'a AnchorFrames)>,
    /// The image motion at some instants.
    pub flows: &'a [FlowAt],
    /// Dead time of a pixel after an event, in whole microseconds.
    pub dead_us: i64,
    /// Rates of the pixels that fire by themselves, Hz, 0 for the others; empty if they are unknown or none
    /// is. Known ones are left out of comparisons with frames, whose law is then that of the other pixels.
    pub hot_hz: &'a [f64],
    /// True if the events have labels.
    pub labelled: bool,
}

impl StreamTally {
    /// Number of OFF events.
    #[must_use]
    pub fn off(&self) -> u64 {
        self.events - self.on
    }

    /// Share of ON events; `None` without events.
    #[must_use]
    pub fn on_share(&self) -> Option<f64> {
        (self.events > 0).then(|| self.on as f64 / self.events as f64)
    }
}

/// Counts a stream that arrives in chunks.
#[derive(Debug)]
pub struct StreamObserver<'a> {
    tally: StreamTally,
    size: Size,
    frames_per_us: f64,
    end_us: i64,
    previous: Option<Event>,
    /// Number of events directly before the latest one at its pixel and in its microsecond.
    together: u64,
    /// The latest microsecond, and its OFF and ON events so far.
    now_us: i64,
    now: [u32; 2],
    millisecond: (i64, u64),
    grid: GridCounter,
    pixels: Vec<PixelEvents>,
    crowds: CrowdingCounter,
    dead_us: i64,
    /// Hot pixels; empty if they are unknown.
    is_hot: Vec<bool>,
    balance: Option<DriftBalance<'a>>,
    windows: WarpWindows<'a>,
    watch: Option<StillPixelWatch>,
    labels: Option<LabelWatch<'a>>,
}

/// The events of a pixel since the first stamp. Side by side, because an event misses the caches once for
/// each array that it meets.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelEvents {
    /// ON and OFF events.
    pub(super) counts: [u32; 2],
    /// Time of the last one, us.
    last_us: i64,
}

impl<'a> StreamObserver<'a> {
    /// Starts before the first event of a sensor of `size` with stamps from 0 to `end_us`. Without
    /// a law, or with fewer than two anchors, events are not compared with frames.
    ///
    /// # Panics
    /// An anchor or a flow has another size.
    #[must_use]
    pub fn new(size: Size, rate: Hertz, end_us: i64, against: TallyReference<'a>) -> Self {
        let TallyReference { observed, flows, dead_us, hot_hz, labelled } = against;
        let pixels = size.pixels();
        let mut balance = observed.and_then(|(law, anchors)| DriftBalance::new(size, law, anchors, hot_hz));
        if let (Some(balance), Some(px_s)) = (&mut balance, warp::median_speed(flows)) {
            balance.moves_at(px_s);
        }
        Self {
            tally: StreamTally {
                hot_left_out: !hot_hz.is_empty(),
                ..StreamTally::without_events(size, EventCourse::new(rate, end_us))
            },
            size,
            frames_per_us: rate.to_f64() * 1e-6,
            end_us,
            previous: None,
            together: 0,
            now_us: 0,
            now: [0; 2],
            millisecond: (0, 0),
            grid: GridCounter::new(),
            // Half of the smallest number, so that the difference to a first event does not overflow.
            pixels: vec![PixelEvents { counts: [0; 2], last_us: i64::MIN / 2 }; pixels],
            crowds: CrowdingCounter::new(size, end_us),
            dead_us,
            is_hot: hot_hz.iter().map(|hz| *hz > 0.0).collect(),
            balance,
            windows: WarpWindows::new(size, end_us, flows),
            watch: observed
                .and_then(|(law, anchors)| StillPixelWatch::new(size, end_us, &law, anchors, &against)),
            labels: observed
                .filter(|_| labelled)
                .map(|(law, anchors)| LabelWatch::new(end_us, &law, anchors, hot_hz)),
        }
    }

    /// Counts a chunk.
    pub fn append(&mut self, events: &[Event]) {
        for batch in events.chunks(AHEAD) {
            load_ahead(batch.iter().map(|event| self.met_by(event)));
            batch.iter().for_each(|event| self.see(*event));
        }
    }

    /// The bits of the values that an event meets at its pixel.
    fn met_by(&self, event: &Event) -> u64 {
        let Some(pixel) = self.pixel(event) else { return 0 };
        let is_still = self.watch.as_ref().is_some_and(|watch| watch.is_still(pixel));
        let is_hot = self.is_hot.get(pixel).is_some_and(|is_hot| *is_hot);
        u64::from(self.pixels[pixel].counts[0])
            ^ u64::from(is_still)
            ^ u64::from(is_hot)
            ^ self.windows.met_by(pixel, event.t.floor_micros())
    }

    /// The pixel of an event; `None` off the sensor.
    fn pixel(&self, event: &Event) -> Option<usize> {
        let [x, y, width, height] = [event.x.into(), event.y.into(), self.size.width, self.size.height];
        (x < width && y < height).then_some(y as usize * width as usize + x as usize)
    }

    /// The counts after the last event.
    #[must_use]
    pub fn finish(mut self) -> StreamTally {
        self.leave_microsecond();
        // Anchors after the last event have not been evaluated yet.
        self.settle_until(i64::MAX);
        let tally = &mut self.tally;
        // The last millisecond is still open.
        tally.peak_per_ms = tally.peak_per_ms.max(self.millisecond.1);
        let totals: Vec<u32> = self.pixels.iter().map(|pixel| pixel.counts.iter().sum()).collect();
        tally.grid = self.grid.finish();
        tally.active_pixels = totals.iter().filter(|n| **n > 0).count() as u64;
        // A pixel with `n` events in `t` microseconds has an event in `n / t` of them.
        let squares: f64 = totals.iter().map(|n| f64::from(*n) * f64::from(*n)).sum();
        tally.repeats_by_chance = squares / self.end_us.max(1) as f64;
        tally.busy = BusyPixels::from_counts(totals);
        tally.crowding = self.crowds.finish();
        if let Some(balance) = self.balance {
            tally.compared = balance.finish();
        }
        (tally.sharpness, tally.window) = self.windows.finish();
        tally.labels = self.labels.map(LabelWatch::finish);
        tally.still = self.watch.map(StillPixelWatch::finish);
        self.tally
    }

    fn see(&mut self, event: Event) {
        let t_us = event.t.floor_micros();
        if t_us != self.now_us || self.previous.is_none() {
            self.leave_microsecond();
            self.enter_microsecond(t_us);
        }
        self.count_neighbours(event);
        self.now[usize::from(event.polarity == Polarity::On)] += 1;
        // Order, times and polarity count for every event; the rest needs a pixel.
        let Some(pixel) = self.pixel(&event) else {
            self.tally.off_sensor += 1;
            return;
        };
        let PixelEvents { counts, last_us } = &mut self.pixels[pixel];
        counts[usize::from(event.polarity == Polarity::Off)] += 1;
        let since = t_us - std::mem::replace(last_us, t_us);
        // Without a dead time, no event is too soon, not even one that is out of order.
        self.tally.too_soon += u64::from(self.dead_us > 0 && since < self.dead_us);
        self.crowds.see([event.x, event.y]);
        // The events of hot pixels do not move with the image.
        if self.is_hot.get(pixel).is_none_or(|is_hot| !is_hot) {
            self.windows.see(event, t_us);
        }
        let is_still = self.watch.as_mut().is_some_and(|watch| watch.see(pixel, t_us));
        if let Some(labels) = &mut self.labels {
            labels.see(pixel, event.label, is_still);
        }
    }

    /// Prepares for the events of a microsecond.
    fn enter_microsecond(&mut self, t_us: i64) {
        // First, because the counts of an anchor must not contain these events.
        self.settle_until(t_us);
        self.now_us = t_us;
        self.grid.see(t_us);
        self.crowds.enter(t_us);
        let ms = t_us.div_euclid(1000);
        if ms != self.millisecond.0 {
            self.tally.peak_per_ms = self.tally.peak_per_ms.max(self.millisecond.1);
            self.millisecond = (ms, 0);
        }
    }

    /// Counts the events of the latest microsecond by its time.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number from 0 to PHASES")]
    fn leave_microsecond(&mut self) {
        let [off, on] = std::mem::take(&mut self.now);
        let (t_us, events) = (self.now_us, u64::from(off) + u64::from(on));
        let tally = &mut self.tally;
        tally.events += events;
        tally.on += u64::from(on);
        tally.course.count(t_us, [on, off]);
        self.millisecond.1 += events;
        tally.off_time += if t_us < 0 || t_us > self.end_us { events } else { 0 };
        // The middle of the microsecond, so that no frame's stamp lies on the edge of a bin.
        let frames = (t_us as f64 + 0.5) * self.frames_per_us;
        // `rem_euclid` divides.
        let phase = frames - frames.floor();
        tally.phases[((phase * PHASES as f64) as usize).min(PHASES - 1)] += events;
    }

    /// Evaluates every anchor up to `t_us`. All events before it have been counted.
    fn settle_until(&mut self, t_us: i64) {
        let Some(balance) = &mut self.balance else { return };
        // An event in the microsecond of an anchor counts to it.
        while balance.next_us().is_some_and(|stop| t_us > stop) {
            balance.settle(&self.pixels);
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
        self.together = if same_place { self.together + 1 } else { 0 };
        // Each event of a group forms a pair with every event before it.
        tally.pairs += self.together;
        tally.disordered += u64::from(after < before);
        tally.repeated += u64::from(same_place && before.3 == after.3);
        tally.contrary += u64::from(same_place && before.3 != after.3);
        tally.distinct_us += u64::from(after.0 != before.0);
    }
}

impl StreamTally {
    fn without_events(size: Size, course: EventCourse) -> Self {
        Self {
            size,
            events: 0,
            on: 0,
            off_sensor: 0,
            disordered: 0,
            off_time: 0,
            repeated: 0,
            contrary: 0,
            repeats_by_chance: 0.0,
            pairs: 0,
            distinct_us: 0,
            grid: GridCounter::new().finish(),
            peak_per_ms: 0,
            course,
            active_pixels: 0,
            phases: [0; PHASES],
            too_soon: 0,
            busy: BusyPixels::default(),
            crowding: CrowdingSums::default(),
            compared: FrameComparison::default(),
            sharpness: Vec::new(),
            window: None,
            still: None,
            hot_left_out: false,
            labels: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_event::EventLabel;
    use gs2e_num::units::Timestamp;

    fn event(t_us: i64, x: u16, y: u16, polarity: Polarity) -> Event {
        Event { t: Timestamp::from_micros(t_us), x, y, polarity, label: EventLabel::Signal }
    }

    fn tally(events: &[Event]) -> StreamTally {
        let size = Size { width: 4, height: 3 };
        let mut observer = StreamObserver::new(
            size,
            Hertz("1000".parse().unwrap()),
            10_000,
            TallyReference { dead_us: 400, ..TallyReference::default() },
        );
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
        assert_eq!(found.pairs, 2);
        assert_eq!((found.repeated, found.contrary, found.too_soon), (1, 1, 2));
        assert_eq!((found.disordered, found.off_time, found.off_sensor), (1, 1, 2));
        assert_eq!((found.distinct_us, found.active_pixels, found.peak_per_ms), (5, 3, 4));
        // A frame interval of 1000 us in 16 bins of 62.5 us: 10 is in bin 0, 500 in bin 8, 9999 in
        // bin 15.
        assert_eq!((found.phases[0], found.phases[8], found.phases[15]), (4, 2, 1));
    }

    #[test]
    fn events_of_one_pixel_and_time_are_counted_in_pairs() {
        use Polarity::{Off, On};
        let pairs = |events: &[Event]| (tally(events).pairs, tally(events).repeated + tally(events).contrary);
        let at = |polarity| event(10, 0, 0, polarity);
        assert_eq!(pairs(&[at(On), at(On), at(On), at(On)]), (6, 3));
        assert_eq!(pairs(&[at(Off), at(Off), at(On), event(10, 1, 0, On), event(11, 1, 0, On)]), (3, 2));
    }

    #[test]
    fn no_events_are_a_stream_too() {
        let found = tally(&[]);
        assert_eq!((found.events, found.distinct_us, found.on_share()), (0, 0, None));
    }
}
