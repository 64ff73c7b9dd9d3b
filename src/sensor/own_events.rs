//! Events of hot pixels, merged into the stream of a law that does not model them.
//!
//! The two processes do not interact: an own event does not change the pixel's voltage.

use super::noise::poisson::PoissonTrain;
use super::noise::{HotPixelNoise, PixelSite};
use super::{SensorError, SensorPixels, SimulationAccount};
use crate::event::{Event, EventLabel, EventSink, Polarity};
use crate::frames::DenseFrame;
use crate::image::Size;
use crate::seed::{DrawSpace, Seed};
use crate::units::Timestamp;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Pixels with hot ones among them.
pub(super) struct WithHot {
    pixels: Box<dyn SensorPixels>,
    hot: HotPixelQueue,
}

impl WithHot {
    /// Adds hot pixels to `pixels`, with the top-left pixel at `origin` on the sensor. Their own
    /// events get this label.
    pub(super) fn new(
        pixels: Box<dyn SensorPixels>,
        hot: &HotPixelNoise,
        size: Size,
        origin: [u16; 2],
        seed: Seed,
        label: EventLabel,
    ) -> Self {
        Self { pixels, hot: HotPixelQueue::new(hot, size, origin, seed, label) }
    }
}

impl SensorPixels for WithHot {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        self.hot.last = frame.t;
        self.pixels.advance(frame, &mut MergedEvents { sink, hot: &mut self.hot })
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let account = self.pixels.finish(&mut MergedEvents { sink, hot: &mut self.hot })?;
        // Own events may follow the last event of the law, so they are not all merged by now.
        self.hot.append_rest(sink)?;
        let HotPixelQueue { made, pairs, fired, .. } = &self.hot;
        let alone =
            fired.iter().filter(|fired| **fired == FiredCause { by_law: false, by_itself: true }).count();
        Ok(SimulationAccount {
            events: account.events + made,
            on: account.on + made,
            same_us_same_pixel: account.same_us_same_pixel + pairs,
            active_pixels: account.active_pixels + alone as u64,
            ..account
        })
    }
}

/// Causes for which a pixel has fired.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct FiredCause {
    by_law: bool,
    by_itself: bool,
}

/// The next event of a hot pixel, ordered as in files.
struct NextHotEvent {
    event: Event,
    /// Time of the event, ns.
    at: f64,
    site: PixelSite,
    train: PoissonTrain,
}

impl PartialEq for NextHotEvent {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for NextHotEvent {}

impl PartialOrd for NextHotEvent {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for NextHotEvent {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |next: &Self| (next.event.file_order(), next.event.t);
        key(self).cmp(&key(other))
    }
}

/// Events of one pixel in one microsecond, the latest that were passed on.
#[derive(Default)]
struct CoincidentEvents {
    place: Option<(i64, u16, u16)>,
    all: u64,
    own: u64,
}

/// The hot pixels, in order of their next events.
struct HotPixelQueue {
    /// Rate of each hot pixel, events per ns.
    rate: f64,
    /// Label of their own events.
    label: EventLabel,
    waiting: BinaryHeap<Reverse<NextHotEvent>>,
    width: usize,
    fired: Vec<FiredCause>,
    /// Stamp of the last frame.
    last: Timestamp,
    made: u64,
    together: CoincidentEvents,
    /// Number of pairs in one pixel and microsecond with at least one own event.
    pairs: u64,
    out: Vec<Event>,
}

impl HotPixelQueue {
    fn new(hot: &HotPixelNoise, size: Size, [left, top]: [u16; 2], seed: Seed, label: EventLabel) -> Self {
        let mut all = Self {
            rate: hot.per_ns(),
            label,
            waiting: BinaryHeap::new(),
            width: size.width as usize,
            fired: vec![FiredCause::default(); size.pixels()],
            last: Timestamp(0),
            made: 0,
            together: CoincidentEvents::default(),
            pairs: 0,
            out: Vec::new(),
        };
        #[expect(clippy::cast_possible_truncation, reason = "pixel coordinates are below 2^16")]
        let places = (0..size.height as u16).flat_map(|y| (0..size.width as u16).map(move |x| (x, y)));
        for (x, y) in places {
            let site = PixelSite { seed, x: x + left, y: y + top };
            all.wait(x, y, 0.0, site, hot.train(site));
        }
        all
    }

    /// Schedules the next event of a pixel after `from`.
    fn wait(&mut self, x: u16, y: u16, from: f64, site: PixelSite, train: PoissonTrain) {
        let Some(gap) = train.gap(self.rate) else { return };
        let at = from + gap;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "nanoseconds; what is beyond 64 bits is beyond any stamp"
        )]
        let event = Event { t: Timestamp(at as i64), x, y, polarity: Polarity::On, label: self.label };
        self.waiting.push(Reverse(NextHotEvent { event, at, site, train }));
    }

    /// Adds own events to the output, in file order, as long as `holds` is true.
    fn take_until(&mut self, holds: impl Fn(&Event) -> bool) {
        while let Some(Reverse(next)) = self.waiting.peek() {
            if !holds(&next.event) {
                break;
            }
            let Some(Reverse(NextHotEvent { event, at, site, mut train })) = self.waiting.pop() else {
                break;
            };
            self.take(event, true);
            self.made += 1;
            train.wait(site, DrawSpace::Hot);
            self.wait(event.x, event.y, at, site, train);
        }
    }

    fn take(&mut self, event: Event, own: bool) {
        let place = Some((event.t.floor_micros(), event.y, event.x));
        if self.together.place != place {
            self.together = CoincidentEvents { place, ..CoincidentEvents::default() };
        }
        // An own event pairs with all events of its microsecond, an event of the law only with own
        // ones, because the law counts the pairs of its own events.
        self.pairs += if own { self.together.all } else { self.together.own };
        self.together.all += 1;
        self.together.own += u64::from(own);
        let fired = &mut self.fired[usize::from(event.y) * self.width + usize::from(event.x)];
        fired.by_itself |= own;
        fired.by_law |= !own;
        self.out.push(event);
    }

    /// Passes on the remaining own events up to the last stamp.
    fn append_rest(&mut self, sink: &mut dyn EventSink) -> std::io::Result<()> {
        // The process has no end, so the last stamp cuts it off.
        let last = self.last;
        self.out.clear();
        self.take_until(|own| own.t <= last);
        sink.append(&self.out)
    }
}

/// A sink that merges own events into the stream of a law.
struct MergedEvents<'a> {
    sink: &'a mut dyn EventSink,
    hot: &'a mut HotPixelQueue,
}

impl EventSink for MergedEvents<'_> {
    fn append(&mut self, events: &[Event]) -> std::io::Result<()> {
        self.hot.out.clear();
        for event in events {
            let until = event.file_order();
            // Up to and including the place of the law's event: where both are equal, the own event
            // is first.
            self.hot.take_until(|own| own.file_order() <= until);
            self.hot.take(*event, false);
        }
        self.sink.append(&self.hot.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::array::{ArrayFrames, ArraySamples, FullScale};
    use crate::sensor::simulate_one;
    use crate::sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
    use std::ops::ControlFlow;

    const SIZE: Size = Size { width: 40, height: 30 };
    const FRAMES: usize = 50;
    const STEP_US: i64 = 1000;

    fn run(sensor: &VoltmeterModel, grey: impl Fn(usize, usize) -> f32) -> (Vec<Event>, SimulationAccount) {
        let samples = (0..FRAMES).flat_map(|j| (0..SIZE.pixels()).map(move |p| (j, p)));
        let samples = ArraySamples::Floats(samples.map(|(j, p)| grey(j, p)).collect(), FullScale::Grey255);
        let stamps: Vec<i64> = (0..).map(|j| STEP_US * j).take(FRAMES).collect();
        let mut frames = ArrayFrames::new(SIZE, samples, &stamps).unwrap();
        let mut events = Vec::new();
        let mut go_on = |_: &DenseFrame| ControlFlow::Continue(());
        let account = simulate_one(&mut frames, sensor, Seed(5), &mut events, &mut go_on).unwrap();
        (events, account)
    }

    fn quiet(hot_pixels: HotPixelNoise) -> VoltmeterModel {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        VoltmeterModel { hot_pixels, ..VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]) }
    }

    fn wave(j: usize, p: usize) -> f32 {
        128.0 + 100.0 * libm::sinf(p as f32 + 0.7 * j as f32)
    }

    #[test]
    fn in_constant_light_only_hot_pixels_fire_as_often_as_stated() {
        let hot = HotPixelNoise { share: 0.2, rate: 5000.0 };
        let (events, account) = run(&quiet(hot), |_, _| 90.0);
        // 1200 pixels, 49 ms: the binomial spread of the share times 245 events each, and the
        // Poisson spread.
        let (pixels, each) = (0.2 * SIZE.pixels() as f64, 5000.0 * 0.049);
        let spread = (pixels * 0.8 * each * each + pixels * each).sqrt();
        let z = (events.len() as f64 - pixels * each) / spread;
        println!("{} events, z {z:.2} (limit 4.5)", events.len());
        assert!(z.abs() < 4.5);
        assert!(events.iter().all(|e| e.polarity == Polarity::On && e.t.0 > 0 && e.t.0 <= 49_000_000));
        let mut places: Vec<(u16, u16)> = events.iter().map(|e| (e.x, e.y)).collect();
        places.sort_unstable();
        let same_us: Vec<_> = events.iter().map(|e| (e.t.floor_micros(), e.y, e.x)).collect();
        let pairs = same_us.windows(2).filter(|pair| pair[0] == pair[1]).count();
        places.dedup();
        assert_eq!(account.active_pixels, places.len() as u64);
        assert_eq!((account.events, account.on, account.off), (events.len() as u64, events.len() as u64, 0));
        assert!(account.same_us_same_pixel >= pairs as u64 && pairs > 0);
    }

    #[test]
    fn the_law_goes_on_beside_them_and_all_is_in_order() {
        let hot = HotPixelNoise { share: 0.1, rate: 3000.0 };
        let (alone, without) = run(&quiet(HotPixelNoise::default()), wave);
        let (merged, with) = run(&quiet(hot), wave);
        assert!(merged.is_sorted_by_key(Event::file_order));
        assert!(with.events > without.events && with.events == merged.len() as u64);
        assert_eq!((with.off, with.drift_violations), (without.off, 0));
        // All events of the law are present: without them, the merged stream is the own events.
        let key = |e: &Event| (e.file_order(), e.t);
        let mut own = merged.clone();
        own.sort_by_key(key);
        for event in &alone {
            let at = own.binary_search_by_key(&key(event), key).expect("it is there");
            own.remove(at);
        }
        assert_eq!(own.len() as u64, with.events - without.events);
        assert!(own.iter().all(|e| e.polarity == Polarity::On));
        // The same own events happen in constant light.
        let (mut dark, _) = run(&quiet(hot), |_, _| 90.0);
        dark.sort_by_key(key);
        assert_eq!(own, dark);
    }
}
