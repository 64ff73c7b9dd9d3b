//! Sensors that work from frame to frame: a pixel knows two frames when it crosses the time between
//! them.
//!
//! The pixels are crossed by bands of rows in parallel. The events of a pixel depend on its own
//! luminance, its position on the sensor, the seed and the frame index only. Bands, threads and
//! crops therefore do not change them.
#![expect(
    clippy::cast_possible_truncation,
    reason = "pixel coordinates are below 2^16; times between two frames are below 2^56 ns"
)]

use super::chain::PixelArray;
use super::noise::PixelSite;
use super::window::{EventWindow, MAX_WINDOW_NS, PackedEvent};
use super::{SensorError, SensorPixels, SensorSettings, SimulationAccount, input};
use crate::frames::DenseFrame;
use gs2e_event::{EventLabel, EventSink, Polarity};
use gs2e_num::seed::DrawSpace;
use gs2e_num::seed::eight::SeedCells;
use rayon::prelude::*;
use std::fmt::Debug;
use std::ops::ControlFlow;

/// Nanoseconds in a second.
const NS: f64 = 1e9;

/// Number of pixels that one thread takes at a time. The last band may be shorter.
const BAND: usize = 4096;

/// A sensor's law between two frames.
pub(super) trait FrameLaw: Debug + Send + Sync {
    /// State of one pixel.
    type Pixel: Debug + Send + Sync;

    /// Turns the luminance of pixels, 0..255, into the brightness that they compare. The pixels of a band
    /// come at once, so that a logarithm can be computed for several of them.
    fn to_brightness(&self, luminance: &mut [f64]);

    /// The draws whose first one each pixel uses in each frame as a normal deviate, if the law has such
    /// draws.
    fn deviates(&self) -> Option<DrawSpace> {
        None
    }

    /// The pixel at its first frame, of this luminance and brightness.
    fn begin(&self, site: PixelSite, luminance: f64, brightness: f64) -> Self::Pixel;

    /// Moves a pixel from one frame to the next, and notes its events. Breaks if the writer breaks.
    fn cross(
        &self,
        pixel: &mut Self::Pixel,
        pair: &PixelPair,
        writer: &mut PairWriter<'_>,
    ) -> ControlFlow<()>;

    /// Difference between the pixel's event balance and the change of its brightness, relative to
    /// the bound that the law guarantees. `None` if the law guarantees none.
    fn imbalance(&self, pixel: &Self::Pixel, on: u32, off: u32) -> Option<f64>;
}

/// One pixel between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelPair {
    pub(super) site: PixelSite,
    /// Index of the earlier frame.
    pub(super) frame: u64,
    /// Time between the frames, ns, as a whole number.
    pub(super) length: f64,
    /// The same, s.
    pub(super) seconds: f64,
    /// Luminance at both frames, 0..255.
    pub(super) luminance: [f64; 2],
    /// Brightness at the later frame ([`FrameLaw::to_brightness`]).
    pub(super) brightness: f64,
    /// The normal deviate of [`FrameLaw::deviates`]; 0 for a law without them.
    pub(super) deviate: f64,
}

/// Limit on the events of a pixel between two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct EventCap {
    pub(super) most: u32,
    /// True if further events are dropped and counted. Otherwise they fail the run.
    pub(super) leave_out: bool,
}

/// An event between two frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotedEvent {
    /// ns since the earlier frame.
    pub(super) ns: i64,
    at: [u16; 2],
    pub(super) polarity: Polarity,
    label: EventLabel,
}

/// A pixel's event counts so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct EventTally {
    on: u32,
    off: u32,
}

/// Notes the events of one pixel between two frames.
#[derive(Debug)]
pub(super) struct PairWriter<'a> {
    events: &'a mut Vec<NotedEvent>,
    tally: &'a mut EventTally,
    cap: EventCap,
    at: [u16; 2],
    made: u32,
    left_out: u64,
}

impl<'a> PairWriter<'a> {
    pub(super) fn new(
        events: &'a mut Vec<NotedEvent>,
        tally: &'a mut EventTally,
        cap: EventCap,
        at: [u16; 2],
    ) -> Self {
        Self { events, tally, cap, at, made: 0, left_out: 0 }
    }

    /// The whole nanosecond of an event `t` ns after the earlier frame. An event at the earlier
    /// frame's own time gets the first nanosecond after it.
    pub(super) fn nanosecond(t: f64) -> i64 {
        // An interval contains its end but not its start, which belongs to the interval before.
        (t as i64).max(1)
    }

    /// Notes an event `t` ns after the earlier frame, and returns its nanosecond. Breaks at the
    /// cap.
    pub(super) fn event(&mut self, t: f64, polarity: Polarity, label: EventLabel) -> ControlFlow<(), i64> {
        let ns = Self::nanosecond(t);
        if self.made == self.cap.most {
            if !self.cap.leave_out {
                return ControlFlow::Break(());
            }
            // The caller goes on as after an event that is passed on: its reference and its dead
            // time move, so the cap does not change which events come later.
            self.left_out += 1;
            return ControlFlow::Continue(ns);
        }
        self.made += 1;
        match polarity {
            Polarity::On => self.tally.on += 1,
            Polarity::Off => self.tally.off += 1,
        }
        self.events.push(NotedEvent { ns, at: self.at, polarity, label });
        ControlFlow::Continue(ns)
    }
}

/// State of a sensor with a frame-to-frame law.
#[derive(Debug)]
pub(super) struct PairPixels<L: FrameLaw> {
    law: L,
    cap: EventCap,
    array: PixelArray,
    before: Option<LatestFrame>,
    pixels: Vec<L::Pixel>,
    tally: Vec<EventTally>,
    bands: Vec<PairBand>,
    windows: EventWindow,
    negative_luminance: u64,
}

/// The latest frame.
#[derive(Debug)]
struct LatestFrame {
    index: usize,
    t: i64,
    luminance: Vec<f32>,
}

/// Working memory of one thread, and its results.
#[derive(Debug, Default)]
struct PairBand {
    events: Vec<NotedEvent>,
    /// Brightness of each pixel at the later frame.
    brightness: Vec<f64>,
    /// Coordinates of each pixel, and its normal deviate; empty for a law without deviates.
    sites: Vec<u64>,
    deviates: Vec<f64>,
    most: u32,
    left_out: u64,
    /// The first pixel above the cap.
    over: Option<usize>,
}

/// A run of neighbouring pixels.
struct PixelRun<'a, P> {
    /// Index of the first pixel.
    first: usize,
    pixels: &'a mut [P],
    tally: &'a mut [EventTally],
    luminance: [&'a [f32]; 2],
}

impl<L: FrameLaw> PairPixels<L> {
    /// The pixels of a law, with the cap of `settings`.
    pub(super) fn new(law: L, settings: &SensorSettings, array: PixelArray) -> Self {
        let n = array.size.pixels();
        Self {
            law,
            cap: EventCap { most: settings.max_events_per_pixel_frame, leave_out: settings.allow_cap },
            array,
            before: None,
            pixels: Vec::new(),
            tally: vec![EventTally::default(); n],
            // One per chunk of pixels. The parallel iteration over all lists ends with the shortest
            // one.
            bands: std::iter::repeat_with(PairBand::default).take(n.div_ceil(BAND)).collect(),
            windows: EventWindow::default(),
            negative_luminance: 0,
        }
    }

    fn begin(&mut self, luminance: &[f32]) {
        let seen: Vec<f64> = luminance.iter().map(|l| f64::from(l.max(0.0))).collect();
        let mut brightness = seen.clone();
        self.law.to_brightness(&mut brightness);
        let pixel = |(i, (l, b)): (usize, (&f64, &f64))| self.law.begin(self.array.site(i), *l, *b);
        self.pixels = seen.par_iter().zip(&brightness).enumerate().map(pixel).collect();
    }

    /// Crosses the time between two frames.
    fn cross(&mut self, before: &LatestFrame, frame: &DenseFrame) -> Result<(), SensorError> {
        // Taken out of `self`: the threads change them while they read the law and the size in
        // `self`.
        let (mut pixels, mut tally) = (std::mem::take(&mut self.pixels), std::mem::take(&mut self.tally));
        let mut bands = std::mem::take(&mut self.bands);
        let after = frame.luminance.pixels();
        let length = (frame.t.0 - before.t) as f64;
        let chunks = (
            pixels.par_chunks_mut(BAND),
            tally.par_chunks_mut(BAND),
            before.luminance.par_chunks(BAND),
            after.par_chunks(BAND),
            bands.par_iter_mut(),
        );
        chunks.into_par_iter().enumerate().for_each(|(i, (pixels, tally, from, to, band))| {
            let slice = PixelRun { first: i * BAND, pixels, tally, luminance: [from, to] };
            self.cross_band(slice, before.index as u64, length, band);
        });
        // In order of pixels, so that the message names the same pixel for any number of threads.
        let over = bands.iter().find_map(|band| band.over);
        (self.pixels, self.tally, self.bands) = (pixels, tally, bands);
        let Some(pixel) = over else { return Ok(()) };
        let [x, y] = self.array.at(pixel);
        let (frame, cap) = (before.index, self.cap.most);
        Err(SensorError::Cap { x, y, frame, before: before.luminance[pixel], after: after[pixel], cap })
    }

    fn cross_band(&self, slice: PixelRun<'_, L::Pixel>, frame: u64, length: f64, band: &mut PairBand) {
        let PixelRun { first, pixels, tally, luminance: [from, to] } = slice;
        band.brightness.clear();
        band.brightness.extend(to.iter().map(|l| f64::from(l.max(0.0))));
        self.law.to_brightness(&mut band.brightness);
        if let Some(space) = self.law.deviates() {
            band.sites.clear();
            band.sites.extend((first..first + pixels.len()).map(|i| self.array.site(i).number()));
            let cells = SeedCells { seed: self.array.seed, space, level: 0, index: frame };
            cells.first_normals(&band.sites, &mut band.deviates);
        }
        let seconds = length / NS;
        for (i, (pixel, tally)) in pixels.iter_mut().zip(tally).enumerate() {
            let luminance = [from[i], to[i]].map(|l| f64::from(l.max(0.0)));
            let (brightness, deviate) = (band.brightness[i], band.deviates.get(i).copied().unwrap_or(0.0));
            let pair = PixelPair {
                site: self.array.site(first + i),
                frame,
                length,
                seconds,
                luminance,
                brightness,
                deviate,
            };
            let mut writer = PairWriter::new(&mut band.events, tally, self.cap, self.array.at(first + i));
            let broken = self.law.cross(pixel, &pair, &mut writer).is_break();
            band.most = band.most.max(writer.made);
            band.left_out += writer.left_out;
            // The rest of the band is left as it is, because an error ends the run.
            if broken {
                band.over = Some(first + i);
                return;
            }
        }
    }

    /// Passes on the events between two frames, up to the microsecond of the later one.
    fn hand_over(&mut self, from: i64, to: i64, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        let mut noted: Vec<NotedEvent> = Vec::new();
        self.bands.iter_mut().for_each(|band| noted.append(&mut band.events));
        if !self.array.labels {
            noted.iter_mut().for_each(|event| event.label = EventLabel::Signal);
        }
        // Only a division into several windows needs the order of time: it is made by binary
        // search.
        if to - from > MAX_WINDOW_NS {
            noted.sort_unstable_by_key(|event| event.ns);
        }
        let (mut rest, mut start) = (&noted[..], from);
        while start < to {
            let end = to.min(start + MAX_WINDOW_NS);
            // A single window has nothing to merge with, so sorting is left to the sink.
            let count = if end == to { rest.len() } else { rest.partition_point(|e| from + e.ns <= end) };
            let (now, later) = rest.split_at(count);
            // Events are packed relative to a whole microsecond, and `start` may lie inside one.
            let since = start.div_euclid(1000) * 1000;
            let ns = |e: &NotedEvent| (from + e.ns - since).cast_unsigned();
            let pack = |e: &NotedEvent| PackedEvent::new(ns(e), e.at, e.polarity, e.label);
            self.windows.add(&mut now.iter().map(pack).collect());
            self.windows.close(end.div_euclid(1000), sink)?;
            (rest, start) = (later, end);
        }
        noted.clear();
        // The memory of the joined list serves the next pair of frames.
        if let Some(band) = self.bands.first_mut() {
            band.events = noted;
        }
        Ok(())
    }

    /// The counts of the run.
    fn settle(&self) -> SimulationAccount {
        let mut account =
            SimulationAccount { negative_luminance: self.negative_luminance, ..SimulationAccount::default() };
        for (tally, pixel) in self.tally.iter().zip(&self.pixels) {
            let imbalance = self.law.imbalance(pixel, tally.on, tally.off);
            account.add_pixel(tally.on, tally.off, imbalance.unwrap_or(0.0));
        }
        account.events = account.on + account.off;
        account.same_us_same_pixel = self.windows.same_us_same_pixel;
        for band in &self.bands {
            account.capped += band.left_out;
            account.max_per_pixel_frame = account.max_per_pixel_frame.max(u64::from(band.most));
        }
        account
    }
}

impl<L: FrameLaw> SensorPixels for PairPixels<L> {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        let before = self.before.take();
        self.negative_luminance += input::admit_frame(before.as_ref().map(|b| b.t), frame, self.array.size)?;
        let luminance = frame.luminance.pixels();
        // The list of the earlier frame is filled again, so that a frame allocates none.
        let mut stored = match before {
            None => {
                self.begin(luminance);
                LatestFrame { index: 0, t: 0, luminance: Vec::new() }
            }
            Some(before) => {
                self.cross(&before, frame)?;
                self.hand_over(before.t, frame.t.0, sink)?;
                before
            }
        };
        (stored.index, stored.t) = (frame.index, frame.t.0);
        stored.luminance.clear();
        stored.luminance.extend_from_slice(luminance);
        self.before = Some(stored);
        Ok(())
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let last = self.before.as_ref().map_or(0, |before| before.t);
        // One microsecond further, because no later window will complete the one of the last stamp.
        self.windows.close(last.div_euclid(1000) + 1, sink)?;
        Ok(self.settle())
    }
}
