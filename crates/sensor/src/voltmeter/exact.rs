//! The exact law over all pixels: frames come in, windows of time go out.
//!
//! With noise, a window is a root cell of the clock. Without noise, it is the time between two
//! frames. A window is crossed as soon as the frames that span it have arrived, by bands of rows in
//! parallel. The events of a pixel depend on its own luminance only, so the number of bands and
//! their order do not change the result.
#![expect(clippy::cast_possible_truncation, reason = "pixel coordinates are below 2^16")]

use super::band::{BandCrosser, BandSlice};
use super::bridge::Barriers;
use super::cubic::CubicDrift;
use super::drift::DriftProcess;
use super::line::LineDrift;
use super::receptor::ReceptorNoise;
use super::thresholds::PixelThresholds;
use super::tree::ROOT;
use super::window::TimeStep;
use super::writer::PixelTally;
use super::{BetweenFrames, InitialVoltage, VoltmeterModel};
use crate::chain::PixelArray;
use crate::frames::DenseFrame;
use crate::window::{EventWindow, MAX_WINDOW_NS};
use crate::{SensorError, SensorPixels, SimulationAccount, input};
use fearless_simd::{Level, Simd, dispatch};
use gs2e_event::EventSink;
use gs2e_image::Size;
use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Version of the law. Raise it when a clock, a constant or a draw changes.
pub(super) const VERSION: u32 = 3;
/// Version of the law with the photoreceptor's noise. Above all versions of the law without it so far.
pub(super) const RECEPTOR_VERSION: u32 = 4;

/// Number of bands per thread. More bands balance quiet and busy parts of the image better; fewer
/// bands share the fixed cost of a descent between more pixels.
const BANDS_A_THREAD: usize = 4;
/// Largest voltage at the first frame, as a share of a threshold.
const INSIDE: f64 = 1.0 - 1e-9;
/// Minimum number of pixels in a band.
const MIN_BAND: usize = 4096;

/// State of the exact sampler.
#[derive(Debug)]
pub(super) struct ExactSampler {
    law: ExactSettings,
    /// The instruction set in use.
    level: Level,
    frames: VecDeque<PendingFrame>,
    /// Frames that are no longer needed; their memory is reused.
    spare: Vec<PendingFrame>,
    state: PixelStates,
    /// Number of pixels in a band, a multiple of 8.
    band: usize,
    bands: Vec<BandCrosser>,
    /// Time up to which windows have been crossed, ns.
    crossed: i64,
    windows: EventWindow,
    negative_luminance: u64,
}

/// The settings, which do not change during a simulation.
#[derive(Debug)]
pub(super) struct ExactSettings {
    pub(super) process: DriftProcess,
    pub(super) thresholds: PixelThresholds,
    /// The photoreceptor's noise, if there is any.
    pub(super) receptor: Option<ReceptorNoise>,
    pub(super) initial: InitialVoltage,
    pub(super) between: BetweenFrames,
    pub(super) cap: u32,
    /// True if events are labelled.
    labels: bool,
    pub(super) size: Size,
    pub(super) origin: [u16; 2],
    pub(super) seed: Seed,
}

/// A frame that later windows still need, in row-major order.
#[derive(Debug, Default)]
pub(super) struct PendingFrame {
    pub(super) index: usize,
    pub(super) t: i64,
    /// Luminance, at least 0. Padded with zeros to a multiple of 8.
    pub(super) luminance: Vec<f32>,
    /// Rate of change per second; empty unless the interpolation is `hermite`.
    pub(super) rate: Vec<f32>,
}

/// State of the pixels at the end of the last window. All arrays but `tally` are padded to a
/// multiple of 8.
#[derive(Debug)]
struct PixelStates {
    /// Positions on the sensor, `y << 16 | x`.
    seats: Vec<u32>,
    /// Voltage in thresholds, between the barriers.
    voltage: Vec<f64>,
    /// Drift since the first frame.
    drift: Vec<f64>,
    /// Variance of the noise since the first frame.
    variance: Vec<f64>,
    /// The photoreceptor's noise, in thresholds; empty without it.
    receptor: Vec<f64>,
    tally: Vec<PixelTally>,
}

impl ExactSampler {
    /// The pixels of a sensor, which fail beyond `cap` events of one pixel between two frames.
    pub(super) fn new(sensor: &VoltmeterModel, cap: u32, array: PixelArray) -> Self {
        let thresholds = PixelThresholds::new(sensor, &array);
        let receptor = ReceptorNoise::new(sensor, &array);
        let (process, initial, between) = (DriftProcess::new(sensor), sensor.initial, sensor.between);
        let PixelArray { size, origin, seed, labels } = array;
        let law = ExactSettings {
            process,
            thresholds,
            receptor,
            initial,
            between,
            cap,
            labels,
            size,
            origin,
            seed,
        };
        let (n, padded) = (size.pixels(), size.pixels().next_multiple_of(8));
        let seat = |pixel| {
            let [x, y] = law.at_sensor(pixel);
            u32::from(y) << 16 | u32::from(x)
        };
        let mut seats: Vec<u32> = (0..n).map(seat).collect();
        // Padding has a seat too, because whole vectors of pixels are drawn for.
        seats.resize(padded, 0);
        let bands = BANDS_A_THREAD * rayon::current_num_threads();
        // A multiple of 8, so that no vector of pixels reaches into the next band.
        let band = n.div_ceil(bands).max(MIN_BAND).next_multiple_of(8);
        let receptor = vec![0.0; if law.receptor.is_some() { padded } else { 0 }];
        Self {
            law,
            level: Level::new(),
            frames: VecDeque::new(),
            spare: Vec::new(),
            state: PixelStates {
                seats,
                voltage: vec![0.0; padded],
                drift: vec![0.0; padded],
                variance: vec![0.0; padded],
                receptor,
                tally: vec![PixelTally::default(); n],
            },
            band,
            bands: std::iter::repeat_with(BandCrosser::default).take(n.div_ceil(band)).collect(),
            crossed: 0,
            windows: EventWindow::default(),
            negative_luminance: 0,
        }
    }

    /// Sets the photoreceptor's noise of every pixel.
    #[cfg(test)]
    pub(super) fn set_receptor(&mut self, voltage: f64) {
        self.state.receptor.fill(voltage);
    }

    /// The end of the next window.
    fn window_end(&self, until: i64) -> i64 {
        if self.law.process.is_noiseless() {
            let next = self.frames.iter().map(|frame| frame.t).find(|&t| t > self.crossed);
            // Packed events have no room for a longer window, so a long interval is crossed in
            // parts.
            next.unwrap_or(until).min(self.crossed + MAX_WINDOW_NS)
        } else {
            self.crossed + ROOT
        }
    }

    /// Crosses every window that ends at or before `until`. Events after `last` are dropped.
    fn cross_until(&mut self, until: i64, last: i64, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        while self.crossed < until {
            let end = self.window_end(until);
            // With noise, a root cell is crossed whole or not at all: its frames beyond `until` are
            // not known yet.
            if end > until {
                break;
            }
            self.cross_window(end, last)?;
            self.windows.close(end.div_euclid(1000), sink)?;
            self.crossed = end;
            // The curve of the leg that begins at `end` still needs these frames.
            let kept = self.law.kept();
            while self.frames.len() > kept && self.frames[kept].t <= end {
                self.spare.extend(self.frames.pop_front());
            }
        }
        Ok(())
    }

    /// Crosses the windows whose frames are known.
    fn cross_known(&mut self, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        // A `catmull` leg is known when the frame after its end has come, so it waits for one more.
        let until = self.frames.len().checked_sub(self.law.kept()).map_or(0, |at| self.frames[at].t);
        self.cross_until(until, i64::MAX, sink)
    }

    fn cross_window(&mut self, end: i64, last: i64) -> Result<(), SensorError> {
        let PixelStates { seats, voltage, drift, variance, receptor, tally } = &mut self.state;
        let window = TimeStep::new(&self.law, self.frames.iter().collect(), [self.crossed, end], last);
        let size = self.band;
        // One slice a band, empty ones without this noise.
        let mut receptor: Vec<&mut [f64]> = receptor.chunks_mut(size).collect();
        receptor.resize_with(self.bands.len(), || &mut []);
        let chunks = (
            seats.par_chunks(size),
            voltage.par_chunks_mut(size),
            drift.par_chunks_mut(size),
            variance.par_chunks_mut(size),
            receptor.into_par_iter(),
            tally.par_chunks_mut(size),
            self.bands.par_iter_mut(),
        );
        // The instruction set is chosen once per band: everything inside is compiled for it.
        let level = self.level;
        chunks.into_par_iter().enumerate().for_each(|(i, parts)| {
            let (seats, voltage, drift, variance, receptor, tally, band) = parts;
            let slice = BandSlice { first: i * size, seats, voltage, drift, variance, receptor, tally };
            match window.law.between {
                BetweenFrames::Linear => {
                    dispatch!(level, simd => window.cross::<LineDrift, _>(simd, slice, band))
                }
                BetweenFrames::Catmull | BetweenFrames::Hermite => {
                    dispatch!(level, simd => window.cross::<CubicDrift, _>(simd, slice, band));
                }
            }
        });
        // In order of bands, so that the first band with a failure is the one that is reported.
        for band in &mut self.bands {
            if let Some(error) = band.capped.take() {
                return Err(error);
            }
            self.windows.add(&mut band.events);
        }
        Ok(())
    }

    /// Checks and converts a frame.
    fn store(&mut self, frame: &DenseFrame) -> Result<(), SensorError> {
        input::check_order(self.frames.back().map(|before| before.t), frame, self.law.size)?;
        let luminance = frame.luminance.pixels();
        // A frame that is no longer needed gives its memory to the next.
        let mut stored = self.spare();
        (stored.index, stored.t) = (frame.index, frame.t.0);
        stored.luminance.resize(self.state.voltage.len(), 0.0);
        let (negative, finite) =
            dispatch!(self.level, simd => clamp_luminance(simd, luminance, &mut stored.luminance));
        // NaN is not below 0, so the count of negative values does not show it.
        if !finite {
            return Err(input::not_finite(frame));
        }
        self.negative_luminance += negative;
        if self.law.between == BetweenFrames::Hermite {
            let refuse = |because| SensorError::Frame { frame: frame.index, because };
            let rate = usable_rate(frame).map_err(refuse)?;
            stored.rate.clear();
            stored.rate.extend_from_slice(rate);
            stored.rate.resize(self.state.voltage.len(), 0.0);
        }
        self.keep(stored);
        Ok(())
    }

    /// Takes a frame that needs no check, and passes on the events that are now final.
    pub(super) fn advance_stored(
        &mut self,
        stored: PendingFrame,
        sink: &mut dyn EventSink,
    ) -> Result<(), SensorError> {
        self.keep(stored);
        self.cross_known(sink)
    }

    /// The memory of a frame that is no longer needed, or of none.
    pub(super) fn spare(&mut self) -> PendingFrame {
        self.spare.pop().unwrap_or_default()
    }

    /// Adds a frame, and sets the pixels to the first.
    fn keep(&mut self, stored: PendingFrame) {
        if self.frames.is_empty() {
            self.law.begin_receptor(&stored.luminance, &mut self.state.receptor);
            self.law.begin(&stored.luminance, &self.state.receptor, &mut self.state.voltage);
            self.begin_logs(&stored);
        }
        self.frames.push_back(stored);
    }

    /// Sets the brightness from which labels count to that of the first frame.
    fn begin_logs(&mut self, first: &PendingFrame) {
        if !self.law.labels {
            return;
        }
        let mut logs = self.law.logs(first);
        for band in &mut self.bands {
            // Each band takes its own part of one sequence over all pixels.
            band.logs = Some(logs.by_ref().take(self.band).collect());
        }
    }

    /// The counts of the simulation.
    fn settle(&self) -> SimulationAccount {
        let mut account =
            SimulationAccount { negative_luminance: self.negative_luminance, ..SimulationAccount::default() };
        let PixelStates { drift, variance, tally, .. } = &self.state;
        for (pixel, ((tally, drift), variance)) in tally.iter().zip(drift).zip(variance).enumerate() {
            let barriers = self.law.thresholds.of(pixel);
            // Events times thresholds can differ from the drift by the voltage left at the end and
            // by the noise. Six standard deviations are exceeded by 2e-9 of the pixels.
            let receptor = self.law.receptor.as_ref().map_or(0.0, |noise| noise.change_variance(pixel));
            let bound = self.law.left_over(barriers) + 6.0 * (variance + receptor).sqrt();
            tally.settle(barriers, *drift, bound, &mut account);
        }
        account.events = account.on + account.off;
        account.same_us_same_pixel = self.windows.same_us_same_pixel;
        for band in &self.bands {
            account.leaves += band.walkers.leaf_count;
            account.splits += band.walkers.splits;
            account.max_per_pixel_frame = account.max_per_pixel_frame.max(u64::from(band.most));
        }
        account
    }
}

impl ExactSettings {
    /// Sets the photoreceptor's noise at the first frame.
    fn begin_receptor(&self, luminance: &[f32], receptor: &mut [f64]) {
        let Some(noise) = &self.receptor else { return };
        receptor.par_iter_mut().take(self.size.pixels()).enumerate().for_each(|(pixel, u)| {
            *u = noise.initial(luminance[pixel], pixel, self.at_sensor(pixel), self.seed);
        });
    }

    /// Sets the voltages at the first frame. Zero means that the pixels were reset there, whatever the
    /// photoreceptor's noise was.
    fn begin(&self, luminance: &[f32], receptor: &[f64], voltage: &mut [f64]) {
        if self.initial == InitialVoltage::Zero {
            return;
        }
        voltage.par_iter_mut().take(self.size.pixels()).zip(luminance).enumerate().for_each(
            |(pixel, (voltage, luminance))| {
                let [x, y] = self.at_sensor(pixel);
                let cell = SeedCell { x, y, level: 0, index: 0 };
                // The uniform is the quantile of the stationary law, so one draw is enough.
                let share = self.seed.draws(cell, DrawSpace::Initial).uniform();
                let barriers = self.thresholds.of(pixel);
                let at_rest = self.process.at_rest(f64::from(*luminance), barriers);
                *voltage = match &self.receptor {
                    None => at_rest.residual(share),
                    // Just inside: a voltage at a barrier has no event before it.
                    Some(noise) => (noise.at_rest(*luminance, pixel, &at_rest, share) + receptor[pixel])
                        .clamp(-barriers.down * INSIDE, barriers.up * INSIDE),
                };
            },
        );
    }

    /// Largest difference between the voltages at the first and the last frame.
    fn left_over(&self, Barriers { up, down }: Barriers) -> f64 {
        // Both ends lie between the barriers. An end is less than the larger threshold away from 0.
        match self.initial {
            InitialVoltage::Zero => up.max(down),
            InitialVoltage::Stationary => up + down,
        }
    }

    /// Number of frames before the end of a leg that its curve depends on; it depends on as many
    /// after its start.
    fn kept(&self) -> usize {
        if self.between == BetweenFrames::Catmull { 2 } else { 1 }
    }

    /// Coordinates of a pixel in the frame.
    pub(super) fn at(&self, pixel: usize) -> [u16; 2] {
        let width = self.size.width as usize;
        [(pixel % width) as u16, (pixel / width) as u16]
    }

    /// Coordinates of a pixel on the sensor.
    pub(super) fn at_sensor(&self, pixel: usize) -> [u16; 2] {
        let ([x, y], origin) = (self.at(pixel), self.origin);
        [x + origin[0], y + origin[1]]
    }
}

/// The rate of change of a frame.
pub(super) fn usable_rate(frame: &DenseFrame) -> Result<&[f32], String> {
    let Some(rate) = &frame.rate else {
        return Err("it has no rate of change, which `between: hermite` needs".to_owned());
    };
    let (found, wanted) = (rate.size(), frame.luminance.size());
    if found != wanted {
        return Err(format!("its rate of change is {found}, the frame is {wanted}"));
    }
    let width = wanted.width as usize;
    match rate.pixels().iter().position(|rate| !rate.is_finite()) {
        None => Ok(rate.pixels()),
        Some(bad) => {
            let (x, y, found) = (bad % width, bad / width, rate.pixels()[bad]);
            Err(format!("the rate of change of pixel ({x}, {y}) is {found}, not a finite number"))
        }
    }
}

/// Copies luminance and replaces negative values by 0. Returns the number of negative values, and
/// whether all are finite.
#[inline(always)]
fn clamp_luminance<S: Simd>(_: S, from: &[f32], to: &mut [f32]) -> (u64, bool) {
    /// The counts of a chunk fit into 32 bits, the width of the values, so the compiler can use
    /// vectors of one width.
    const CHUNK: usize = 4096;
    let (mut negative, mut finite) = (0, true);
    for (from, to) in from.chunks(CHUNK).zip(to.chunks_mut(CHUNK)) {
        let (mut below, mut unusable) = (0u32, 0u32);
        for (from, to) in from.iter().zip(to) {
            let is_negative = *from < 0.0;
            below += u32::from(is_negative);
            unusable |= u32::from(!from.is_finite());
            *to = if is_negative { 0.0 } else { *from };
        }
        negative += u64::from(below);
        finite &= unusable == 0;
    }
    (negative, finite)
}

impl SensorPixels for ExactSampler {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        self.store(frame)?;
        self.cross_known(sink)
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        let last = self.frames.back().map_or(0, |frame| frame.t);
        // The last root cell reaches beyond the last frame. Its draws are needed whole; later
        // events are dropped.
        let end = if self.law.process.is_noiseless() { last } else { (last + ROOT - 1) & !(ROOT - 1) };
        self.cross_until(end, last, sink)?;
        // One further, because no later window will complete the last microsecond.
        self.windows.close(end.div_euclid(1000) + 1, sink)?;
        Ok(self.settle())
    }
}

#[cfg(test)]
mod tests;
