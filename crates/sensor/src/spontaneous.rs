//! Events of hot pixels and of the noise floor, merged into the stream of a law that does not model
//! them.
//!
//! The processes do not interact: a spontaneous event does not change the pixel's voltage.

use super::SimulationAccount;
use super::chain::{EventFilter, PixelArray};
use super::noise::grey_table::GreyTable;
use super::noise::poisson::{LinearRate, PoissonTrain};
use super::noise::{HotPixelNoise, NoiseFloor, PixelSite};
use crate::frames::DenseFrame;
use gs2e_event::{Event, EventSink, Polarity};
use gs2e_num::seed::DrawSpace;
use gs2e_num::units::Timestamp;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io;

/// Number of pixels that one task takes at a time.
const CHUNK: usize = 4096;

/// Merges the events that pixels make by themselves into those of a law.
#[derive(Debug)]
pub(super) struct SpontaneousEvents {
    queue: SpontaneousQueue,
    floor: Option<FloorPixels>,
}

impl SpontaneousEvents {
    /// Hot pixels, if there are any.
    pub(super) fn of_hot(hot: &HotPixelNoise, array: PixelArray) -> Option<Self> {
        (!hot.is_absent()).then(|| {
            let mut queue = SpontaneousQueue::new(*hot, array);
            queue.start_hot();
            Self { queue, floor: None }
        })
    }

    /// A noise floor, if there is one. White is `white_lux`.
    pub(super) fn of_floor(floor: &NoiseFloor, white_lux: f64, array: PixelArray) -> Option<Self> {
        (!floor.is_absent()).then(|| {
            let floor = Some(FloorPixels::new(floor.table(white_lux), array));
            Self { queue: SpontaneousQueue::new(HotPixelNoise::default(), array), floor }
        })
    }
}

impl EventFilter for SpontaneousEvents {
    fn see(&mut self, frame: &DenseFrame) {
        self.queue.last = frame.t;
        // The law passes on its events of this interval next, and all spontaneous events before them must be
        // known by then.
        if let Some(floor) = &mut self.floor {
            floor.advance(frame, &mut self.queue.waiting);
        }
    }

    fn take(&mut self, events: &[Event], sink: &mut dyn EventSink) -> io::Result<()> {
        self.queue.out.clear();
        for event in events {
            let until = event.file_order();
            // Up to and including the place of the law's event: where both are equal, the spontaneous event
            // is first.
            self.queue.take_until(|next| next.file_order() <= until);
            self.queue.take(*event, false);
        }
        sink.append(&self.queue.out)
    }

    fn finish(
        &mut self,
        account: SimulationAccount,
        sink: &mut dyn EventSink,
    ) -> io::Result<SimulationAccount> {
        // Spontaneous events may follow the last event of the law, so they are not all merged by now.
        self.queue.append_rest(sink)?;
        let SpontaneousQueue { on, off, pairs, fired, .. } = &self.queue;
        let alone =
            fired.iter().filter(|fired| **fired == FiredCause { by_law: false, by_itself: true }).count();
        Ok(SimulationAccount {
            events: account.events + on + off,
            on: account.on + on,
            off: account.off + off,
            same_us_same_pixel: account.same_us_same_pixel + pairs,
            active_pixels: account.active_pixels + alone as u64,
            ..account
        })
    }
}

/// The noise floor of all pixels.
#[derive(Debug)]
struct FloorPixels {
    table: GreyTable<2>,
    array: PixelArray,
    trains: Vec<PoissonTrain>,
    /// Brightness at the latest frame; empty before the first.
    latest: Vec<f32>,
    /// Stamp of that frame.
    t: Timestamp,
}

impl FloorPixels {
    fn new(table: GreyTable<2>, array: PixelArray) -> Self {
        let train = |pixel| PoissonTrain::new(array.site(pixel), DrawSpace::Shot);
        let trains = (0..array.size.pixels()).into_par_iter().map(train).collect();
        Self { table, array, trains, latest: Vec::new(), t: Timestamp(0) }
    }

    /// Adds the events since the previous frame.
    fn advance(&mut self, frame: &DenseFrame, waiting: &mut BinaryHeap<Reverse<NextSpontaneous>>) {
        let now = frame.luminance.pixels();
        let Self { table, array, trains, latest, t } = self;
        let length = (frame.t.0 - t.0) as f64;
        // A frame of another size, or one that is not later, is refused by the law.
        if latest.len() == now.len() && length > 0.0 {
            let chunks =
                trains.par_chunks_mut(CHUNK).zip(latest.par_chunks(CHUNK)).zip(now.par_chunks(CHUNK));
            let made: Vec<Vec<NextSpontaneous>> = chunks
                .enumerate()
                .map(|(i, ((trains, latest), now))| {
                    let mut made = Vec::new();
                    let pixels = trains.iter_mut().zip(latest.iter().zip(now)).enumerate();
                    for (pixel, (train, (from, to))) in pixels {
                        let pixel = i * CHUNK + pixel;
                        let span = FloorSpan { array, pixel, greys: [*from, *to], start: t.0, length };
                        span.cross(table, train, &mut made);
                    }
                    made
                })
                .collect();
            // Their order does not matter to a heap.
            waiting.extend(made.into_iter().flatten().map(Reverse));
        }
        latest.clear();
        latest.extend_from_slice(now);
        *t = frame.t;
    }
}

/// A pixel between two frames.
struct FloorSpan<'a> {
    array: &'a PixelArray,
    pixel: usize,
    greys: [f32; 2],
    /// Stamp of the earlier frame, ns.
    start: i64,
    /// Time between the frames, ns.
    length: f64,
}

impl FloorSpan<'_> {
    #[inline]
    fn cross(&self, table: &GreyTable<2>, train: &mut PoissonTrain, made: &mut Vec<NextSpontaneous>) {
        let ends = self.greys.map(|grey| table.at(grey).iter().sum());
        let rates = LinearRate { ends, length: self.length };
        let mut start = 0.0;
        while let Some(t) = train.advance(&rates, start) {
            let [x, y] = self.array.at(self.pixel);
            let mark = train.wait(self.array.site(self.pixel), DrawSpace::Shot);
            let [from, to] = self.greys.map(f64::from);
            #[expect(clippy::cast_possible_truncation, reason = "a grey between two of 32 bits")]
            let grey = (from + (to - from) * (t / self.length)) as f32;
            let [on, off] = table.at(grey);
            // A product and no share of ON, which would be 0/0 at a grey without a floor.
            let polarity = if mark * (on + off) < on { Polarity::On } else { Polarity::Off };
            // An event at the earlier frame's own time belongs to the interval before it.
            #[expect(clippy::cast_possible_truncation, reason = "times between frames are below 2^56 ns")]
            let ns = self.start + (t as i64).max(1);
            let event = Event { t: Timestamp(ns), x, y, polarity, label: self.array.noise_label() };
            made.push(NextSpontaneous { event, hot: None });
            start = t;
        }
    }
}

/// Causes for which a pixel has fired.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct FiredCause {
    by_law: bool,
    by_itself: bool,
}

/// A spontaneous event that is due, ordered as in files.
#[derive(Debug)]
struct NextSpontaneous {
    event: Event,
    /// The process that goes on after it, if it is that of a hot pixel.
    hot: Option<HotTrain>,
}

/// The process of a hot pixel at one of its events.
#[derive(Debug, Clone, Copy)]
struct HotTrain {
    /// Time of the event, ns.
    at: f64,
    site: PixelSite,
    train: PoissonTrain,
}

impl PartialEq for NextSpontaneous {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for NextSpontaneous {}

impl PartialOrd for NextSpontaneous {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for NextSpontaneous {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |next: &Self| (next.event.file_order(), next.event.t);
        key(self).cmp(&key(other))
    }
}

/// Events of one pixel in one microsecond, the latest that were passed on.
#[derive(Debug, Default)]
struct CoincidentEvents {
    place: Option<(i64, u16, u16)>,
    all: u64,
    spontaneous: u64,
}

/// The spontaneous events that are known and not passed on yet.
#[derive(Debug)]
struct SpontaneousQueue {
    hot: HotPixelNoise,
    array: PixelArray,
    waiting: BinaryHeap<Reverse<NextSpontaneous>>,
    fired: Vec<FiredCause>,
    /// Stamp of the last frame.
    last: Timestamp,
    /// Number of ON events that were passed on.
    on: u64,
    /// Number of OFF events that were passed on.
    off: u64,
    together: CoincidentEvents,
    /// Number of pairs in one pixel and microsecond with at least one spontaneous event.
    pairs: u64,
    out: Vec<Event>,
}

impl SpontaneousQueue {
    fn new(hot: HotPixelNoise, array: PixelArray) -> Self {
        Self {
            hot,
            array,
            waiting: BinaryHeap::new(),
            fired: vec![FiredCause::default(); array.size.pixels()],
            last: Timestamp(0),
            on: 0,
            off: 0,
            together: CoincidentEvents::default(),
            pairs: 0,
            out: Vec::new(),
        }
    }

    /// Schedules the first event of each hot pixel.
    fn start_hot(&mut self) {
        for pixel in 0..self.array.size.pixels() {
            let site = self.array.site(pixel);
            self.wait(self.array.at(pixel), HotTrain { at: 0.0, site, train: self.hot.train(site) });
        }
    }

    /// Schedules the next event of a hot pixel.
    fn wait(&mut self, [x, y]: [u16; 2], hot: HotTrain) {
        let Some(gap) = hot.train.gap(self.hot.per_ns(hot.site)) else { return };
        let at = hot.at + gap;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "nanoseconds; what is beyond 64 bits is beyond any stamp"
        )]
        let t = Timestamp(at as i64);
        let event = Event { t, x, y, polarity: Polarity::On, label: self.array.noise_label() };
        self.waiting.push(Reverse(NextSpontaneous { event, hot: Some(HotTrain { at, ..hot }) }));
    }

    /// Adds spontaneous events to the output, in file order, as long as `holds` is true.
    fn take_until(&mut self, holds: impl Fn(&Event) -> bool) {
        while let Some(Reverse(next)) = self.waiting.peek() {
            if !holds(&next.event) {
                break;
            }
            let Some(Reverse(NextSpontaneous { event, hot })) = self.waiting.pop() else {
                break;
            };
            self.take(event, true);
            match event.polarity {
                Polarity::On => self.on += 1,
                Polarity::Off => self.off += 1,
            }
            if let Some(mut hot) = hot {
                hot.train.wait(hot.site, DrawSpace::Hot);
                self.wait([event.x, event.y], hot);
            }
        }
    }

    fn take(&mut self, event: Event, is_spontaneous: bool) {
        let place = Some((event.t.floor_micros(), event.y, event.x));
        if self.together.place != place {
            self.together = CoincidentEvents { place, ..CoincidentEvents::default() };
        }
        // A spontaneous event pairs with all events of its microsecond, an event of the law only with
        // spontaneous ones, because the law counts the pairs of its own events.
        self.pairs += if is_spontaneous { self.together.all } else { self.together.spontaneous };
        self.together.all += 1;
        self.together.spontaneous += u64::from(is_spontaneous);
        let fired = &mut self.fired[self.array.pixel(&event)];
        fired.by_itself |= is_spontaneous;
        fired.by_law |= !is_spontaneous;
        self.out.push(event);
    }

    /// Passes on the remaining spontaneous events up to the last stamp.
    fn append_rest(&mut self, sink: &mut dyn EventSink) -> io::Result<()> {
        // The process of a hot pixel has no end, so the last stamp cuts it off.
        let last = self.last;
        self.out.clear();
        self.take_until(|next| next.t <= last);
        sink.append(&self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorSettings;
    use crate::frames::array::{ArrayFrames, ArraySamples, FullScale};
    use crate::front_end::FrontEnd;
    use crate::noise::{FloorPoint, RefractoryPeriod};
    use crate::parameters::SensorParameters as _;
    use crate::simulate_one;
    use crate::voltmeter::{VoltmeterModel, VoltmeterPreset};
    use gs2e_image::Size;
    use gs2e_num::seed::Seed;
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
        let settings = SensorSettings { hot_pixels, ..SensorSettings::default() };
        VoltmeterModel { settings, ..VoltmeterModel::new([k1, k2, 0.0, 0.0, 0.0, 0.0]) }
    }

    fn wave(j: usize, p: usize) -> f32 {
        128.0 + 100.0 * libm::sinf(p as f32 + 0.7 * j as f32)
    }

    #[test]
    fn in_constant_light_only_hot_pixels_fire_as_often_as_stated() {
        let hot = HotPixelNoise { share: 0.2, rate: 5000.0, ..HotPixelNoise::default() };
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
        let hot = HotPixelNoise { share: 0.1, rate: 3000.0, ..HotPixelNoise::default() };
        let (alone, without) = run(&quiet(HotPixelNoise::default()), wave);
        let (merged, with) = run(&quiet(hot), wave);
        assert!(merged.is_sorted_by_key(Event::file_order));
        assert!(with.events > without.events && with.events == merged.len() as u64);
        assert_eq!((with.off, with.drift_violations), (without.off, 0));
        // All events of the law are present: without them, the merged stream is the spontaneous events.
        let key = |e: &Event| (e.file_order(), e.t);
        let mut spontaneous = merged.clone();
        spontaneous.sort_by_key(key);
        for event in &alone {
            let at = spontaneous.binary_search_by_key(&key(event), key).expect("it is there");
            spontaneous.remove(at);
        }
        assert_eq!(spontaneous.len() as u64, with.events - without.events);
        assert!(spontaneous.iter().all(|e| e.polarity == Polarity::On));
        // The same spontaneous events happen in constant light.
        let (mut dark, _) = run(&quiet(hot), |_, _| 90.0);
        dark.sort_by_key(key);
        assert_eq!(spontaneous, dark);
    }

    #[test]
    fn in_constant_light_the_floor_makes_both_polarities_as_often_as_stated() {
        let floor = NoiseFloor(vec![
            FloorPoint { lux: 1.0, on: 40.0, off: 100.0 },
            FloorPoint { lux: 100.0, on: 4.0, off: 10.0 },
        ]);
        let front_end = FrontEnd { lux: Some(100.0), ..FrontEnd::default() };
        let settings = SensorSettings { front_end, ..SensorSettings::default() };
        let noisy = VoltmeterModel { floor, settings, ..quiet(HotPixelNoise::default()) };
        // The left half sees 100 lux, the right half 1 lux.
        let (events, account) = run(&noisy, |_, p| if p % 40 < 20 { 255.0 } else { 2.55 });
        let seconds = 0.049 * SIZE.pixels() as f64 / 2.0;
        for (polarity, right, hz) in [
            (Polarity::On, false, 4.0),
            (Polarity::Off, false, 10.0),
            (Polarity::On, true, 40.0),
            (Polarity::Off, true, 100.0),
        ] {
            let count = events.iter().filter(|e| e.polarity == polarity && (e.x >= 20) == right).count();
            let wanted: f64 = hz * seconds;
            let z = (count as f64 - wanted) / wanted.sqrt();
            println!("{polarity:?}, right {right}: {count}, wanted {wanted:.1}, z {z:.2} (limit 4.5)");
            assert!(z.abs() < 4.5);
        }
        assert!(events.is_sorted_by_key(Event::file_order));
        assert_eq!((account.on + account.off, account.events), (account.events, events.len() as u64));
        let twin = noisy.without_noise();
        assert!(twin.as_voltmeter().unwrap().floor.is_absent());
    }

    #[test]
    fn the_dead_time_leaves_no_two_events_of_a_pixel_closer_than_it() {
        let refractory = RefractoryPeriod { period_us: 79.0, ..RefractoryPeriod::default() };
        let hot = HotPixelNoise { share: 0.2, rate: 5000.0, ..HotPixelNoise::default() };
        let (all, _) = run(&quiet(hot), wave);
        let settings = SensorSettings { refractory, ..quiet(hot).settings };
        let (apart, account) = run(&VoltmeterModel { settings, ..quiet(hot) }, wave);
        let least = |events: &[Event]| {
            let mut times: Vec<_> = events.iter().map(|e| (e.y, e.x, e.t.floor_micros())).collect();
            times.sort_unstable();
            times.windows(2).filter(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1)).map(|w| w[1].2 - w[0].2).min()
        };
        assert!(least(&all) < Some(79) && least(&apart) >= Some(79), "{:?}", least(&apart));
        assert_eq!(account.refractory, (all.len() - apart.len()) as u64);
        assert_eq!((account.events, account.same_us_same_pixel), (apart.len() as u64, 0));
    }
}
