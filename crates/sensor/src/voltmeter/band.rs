//! A band of pixels in one window of time: most cross it in one step, the others descend into the
//! dyadic clock.
//!
//! ```text
//!            block of 64 pixels, eight lanes at a time
//!  frames -> fill: ln(L + k2) at the knots -> crossing: drift, sigma, curvature -> pass
//!                                                                                 /    \
//!                                  no barrier within reach: y = x + drift + noise  Walkers -> tree
//! ```
//!
//! The cost of the exact law is decided here. In most windows of most pixels no barrier is within
//! reach, and a pixel costs one normal draw, one logarithm and a comparison. These steps are
//! separate short loops over a block: each keeps few values alive, so the compiler holds them in
//! vector registers, and a block's arrays stay in the first-level cache. The few pixels that need
//! more are collected until there are enough of them to share the cost of the descent.

use super::BetweenFrames;
use super::cubic::secant_weights;
use super::curve::{DriftCurve, FrameEnds, Wide};
use super::noiseless::{self, StraightDrift};
use super::receptor::{self, WideReceptor};
use super::touch::{ReceptorCell, WideCell};
use super::tree::{ROOT_DEVIATION, RootWalk, Walker, Walkers};
use super::window::{FrameLeg, TimeStep};
use super::writer::{BandWriter, PixelTally};
use crate::SensorError;
use crate::window::PackedEvent;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, f64x8, u64x8};
use gs2e_num::elementary::{ln_ratio, load_eight, mask_bits, set_lanes, store_eight};
use gs2e_num::seed::eight::SeedCells;
use gs2e_num::seed::{DrawSpace, eight};
use std::ops::ControlFlow;

/// Working memory of one thread that crosses bands, and its results.
#[derive(Debug, Default)]
pub(super) struct BandCrosser {
    block: BlockWindow,
    pub(super) walkers: Walkers,
    pub(super) events: Vec<PackedEvent>,
    /// Largest number of events of one pixel between two frames.
    pub(super) most: u32,
    pub(super) capped: Option<SensorError>,
    /// `ln(L + k2)` of each pixel at its last event, or at the first frame before any event. Only
    /// for labelled events.
    pub(super) logs: Option<Vec<f64>>,
}

/// The state of a band's pixels. Arrays are padded to a multiple of 8; `tally` is not, and gives
/// the true number.
#[derive(Debug)]
pub(super) struct BandSlice<'a> {
    /// Index of the band's first pixel in the image.
    pub(super) first: usize,
    /// Positions on the sensor, `y << 16 | x`.
    pub(super) seats: &'a [u32],
    pub(super) voltage: &'a mut [f64],
    pub(super) drift: &'a mut [f64],
    pub(super) variance: &'a mut [f64],
    /// The photoreceptor's noise, in thresholds; empty without it.
    pub(super) receptor: &'a mut [f64],
    /// One tally for each pixel of the image, without padding.
    pub(super) tally: &'a mut [PixelTally],
}

/// Number of pixels that pass through each short loop together. Long enough to hide latencies, and
/// 64 f64 values of every array involved still fit the first-level cache.
const BLOCK: usize = 64;

/// One number for each pixel of a block.
type Lane = [f64; BLOCK];

/// Minimum number of pixels that descend into the tree together, where there are that many. The
/// cost of a cell itself is then small per pixel, and the walkers' arrays still fit the
/// second-level cache.
const CROWD: usize = 2048;

/// The draws of a block's pixels over a root cell.
#[derive(Debug)]
struct RootDraws {
    /// Increment of the Brownian motion.
    motion: Lane,
    /// Normal deviate of the photoreceptor's noise.
    receptor: Lane,
    /// The upper bits of the number that decides whether a line is touched, as a number from 0 to 1.
    known: Lane,
}

impl Default for RootDraws {
    fn default() -> Self {
        Self { motion: ZEROS, receptor: ZEROS, known: ZEROS }
    }
}

/// Brightness and curves of a block's pixels in a window.
#[derive(Debug, Default)]
struct BlockWindow {
    /// For each knot of the window: `L + k2`, the change of its logarithm up to the next knot, and
    /// the slope of the logarithm at the knot.
    knots: Vec<[Lane; 3]>,
    /// For each leg and eight pixels: the drift from the window's start to the leg's earlier frame,
    /// then its curve.
    pieces: Vec<[[f64; 8]; 5]>,
}

/// The index of the first of eight pixels.
#[derive(Clone, Copy)]
struct PixelEight {
    in_band: usize,
    in_block: usize,
}

/// Those of eight pixels that have a barrier within reach, and the first of the eight in the band.
struct LiveLanes<I> {
    pixel: usize,
    lanes: I,
}

/// The motion of eight pixels over a window if they touch no barrier.
#[derive(Clone, Copy)]
struct FreeCrossing<S: Simd> {
    /// Increment of the Brownian motion over the root cell.
    increment: f64x8<S>,
    /// Drift over the window.
    drift: f64x8<S>,
    /// Noise per square root of a nanosecond.
    sigma: f64x8<S>,
    /// Bound on the second derivative of the drift.
    curvature: f64x8<S>,
    /// Bound on the distance between the drift and its chord.
    straying: f64x8<S>,
    /// `L + k2` in the middle of the root cell; 0 without noise.
    level: f64x8<S>,
    /// The photoreceptor's noise.
    receptor: Option<ReceptorCrossing<S>>,
}

/// The photoreceptor's noise of eight pixels over a root cell.
#[derive(Clone, Copy)]
struct ReceptorCrossing<S: Simd> {
    noise: WideReceptor<S>,
    ends: [f64x8<S>; 2],
    /// The upper bits of the number that decides whether a line is touched.
    known: f64x8<S>,
}

impl<S: Simd> FreeCrossing<S> {
    /// One of the eight pixels as a walker, with its place in the band, its seat, and its voltage at the
    /// start.
    #[inline(always)]
    fn walker(&self, lane: usize, pixel: usize, seat: u64, voltage: f64) -> Walker {
        let Self { increment, drift, sigma, curvature, receptor, .. } = self;
        let receptor = receptor.map(|ReceptorCrossing { noise, ends: [from, to], .. }| ReceptorCell {
            rate: noise.rate[lane],
            deviation: noise.deviation[lane],
            ends: [from[lane], to[lane]],
        });
        Walker {
            pixel,
            seat,
            voltage,
            sigma: sigma[lane],
            curvature: curvature[lane],
            increment: increment[lane],
            drift: drift[lane],
            receptor,
        }
    }
}

/// Multiplies the numbers of a block.
#[inline(always)]
fn scale<S: Simd>(simd: S, numbers: &mut [f64], factor: f64) {
    for i in (0..numbers.len()).step_by(8) {
        store_eight(load_eight(simd, numbers, i) * factor, numbers, i);
    }
}

/// Seconds in a nanosecond.
const SECONDS: f64 = 1e-9;

const ZEROS: Lane = [0.0; BLOCK];

impl TimeStep<'_> {
    /// Moves every pixel of a band to the end of the window.
    #[inline(always)]
    pub(super) fn cross<C: DriftCurve, S: Simd>(
        &self,
        simd: S,
        mut slice: BandSlice<'_>,
        band: &mut BandCrosser,
    ) {
        band.walkers.clear();
        let mut draws = RootDraws::default();
        for start in (0..slice.voltage.len()).step_by(BLOCK) {
            let end = slice.voltage.len().min(start + BLOCK);
            simd.vectorize(
                #[inline(always)]
                || {
                    self.draw(simd, &slice.seats[start..end], &mut draws);
                    let RootDraws { motion, receptor, known } = &draws;
                    self.fill(simd, slice.first + start, end - start, &mut band.block);
                    for i in (start..end).step_by(8) {
                        let increment = load_eight(simd, motion, i - start);
                        // `crossing` leaves the drift of these eight in the block's pieces, and
                        // `pass` reads it there, so each eight is finished before the next.
                        let mut crossing = self.crossing::<C, S>(increment, i - start, &mut band.block);
                        let normal = load_eight(simd, receptor, i - start);
                        let known = load_eight(simd, known, i - start);
                        crossing.receptor = self.receptor(crossing.level, [normal, known], i, &mut slice);
                        let eight = PixelEight { in_band: i, in_block: i - start };
                        self.pass::<C, S>(crossing, eight, &mut slice, band);
                    }
                },
            );
            // Between blocks, so that the list may grow past `CROWD` by one block at most.
            if band.walkers.len() >= CROWD {
                self.walk::<C, S>(simd, &mut slice, band);
            }
        }
        self.walk::<C, S>(simd, &mut slice, band);
    }

    /// Moves the collected walkers to the end of the window.
    fn walk<C: DriftCurve, S: Simd>(&self, simd: S, slice: &mut BandSlice<'_>, band: &mut BandCrosser) {
        let BandCrosser { walkers, events, most, capped, logs, .. } = band;
        let BandSlice { first, voltage, tally, .. } = slice;
        let logs = logs.as_deref_mut();
        let writer = BandWriter { window: self, first: *first, tally, events, most, capped, logs };
        // A break means that the step has failed; the failure is in `capped`.
        let _ = RootWalk { window: self, walkers, writer }.cross::<C, S>(simd);
        walkers.settled().for_each(|(pixel, x)| voltage[pixel] = x);
        walkers.clear();
    }

    /// Draws the noise over the root cell of each pixel.
    #[inline(always)]
    fn draw<S: Simd>(&self, simd: S, seats: &[u32], draws: &mut RootDraws) {
        let (has_motion, has_receptor) = (self.law.process.is_brownian(), self.law.receptor.is_some());
        if !(has_motion || has_receptor) {
            return;
        }
        let RootDraws { motion, receptor, known } = draws;
        let cells = SeedCells { seed: self.law.seed, space: DrawSpace::Tree, level: 0, index: self.root() };
        for (i, seats) in (0..).step_by(8).zip(seats.chunks_exact(8)) {
            // Without the photoreceptor's noise, the second number is the draw that splits the root
            // (`RootWalk::split`).
            let [first, second] = cells.pair(u64x8::from_fn(simd, |lane| seats[lane].into()), 0);
            store_eight(eight::uniform_eight(first), motion, i);
            if has_receptor {
                store_eight(eight::uniform_eight(second), receptor, i);
                // Bits that the normal deviate does not use, as a number from 0 to 1.
                let bits = (second & receptor::SPARE) << 40 | 1.0f64.to_bits();
                store_eight(f64x8::from_bits(bits) - 1.0, known, i);
            }
        }
        // In one call for the whole block: the rare tails are then gathered over many pixels.
        if has_motion {
            eight::normal_deviates(simd, &mut motion[..seats.len()]);
            scale(simd, &mut motion[..seats.len()], ROOT_DEVIATION);
        } else {
            motion[..seats.len()].fill(0.0);
        }
        if has_receptor {
            eight::normal_deviates(simd, &mut receptor[..seats.len()]);
        }
    }

    /// Moves the photoreceptor's noise of eight pixels, from the `first` of the band on, to the end of the
    /// root cell. `level` is `L + k2`. `None` without this noise.
    #[inline(always)]
    fn receptor<S: Simd>(
        &self,
        level: f64x8<S>,
        [normal, known]: [f64x8<S>; 2],
        first: usize,
        slice: &mut BandSlice<'_>,
    ) -> Option<ReceptorCrossing<S>> {
        let law = self.law.receptor.as_ref()?;
        let noise = law.eight(level - self.law.process.k2, slice.first + first);
        let start = load_eight(normal.simd, slice.receptor, first);
        let end = noise.go_on(start, normal);
        store_eight(end, slice.receptor, first);
        Some(ReceptorCrossing { noise, ends: [start, end], known })
    }

    /// Fills the block's knots for the pixels from `first` on.
    #[inline(always)]
    fn fill<S: Simd>(&self, simd: S, first: usize, count: usize, block: &mut BlockWindow) {
        let BlockWindow { knots, pieces } = block;
        pieces.resize(self.legs.len(), [[0.0; 8]; 5]);
        knots.resize(self.knots.len(), [ZEROS; 3]);
        for ([level, _, slope], frame) in knots.iter_mut().zip(&self.frames[self.knots.clone()]) {
            let luminance = &frame.luminance[first..first + count];
            for (i, luminance) in (0..).step_by(8).zip(luminance.chunks_exact(8)) {
                let here = f64x8::from_fn(simd, |lane| luminance[lane].into()) + self.law.process.k2;
                store_eight(here, level, i);
                if self.law.between == BetweenFrames::Hermite {
                    // The slope of a logarithm: the rate over the level that the logarithm is taken
                    // of.
                    let rate = f64x8::from_fn(simd, |lane| frame.rate[first + i + lane].into());
                    store_eight(rate * SECONDS / here, slope, i);
                }
            }
        }
        // One logarithm of a ratio per step, not a difference of two logarithms: small steps stay
        // exact.
        for at in 1..knots.len() {
            let [[before, step, _], [after, ..]] = &mut knots[at - 1..=at] else {
                unreachable!("they are two")
            };
            for i in (0..count).step_by(8) {
                store_eight(ln_ratio([load_eight(simd, before, i), load_eight(simd, after, i)]), step, i);
            }
        }
        if self.law.between == BetweenFrames::Catmull {
            self.slopes(simd, count, knots);
        }
    }

    /// Slopes at the knots from the neighbouring frames: the slope of the parabola through three
    /// frames, or of the line through two at the ends of the sequence.
    #[inline(always)]
    fn slopes<S: Simd>(&self, simd: S, count: usize, knots: &mut [[Lane; 3]]) {
        let stamps: Vec<i64> = self.frames[self.knots.clone()].iter().map(|frame| frame.t).collect();
        for at in 0..knots.len() {
            let [before, after] = [at.saturating_sub(1), (at + 1).min(knots.len() - 1)];
            let [earlier, later] =
                [stamps[at] - stamps[before], stamps[after] - stamps[at]].map(|t| t as f64);
            let [left, right] = secant_weights([earlier, later]);
            for i in (0..count).step_by(8) {
                // Products with a weight of 0 hide the steps beyond the ends, which are not set.
                let in_step = load_eight(simd, &knots[before][1], i);
                let out_step = load_eight(simd, &knots[at][1], i);
                store_eight(in_step * left + out_step * right, &mut knots[at][2], i);
            }
        }
    }

    /// The curve of a leg for eight pixels of a block, and the frame values from which it is made.
    #[inline(always)]
    fn curve<C: DriftCurve, S: Simd>(
        &self,
        simd: S,
        leg: usize,
        i: usize,
        block: &BlockWindow,
    ) -> (Wide<S>, FrameEnds<S>) {
        let FrameLeg { inverse, frame, .. } = self.legs[leg];
        let at = frame - self.knots.start;
        // After the last frame the brightness stays. The inverse is 0 there, and with it the share
        // of a step that is not set.
        let next = if inverse == 0.0 { at } else { at + 1 };
        let [[first, step, first_slope], [last, _, last_slope]] = [&block.knots[at], &block.knots[next]];
        let ends = FrameEnds {
            levels: [load_eight(simd, first, i), load_eight(simd, last, i)],
            step: load_eight(simd, step, i),
            slopes: [load_eight(simd, first_slope, i), load_eight(simd, last_slope, i)],
            inverse,
        };
        if inverse == 0.0 {
            ([f64x8::splat(simd, 0.0); 4], ends)
        } else {
            (C::between(&self.law.process, &ends), ends)
        }
    }

    /// The motion of eight pixels of a block, from the `i`-th on. Also stores the drift at the
    /// start of each leg in the block's pieces.
    #[inline(always)]
    fn crossing<C: DriftCurve, S: Simd>(
        &self,
        increment: f64x8<S>,
        i: usize,
        block: &mut BlockWindow,
    ) -> FreeCrossing<S> {
        let (simd, process) = (increment.simd, &self.law.process);
        let zero = f64x8::splat(simd, 0.0);
        let (mut drift, mut curvature, mut level) = (zero, zero, zero);
        for (at, leg) in self.legs.iter().enumerate() {
            let (curve, ends) = self.curve::<C, S>(simd, at, i, block);
            let [from, to] = [leg.from - leg.stamp, leg.to - leg.stamp];
            // The first leg may begin before the window, and the drift counts from the window's
            // start.
            let here = if from > 0.0 { drift - C::rise(process, &curve, from) } else { drift };
            here.store_slice(&mut block.pieces[at][0]);
            drift = here + C::rise(process, &curve, to);
            curvature = curvature.max(C::curvature(&curve, [from, to]));
            // One sigma for the whole root cell. If each cell took its own, the voltage would
            // depend on where cells are split.
            if at == self.middle.0 && !process.is_noiseless() {
                level = C::level(process, &ends, self.middle.1);
            }
        }
        let slope = drift * (1.0 / self.length);
        let mut knots = zero;
        // The first leg begins at or before the window's start, so its stamp is no knot.
        for (leg, piece) in self.legs.iter().zip(&block.pieces).skip(1) {
            knots = knots.max((f64x8::from_slice(simd, &piece[0]) - slope * leg.stamp).abs());
        }
        let sigma = if process.is_noiseless() { zero } else { process.sigma(level) };
        // Over a length `h`, a curve with `|f''| <= c` differs from its chord by at most `c h^2/8`.
        // The knots add the distance of the polygon through the stamps.
        let straying = curvature * (self.widest * self.widest * 0.125) + knots;
        FreeCrossing { increment, drift, sigma, curvature, straying, level, receptor: None }
    }

    /// Moves eight pixels to the end of the window where no barrier is within reach, and collects
    /// the others as walkers.
    #[inline(always)]
    fn pass<C: DriftCurve, S: Simd>(
        &self,
        crossing: FreeCrossing<S>,
        eight: PixelEight,
        slice: &mut BandSlice<'_>,
        band: &mut BandCrosser,
    ) {
        let FreeCrossing { increment, drift, sigma, straying, receptor, .. } = crossing;
        let PixelEight { in_band: pixel, in_block } = eight;
        let simd = drift.simd;
        let x = load_eight(simd, slice.voltage, pixel);
        let mut y = x + drift + sigma * increment;
        let square = sigma * sigma;
        if let Some(ReceptorCrossing { ends, .. }) = receptor {
            y += ends[1] - ends[0];
        }
        // Stored for all eight before the test: a walker's voltage is overwritten when its descent
        // ends.
        store_eight(y, slice.voltage, pixel);
        store_eight(load_eight(simd, slice.drift, pixel) + drift, slice.drift, pixel);
        if !self.law.process.is_noiseless() {
            // Noise after the last stamp makes no events, so it explains no imbalance.
            let observed = self.length.min(self.last);
            store_eight(load_eight(simd, slice.variance, pixel) + square * observed, slice.variance, pixel);
        }
        // `straying` moves both barriers nearer, so no pixel that needs a walk is left out.
        let barriers = self.law.thresholds.eight(simd, slice.first + pixel);
        let mut lines = None;
        let (live, open) = if let Some(ReceptorCrossing { noise, ends, known }) = receptor {
            let motion = sigma * self.motion_reach;
            let (shape, deviation) = (noise.shape(), noise.deviation);
            let cell = WideCell { shape, deviation, ends, voltage: [x, y], straying, motion };
            let lines = lines.insert(cell.lines(barriers));
            let open = lines.open(known);
            (lines.live & (!lines.decided | open), open)
        } else {
            (mask_bits(barriers.reached([x, y], square * self.length, straying)), 0)
        };
        if live == 0 {
            return;
        }
        // Padding lanes have no tally and must make no events.
        let pixels = slice.tally.len();
        let live = set_lanes(live).take_while(|lane| pixel + lane < pixels);
        // A window without noise lies between two frames, so it has one leg and one straight drift.
        if self.law.process.is_noiseless() && C::are_straight(&self.law.process) {
            let straight = StraightDrift::new(barriers, [x, drift], self.length);
            return self.run_straight(LiveLanes { pixel, lanes: live }, &straight, slice, band);
        }
        // The curves are computed a second time, for few pixels: keeping them for all costs more
        // memory traffic.
        for at in 0..self.legs.len() {
            let (curve, _) = self.curve::<C, S>(simd, at, in_block, &band.block);
            let [_, to @ ..] = &mut band.block.pieces[at];
            to.iter_mut().zip(curve).for_each(|(to, c)| c.store_slice(to));
        }
        if self.law.process.is_noiseless() {
            return self.run::<C>(LiveLanes { pixel, lanes: live }, *x, slice, band);
        }
        for lane in live {
            let place = pixel + lane;
            let walker = crossing.walker(lane, place, slice.seats[place].into(), x[lane]);
            let pieces = band.block.pieces.iter().map(|piece| piece.each_ref().map(|c| c[lane]));
            match (lines, receptor) {
                (Some(lines), Some(ReceptorCrossing { known, .. })) if open >> lane & 1 == 1 => {
                    band.walkers.push_touched(walker, lines.of(lane), known[lane], pieces);
                }
                _ => band.walkers.push(walker, pieces),
            }
        }
    }
}

impl TimeStep<'_> {
    /// Moves pixels across the window without noise and with straight drift. Their voltages at the
    /// end, before the resets by events, are stored already.
    #[inline(always)]
    fn run_straight<S: Simd>(
        &self,
        live: LiveLanes<impl Iterator<Item = usize>>,
        straight: &StraightDrift<S>,
        slice: &mut BandSlice<'_>,
        band: &mut BandCrosser,
    ) {
        let LiveLanes { pixel, lanes } = live;
        let BandCrosser { events, most, capped, logs, .. } = band;
        let BandSlice { first, seats, tally, voltage, .. } = slice;
        let logs = logs.as_deref_mut();
        let mut writer = BandWriter { window: self, first: *first, tally, events, most, capped, logs };
        for lane in lanes {
            // The reset of an event moves everything after it, so the voltage at the end moves too.
            let mut emit = writer.of(pixel + lane, seats[pixel + lane].into());
            // A break means that the step has failed; the failure is in `capped`.
            if let ControlFlow::Continue(taken) = straight.cross(lane, &mut emit) {
                voltage[pixel + lane] -= taken;
            }
        }
    }

    /// Moves pixels across the window without noise. `x` are the voltages of the eight at the start.
    #[inline(always)]
    fn run<C: DriftCurve>(
        &self,
        live: LiveLanes<impl Iterator<Item = usize>>,
        x: [f64; 8],
        slice: &mut BandSlice<'_>,
        band: &mut BandCrosser,
    ) {
        let LiveLanes { pixel, lanes } = live;
        let BandCrosser { block, events, most, capped, logs, .. } = band;
        let BandSlice { first, seats, tally, voltage, .. } = slice;
        let logs = logs.as_deref_mut();
        let mut writer = BandWriter { window: self, first: *first, tally, events, most, capped, logs };
        for lane in lanes {
            let curves = block.pieces.iter().map(|[_, curve @ ..]| curve.each_ref().map(|c| c[lane]));
            let barriers = self.law.thresholds.of(*first + pixel + lane);
            let mut emit = writer.of(pixel + lane, seats[pixel + lane].into());
            // A break means that the step has failed; the failure is in `capped`.
            if let ControlFlow::Continue(y) =
                noiseless::cross_window::<C>(self, barriers, x[lane], curves, &mut emit)
            {
                voltage[pixel + lane] = y;
            }
        }
    }
}
