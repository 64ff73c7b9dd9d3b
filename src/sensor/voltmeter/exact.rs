//! The exact law over all pixels: frames come in, windows of time go out.
//!
//! With noise a window is a root cell of the clock; without, it is the time between two frames. A window is crossed
//! once the frames that span it are there, by bands of rows in parallel: a pixel's events depend on nothing but its own
//! luminance, so neither the bands nor their order can show.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixel coordinates are below 2^16; times within a window are below 2^31 ns"
)]

use super::Voltmeter;
use super::bridge::Barriers;
use super::cell::{Emit, LEVELS, ROOT, Scratch, Walk};
use super::drift::{Path, Piece, Process, Sample};
use super::noiseless;
use crate::event::{EventSink, Polarity};
use crate::frames::Frame;
use crate::image::Size;
use crate::seed::Seed;
use crate::sensor::window::{LONGEST, Packed, Windows};
use crate::sensor::{Account, Pixels, SensorError};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::ops::ControlFlow;

/// Version of the law: raised when a clock, a constant or a draw changes.
pub(super) const VERSION: u32 = 1;

/// Stamps end here, so that the number of a root cell's nanosecond fits the counter of the draws: 2.3 years.
const LAST_STAMP: i64 = 1 << 56;

/// State of the exact law.
#[derive(Debug)]
pub(super) struct Exact {
    law: Law,
    frames: VecDeque<Stored>,
    pixels: Vec<Pixel>,
    bands: Vec<Band>,
    /// Windows are crossed up to here, ns.
    crossed: i64,
    windows: Windows,
    account: Account,
}

/// What does not change.
#[derive(Debug)]
struct Law {
    process: Process,
    barriers: Barriers,
    cap: u32,
    size: Size,
    origin: [u16; 2],
    seed: Seed,
}

/// A frame that windows still need.
#[derive(Debug)]
struct Stored {
    index: usize,
    t: i64,
    samples: Vec<Sample>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    /// In thresholds, between the barriers.
    voltage: f64,
    /// Drift since the first frame, from the frames alone.
    drift: f64,
    /// Of the noise since the first frame.
    variance: f64,
    on: u32,
    off: u32,
    /// Number of the frame that precedes its latest event, and how many events have come since.
    frame: u32,
    since: u32,
}

/// A band of rows that one thread crosses: its buffers and what it counts.
#[derive(Debug, Default)]
struct Band {
    path: Path,
    scratch: Scratch,
    events: Vec<Packed>,
    most: u32,
    capped: Option<SensorError>,
}

/// One window of time.
struct Window<'a> {
    law: &'a Law,
    frames: &'a VecDeque<Stored>,
    pieces: Vec<Piece>,
    /// ns since the first stamp.
    start: i64,
    /// Later events, in ns since `start`, are dropped.
    last: f64,
}

impl Exact {
    pub(super) fn new(sensor: &Voltmeter, size: Size, origin: [u16; 2], seed: Seed) -> Self {
        let barriers = Barriers { up: sensor.threshold_on, down: sensor.threshold_off };
        let cap = sensor.max_events_per_pixel_frame;
        let law = Law { process: Process::new(sensor), barriers, cap, size, origin, seed };
        let bands = (size.height as usize).div_ceil(law.rows_per_band());
        Self {
            law,
            frames: VecDeque::new(),
            pixels: vec![Pixel::default(); size.pixels()],
            bands: std::iter::repeat_with(Band::default).take(bands).collect(),
            crossed: 0,
            windows: Windows::default(),
            account: Account::default(),
        }
    }

    /// The end of the next window that begins before `until`.
    fn window_end(&self, until: i64) -> i64 {
        if self.law.process.is_noiseless() {
            let next = self.frames.iter().map(|frame| frame.t).find(|&t| t > self.crossed);
            next.unwrap_or(until).min(self.crossed + LONGEST)
        } else {
            self.crossed + ROOT
        }
    }

    /// Crosses every window that ends by `until`.
    fn cross_until(&mut self, until: i64, last: i64, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        while self.crossed < until {
            let end = self.window_end(until);
            if end > until {
                break;
            }
            self.cross_window(end, last)?;
            self.windows.close(end.div_euclid(1000), sink)?;
            self.crossed = end;
            while self.frames.len() > 1 && self.frames[1].t <= end {
                self.frames.pop_front();
            }
        }
        Ok(())
    }

    fn cross_window(&mut self, end: i64, last: i64) -> Result<(), SensorError> {
        let start = self.crossed;
        let window = Window {
            law: &self.law,
            frames: &self.frames,
            pieces: pieces(&self.frames, start, end),
            start,
            last: last.saturating_sub(start) as f64,
        };
        let rows = self.law.rows_per_band();
        self.pixels
            .par_chunks_mut(rows * self.law.size.width as usize)
            .zip(&mut self.bands)
            .enumerate()
            .for_each(|(band, (pixels, state))| window.cross_band(band * rows, pixels, state));
        for band in &mut self.bands {
            if let Some(error) = band.capped.take() {
                return Err(error);
            }
            self.windows.add(&mut band.events);
        }
        Ok(())
    }

    /// Checks and converts a frame.
    fn store(&mut self, frame: &Frame) -> Result<Stored, SensorError> {
        let refuse = |because| SensorError::Frame { frame: frame.index, because };
        follows(self.frames.back(), frame, self.law.size).map_err(refuse)?;
        let width = self.law.size.width as usize;
        let luminance = frame.luminance.pixels();
        if let Some(bad) = luminance.iter().position(|l| !l.is_finite()) {
            let (x, y, found) = (bad % width, bad / width, luminance[bad]);
            return Err(refuse(format!("the luminance of pixel ({x}, {y}) is {found}, not a finite number")));
        }
        self.account.negative_luminance += luminance.iter().filter(|l| **l < 0.0).count() as u64;
        let process = &self.law.process;
        let before = self.frames.back().map(|stored| stored.samples.as_slice());
        let samples = luminance
            .par_iter()
            .enumerate()
            .with_min_len(4096)
            .map(|(i, &l)| sample(process, l.max(0.0), before.map(|before| before[i])))
            .collect();
        Ok(Stored { index: frame.index, t: frame.t.0, samples })
    }

    /// Adds the drift since the previous frame to each pixel's account.
    fn count_drift(&mut self, frame: &Stored) {
        let Some(before) = self.frames.back() else { return };
        let length = (frame.t - before.t) as f64;
        let process = &self.law.process;
        self.pixels.par_iter_mut().with_min_len(4096).enumerate().for_each(|(i, pixel)| {
            pixel.drift += process.between(before.samples[i], frame.samples[i], length).rise(length);
        });
    }
}

/// The sample of one pixel, from that of the frame before where nothing changed.
fn sample(process: &Process, luminance: f32, before: Option<Sample>) -> Sample {
    match before {
        Some(before) if before.luminance.to_bits() == luminance.to_bits() => before,
        _ => Sample { luminance, log: process.log_brightness(luminance) },
    }
}

/// Whether the frame can come after `before`.
fn follows(before: Option<&Stored>, frame: &Frame, size: Size) -> Result<(), String> {
    let found = frame.luminance.size();
    if found != size {
        return Err(format!("it is {found}, the sequence is {size}"));
    }
    match before {
        None if frame.t.0 != 0 => Err(format!("the first stamp is {} ns, not 0", frame.t.0)),
        Some(before) if frame.t.0 <= before.t => {
            Err(format!("its stamp {} ns does not follow {} ns", frame.t.0, before.t))
        }
        _ if frame.t.0 >= LAST_STAMP => Err(format!("its stamp {} ns is beyond {LAST_STAMP} ns", frame.t.0)),
        _ => Ok(()),
    }
}

/// The pieces of the window from `start` to `end`.
fn pieces(frames: &VecDeque<Stored>, start: i64, end: i64) -> Vec<Piece> {
    let mut pieces = Vec::with_capacity(frames.len());
    for (frame, stored) in frames.iter().enumerate() {
        let next = frames.get(frame + 1).map(|next| next.t);
        let (from, to) = (stored.t.max(start), next.unwrap_or(i64::MAX).min(end));
        if from < to {
            pieces.push(Piece {
                frame,
                followed: next.is_some(),
                length: next.map_or(f64::INFINITY, |next| (next - stored.t) as f64),
                skipped: (from - stored.t) as f64,
                from: (from - start) as f64,
                to: (to - start) as f64,
            });
        }
    }
    pieces
}

impl Law {
    fn rows_per_band(&self) -> usize {
        const PIXELS: usize = 4096;
        (PIXELS / self.size.width.max(1) as usize).max(1)
    }
}

impl Window<'_> {
    fn cross_band(&self, first_row: usize, pixels: &mut [Pixel], band: &mut Band) {
        let width = self.law.size.width as usize;
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let at = [(i % width) as u16, (first_row + i / width) as u16];
            if self.cross_pixel(at, pixel, band).is_break() {
                return;
            }
        }
    }

    fn cross_pixel(&self, at: [u16; 2], pixel: &mut Pixel, band: &mut Band) -> ControlFlow<()> {
        let law = self.law;
        let i = usize::from(at[1]) * law.size.width as usize + usize::from(at[0]);
        let Band { path, scratch, events, most, capped } = band;
        self.load(i, path);
        let middle = 0.5 * ROOT as f64;
        let part = path.part(middle);
        let sigma = law.process.sigma(law.process.luminance(&part.smooth, middle - part.from));
        let mut voltage = pixel.voltage;
        let mut writer = Writer { window: self, at, i, pixel, events, most, capped };
        if law.process.is_noiseless() || sigma <= 0.0 {
            noiseless::cross(law.barriers, &mut voltage, path, &mut writer)?;
        } else {
            let [x, y] = law.origin;
            let walk = Walk {
                seed: law.seed,
                at: [at[0] + x, at[1] + y],
                root: (self.start >> LEVELS).cast_unsigned(),
                barriers: law.barriers,
                sigma,
                path,
            };
            walk.cross(&mut voltage, scratch, &mut writer)?;
            pixel.variance += sigma * sigma * self.last.min(ROOT as f64);
        }
        pixel.voltage = voltage;
        ControlFlow::Continue(())
    }

    /// The drift of pixel `i` over the window.
    fn load(&self, i: usize, path: &mut Path) {
        path.clear();
        for piece in &self.pieces {
            let sample = self.frames[piece.frame].samples[i];
            let smooth = if piece.followed {
                self.law.process.between(sample, self.frames[piece.frame + 1].samples[i], piece.length)
            } else {
                self.law.process.after(sample)
            };
            path.push(piece, smooth);
        }
    }
}

/// Writes down the events of one pixel.
struct Writer<'a> {
    window: &'a Window<'a>,
    at: [u16; 2],
    i: usize,
    pixel: &'a mut Pixel,
    events: &'a mut Vec<Packed>,
    most: &'a mut u32,
    capped: &'a mut Option<SensorError>,
}

impl Emit for Writer<'_> {
    fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
        if t > self.window.last {
            return ControlFlow::Continue(());
        }
        self.count(t)?;
        match polarity {
            Polarity::On => self.pixel.on += 1,
            Polarity::Off => self.pixel.off += 1,
        }
        let ns = t as u64 + self.window.start.rem_euclid(1000).cast_unsigned();
        self.events.push(Packed::new(ns, self.at, polarity));
        ControlFlow::Continue(())
    }
}

impl Writer<'_> {
    /// Counts an event against the cap; one at a stamp belongs to the frames before it.
    fn count(&mut self, t: f64) -> ControlFlow<()> {
        let pieces = &self.window.pieces;
        let piece = pieces.iter().find(|piece| t <= piece.to).unwrap_or(&pieces[pieces.len() - 1]);
        let before = &self.window.frames[piece.frame];
        let frame = before.index as u32;
        self.pixel.since = if self.pixel.frame == frame { self.pixel.since + 1 } else { 1 };
        self.pixel.frame = frame;
        *self.most = self.pixel.since.max(*self.most);
        if self.pixel.since <= self.window.law.cap {
            return ControlFlow::Continue(());
        }
        let after = self.window.frames.get(piece.frame + 1).unwrap_or(before);
        *self.capped = Some(SensorError::Cap {
            x: self.at[0],
            y: self.at[1],
            frame: before.index,
            before: before.samples[self.i].luminance,
            after: after.samples[self.i].luminance,
            cap: self.window.law.cap,
        });
        ControlFlow::Break(())
    }
}

impl Pixels for Exact {
    fn advance(&mut self, frame: &Frame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        let stored = self.store(frame)?;
        self.count_drift(&stored);
        let t = stored.t;
        self.frames.push_back(stored);
        self.cross_until(t, i64::MAX, sink)
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<Account, SensorError> {
        let last = self.frames.back().map_or(0, |frame| frame.t);
        let end = if self.law.process.is_noiseless() { last } else { (last + ROOT - 1) & !(ROOT - 1) };
        self.cross_until(end, last, sink)?;
        self.windows.close(end.div_euclid(1000) + 1, sink)?;
        Ok(self.settle())
    }
}

impl Exact {
    /// The account of the run.
    fn settle(&self) -> Account {
        let mut account = self.account;
        let Barriers { up, down } = self.law.barriers;
        for pixel in &self.pixels {
            account.on += u64::from(pixel.on);
            account.off += u64::from(pixel.off);
            account.active_pixels += u64::from(pixel.on + pixel.off > 0);
            let balance = up * f64::from(pixel.on) - down * f64::from(pixel.off) - pixel.drift;
            let share = balance.abs() / (up.max(down) + 6.0 * pixel.variance.sqrt());
            account.drift_worst = account.drift_worst.max(share);
            account.drift_violations += u64::from(share > 1.0);
        }
        account.events = account.on + account.off;
        account.same_us_same_pixel = self.windows.same_us_same_pixel;
        for band in &self.bands {
            account.leaves += band.scratch.leaves;
            account.splits += band.scratch.splits;
            account.max_per_pixel_frame = account.max_per_pixel_frame.max(u64::from(band.most));
        }
        account
    }
}
