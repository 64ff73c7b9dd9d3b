//! A band of pixels in one window of time: most of them cross it in one step, the rest go down the tree.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixel coordinates are below 2^16; times within a window are below 2^31 ns"
)]

use super::bridge::{Barriers, Live};
use super::cell::{Emit, LEVELS, Scratch, Walk, root_noise};
use super::drift::{Part, Path, Smooth};
use super::exact::{Law, Stored};
use super::noiseless;
use crate::event::Polarity;
use crate::sensor::window::Packed;
use crate::sensor::{Account, SensorError};
use std::ops::ControlFlow;

/// What a thread needs to cross bands, and what it counts.
#[derive(Debug, Default)]
pub(super) struct Band {
    /// Pixels of the band that some barrier may stop.
    live: Vec<usize>,
    path: Path,
    pub(super) scratch: Scratch,
    pub(super) events: Vec<Packed>,
    /// Most events of one pixel between two frames.
    pub(super) most: u32,
    pub(super) capped: Option<SensorError>,
}

/// The state of the pixels of a band.
#[derive(Debug)]
pub(super) struct Slice<'a> {
    /// Number of the first pixel.
    pub(super) first: usize,
    pub(super) voltage: &'a mut [f64],
    pub(super) drift: &'a mut [f64],
    pub(super) variance: &'a mut [f64],
    pub(super) tally: &'a mut [Tally],
}

/// One window of time.
#[derive(Debug)]
pub(super) struct Window<'a> {
    law: &'a Law,
    frames: Vec<&'a Stored>,
    pieces: Vec<Piece>,
    middle: Place,
    end: Place,
    /// ns since the first stamp.
    start: i64,
    length: f64,
    /// Later events, in ns since `start`, are dropped.
    last: f64,
}

/// The part of a window between two frames, or after the last.
#[derive(Debug, Clone, Copy)]
struct Piece {
    begin: Place,
    /// ns since the window's start.
    from: f64,
    to: f64,
}

/// An instant, by the frame before it.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Position of that frame among those that are kept.
    frame: usize,
    /// ns since that frame.
    after: f64,
    /// One over the time to the next frame; 0 after the last.
    inverse: f64,
}

impl Place {
    fn new(frames: &[&Stored], t: i64) -> Self {
        let frame = frames.partition_point(|frame| frame.t <= t) - 1;
        let here = frames[frame].t;
        let inverse = frames.get(frame + 1).map_or(0.0, |next| 1.0 / (next.t - here) as f64);
        Self { frame, after: (t - here) as f64, inverse }
    }

    fn is_at_frame(self) -> bool {
        self.after == 0.0 || self.inverse == 0.0
    }
}

/// What happens to a pixel in a window if no barrier stops it.
struct Crossing {
    voltage: f64,
    /// Drift since the first frame, at the window's end.
    drift: f64,
    /// Noise per square root of a nanosecond.
    sigma: f64,
    live: Live,
}

impl<'a> Window<'a> {
    /// The window from `start` to `end`, in ns, which the first frame does not follow.
    pub(super) fn new(law: &'a Law, frames: Vec<&'a Stored>, [start, end]: [i64; 2], last: i64) -> Self {
        let inner = frames.iter().map(|frame| frame.t).filter(|&t| start < t && t < end);
        let cuts: Vec<i64> = std::iter::once(start).chain(inner).chain([end]).collect();
        let since_start = |t: i64| (t - start) as f64;
        let piece = |cut: &[i64]| Piece {
            begin: Place::new(&frames, cut[0]),
            from: since_start(cut[0]),
            to: since_start(cut[1]),
        };
        Self {
            law,
            pieces: cuts.windows(2).map(piece).collect(),
            middle: Place::new(&frames, start + (end - start) / 2),
            end: Place::new(&frames, end),
            start,
            length: since_start(end),
            last: last.saturating_sub(start) as f64,
            frames,
        }
    }

    /// Crosses the window with every pixel of a band.
    pub(super) fn cross(&self, slice: Slice<'_>, band: &mut Band) {
        let Slice { first, voltage, drift, variance, tally } = slice;
        let mut live = std::mem::take(&mut band.live);
        live.clear();
        let observed = self.length.min(self.last);
        for i in 0..voltage.len() {
            let crossing = self.straight(first + i, voltage[i], drift[i]);
            variance[i] += crossing.sigma * crossing.sigma * observed;
            if crossing.live == Live::Neither {
                (voltage[i], drift[i]) = (crossing.voltage, crossing.drift);
            } else {
                live.push(i);
            }
        }
        for &i in &live {
            let pixel = first + i;
            if self.walk(pixel, &mut voltage[i], &mut drift[i], &mut tally[i], band).is_break() {
                break;
            }
        }
        band.live = live;
    }

    /// The crossing in one step. It asks more of a quiet pixel than the law does, never less.
    fn straight(&self, pixel: usize, voltage: f64, drift: f64) -> Crossing {
        let end = self.drift_at(self.end, pixel);
        let sigma = self.sigma(pixel);
        let noise = if sigma > 0.0 {
            sigma * root_noise(self.law.seed, self.law.at_sensor(pixel), self.root())
        } else {
            0.0
        };
        let y = voltage + (end - drift) + noise;
        let straying = self.straying_at_most(pixel, drift, end);
        let live = self.law.barriers.shrunk(straying).live(voltage, y, sigma * sigma * self.length);
        Crossing { voltage: y, drift: end, sigma, live }
    }

    /// The crossing by way of the law.
    fn walk(
        &self,
        pixel: usize,
        voltage: &mut f64,
        drift: &mut f64,
        tally: &mut Tally,
        band: &mut Band,
    ) -> ControlFlow<()> {
        let Band { path, scratch, events, most, capped, .. } = band;
        let end = self.drift_at(self.end, pixel);
        path.fill(self.pieces.iter().map(|piece| self.part(piece, pixel, *drift)), end - *drift);
        *drift = end;
        let sigma = self.sigma(pixel);
        let mut writer = Writer { window: self, pixel, tally, events, most, capped };
        if sigma > 0.0 {
            let at = self.law.at_sensor(pixel);
            let walk =
                Walk { seed: self.law.seed, at, root: self.root(), barriers: self.law.barriers, sigma, path };
            walk.cross(voltage, scratch, &mut writer)
        } else {
            noiseless::cross(self.law.barriers, voltage, path, &mut writer)
        }
    }

    /// The drift of a pixel along a piece, from `drift` at the window's start.
    fn part(&self, piece: &Piece, pixel: usize, drift: f64) -> Part {
        let smooth = self.smooth(piece.begin, pixel);
        let Piece { begin, from, to } = *piece;
        if begin.after == 0.0 {
            Part { from, to, at: self.frames[begin.frame].drift[pixel] - drift, smooth }
        } else {
            Part { from, to, at: 0.0, smooth: smooth.from(begin.after) }
        }
    }

    /// The drift of a pixel between the frames around a place, from the earlier one.
    fn smooth(&self, place: Place, pixel: usize) -> Smooth {
        let from = self.frames[place.frame].sample(pixel);
        if place.inverse == 0.0 {
            return self.law.process.after(from);
        }
        self.law.process.between(from, self.frames[place.frame + 1].sample(pixel), place.inverse)
    }

    /// Drift since the first frame.
    fn drift_at(&self, place: Place, pixel: usize) -> f64 {
        let drift = self.frames[place.frame].drift[pixel];
        if place.is_at_frame() { drift } else { drift + self.smooth(place, pixel).rise(place.after) }
    }

    /// The noise of the window, per square root of a nanosecond: that of its middle.
    fn sigma(&self, pixel: usize) -> f64 {
        let process = &self.law.process;
        if process.is_noiseless() {
            return 0.0;
        }
        process.sigma(process.luminance(&self.smooth(self.middle, pixel), self.middle.after))
    }

    /// A bound on the drift's distance from its chord, cheaper and looser than that of a path.
    fn straying_at_most(&self, pixel: usize, drift: f64, end: f64) -> f64 {
        let slope = (end - drift) / self.length;
        let (mut knots, mut bows) = (0.0f64, 0.0f64);
        for piece in &self.pieces {
            let Place { frame, after, inverse } = piece.begin;
            if after == 0.0 {
                knots = knots.max((self.frames[frame].drift[pixel] - drift - slope * piece.from).abs());
            }
            if inverse > 0.0 {
                let [from, to] = [frame, frame + 1].map(|frame| self.frames[frame].luminance[pixel]);
                bows = bows.max(self.law.process.bow(from, to, piece.to - piece.from));
            }
        }
        knots + bows
    }

    /// Number of the root cell.
    fn root(&self) -> u64 {
        (self.start >> LEVELS).cast_unsigned()
    }
}

/// What one pixel's events were.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    on: u32,
    off: u32,
    /// Number of the frame that precedes the latest event, and the events that followed it.
    frame: u32,
    since: u32,
}

impl Tally {
    /// Adds a pixel to the account. What its events have taken from the voltage differs from its drift over the run by
    /// noise and by the voltages at the ends; `bound` says by how much at most (O1).
    pub(super) fn settle(self, barriers: Barriers, drift: f64, bound: f64, account: &mut Account) {
        account.on += u64::from(self.on);
        account.off += u64::from(self.off);
        account.active_pixels += u64::from(self.on + self.off > 0);
        let balance = barriers.up * f64::from(self.on) - barriers.down * f64::from(self.off) - drift;
        let share = balance.abs() / bound;
        account.drift_worst = account.drift_worst.max(share);
        account.drift_violations += u64::from(share > 1.0);
    }

    /// Counts an event; how many there have been since the frame before it.
    fn count(&mut self, polarity: Polarity, frame: u32) -> u32 {
        match polarity {
            Polarity::On => self.on += 1,
            Polarity::Off => self.off += 1,
        }
        self.since = if self.frame == frame { self.since + 1 } else { 1 };
        self.frame = frame;
        self.since
    }
}

/// Writes down the events of one pixel.
struct Writer<'a> {
    window: &'a Window<'a>,
    pixel: usize,
    tally: &'a mut Tally,
    events: &'a mut Vec<Packed>,
    most: &'a mut u32,
    capped: &'a mut Option<SensorError>,
}

impl Emit for Writer<'_> {
    fn event(&mut self, t: f64, polarity: Polarity) -> ControlFlow<()> {
        let window = self.window;
        if t > window.last {
            return ControlFlow::Continue(());
        }
        // An event at a stamp belongs to the frames before it.
        let frame = window.pieces[window.pieces.partition_point(|piece| piece.to < t)].begin.frame;
        let count = self.tally.count(polarity, window.frames[frame].index as u32);
        *self.most = count.max(*self.most);
        if count > window.law.cap {
            *self.capped = Some(self.too_many(frame));
            return ControlFlow::Break(());
        }
        let ns = t as u64 + window.start.rem_euclid(1000).cast_unsigned();
        self.events.push(Packed::new(ns, window.law.at(self.pixel), polarity));
        ControlFlow::Continue(())
    }
}

impl Writer<'_> {
    fn too_many(&self, frame: usize) -> SensorError {
        let [x, y] = self.window.law.at(self.pixel);
        let before = self.window.frames[frame];
        let after = self.window.frames.get(frame + 1).unwrap_or(&before);
        SensorError::Cap {
            x,
            y,
            frame: before.index,
            before: before.luminance[self.pixel],
            after: after.luminance[self.pixel],
            cap: self.window.law.cap,
        }
    }
}
