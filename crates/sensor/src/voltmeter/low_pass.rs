//! The bandwidth of the pixels: a low-pass filter of `V = ln(L + k2)` in front of the exact law.
//!
//! Between two frames, `V` is the cubic of `cubic.rs`, or a straight line. A stage `dy/dt = lambda (V - y)`,
//! whose `lambda = 2 pi cutoff` follows the light, has a closed answer to a cubic in the time `tau = integral
//! of lambda` (`response.rs`). So values and slopes of `y` at any time are known (`leg.rs`), and between close
//! times `y` is nearly a cubic. The filter cuts a leg between two frames into pieces (`cuts.rs`), and gives
//! their ends to the exact law as frames with rates of change.
//!
//! ```text
//!  frames      *-----------------------------*-----------    V, a cubic between frames
//!  for the law *--*---*----*------*----------*--*---*----    y and its slope, a cubic between the ends
//!              |  denser where the filter still settles
//! ```
//!
//! For a light that stays, the answer is exact. Where it changes, the integral of `lambda` is Simpson's, and
//! `V` is taken for a cubic in `tau`: both are of fourth order in the change of `lambda` over a piece.
//!
//! The law behind the filter sees the light behind it too: its noise, its leak `k5 L` and its labels follow
//! the filtered brightness. A noise floor and a latency follow the frames.
//!
//! Between the filter and the law, brightness has 32 bits, as in frames: `V` moves by at most `2^-25`, which
//! does not add up. Another answer of the filter is another law: raise `VERSION` in `exact.rs`.

mod cuts;
mod leg;
mod response;

use super::cubic::secant_weights;
use super::exact::{ExactSampler, PendingFrame, usable_rate};
use super::{BetweenFrames, VoltmeterModel};
use crate::bandwidth::PixelBandwidth;
use crate::chain::PixelArray;
use crate::frames::DenseFrame;
use crate::noise::grey_table::GreyCurve;
use crate::{SensorError, SensorPixels, SimulationAccount, input};
use cuts::CutRule;
use fearless_simd::{Level, Simd, dispatch};
use gs2e_event::EventSink;
use gs2e_image::Size;
use gs2e_num::elementary::{ln_eight, load_eight, store_eight};
use leg::{FilterLeg, PieceEnd, StageSlice};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Pixels per task; a multiple of 8.
const CHUNK: usize = 4096;
/// Pieces of a leg whose ends are in memory at the same time.
const TOGETHER: usize = 8;
/// Seconds in a nanosecond.
const SECONDS: f64 = 1e-9;

/// The filter of a sensor.
#[derive(Debug)]
struct FilterLaw {
    k2: f64,
    rates: StageRates,
    between: BetweenFrames,
}

/// `lambda` of a stage, per ns.
#[derive(Debug)]
enum StageRates {
    /// The same at all lights.
    Equal(f64),
    /// By the grey of the pixel.
    ByGrey(GreyCurve),
}

/// Pixels whose brightness passes a filter.
#[derive(Debug)]
pub(super) struct LowPassPixels {
    law: FilterLaw,
    rule: CutRule,
    /// The law behind the filter.
    inner: ExactSampler,
    size: Size,
    /// The instruction set in use.
    level: Level,
    frames: VecDeque<SeenFrame>,
    /// Frames that are no longer needed; their memory is reused.
    spare: Vec<SeenFrame>,
    /// Outputs of the stages at the last end of a piece, padded to a multiple of 8. The second is empty with
    /// one stage.
    stages: [Vec<f64>; 2],
    negative_luminance: u64,
}

/// A frame on its way to the filter, padded to a multiple of 8.
#[derive(Debug, Default)]
struct SeenFrame {
    index: usize,
    t: i64,
    /// `ln(L + k2)`.
    logs: Vec<f64>,
    /// Its rendered slope, per ns; empty unless the interpolation is `hermite`.
    slopes: Vec<f64>,
}

impl LowPassPixels {
    /// The pixels of a sensor, which fail beyond `cap` events of one pixel between two frames.
    pub(super) fn new(sensor: &VoltmeterModel, cap: u32, array: PixelArray) -> Self {
        let VoltmeterModel { bandwidth, between, .. } = sensor;
        // The law behind the filter gets a rate of change with every frame.
        let bare = VoltmeterModel {
            between: BetweenFrames::Hermite,
            bandwidth: PixelBandwidth::default(),
            ..sensor.clone()
        };
        let size = array.size;
        let padded = size.pixels().next_multiple_of(8);
        let per_ns = |cutoff_hz: f64| TAU * cutoff_hz * SECONDS;
        let white_lux = sensor.settings.front_end.white_lux();
        let by_grey = |grey: f64| per_ns(bandwidth.cutoff_at_grey(grey, white_lux));
        let rates = if bandwidth.follows_light() {
            StageRates::ByGrey(GreyCurve::new(by_grey))
        } else {
            StageRates::Equal(by_grey(0.0))
        };
        let second = if bandwidth.order > 1 { padded } else { 0 };
        Self {
            law: FilterLaw { k2: sensor.k[1], rates, between: *between },
            rule: CutRule::new(bandwidth.extremes_hz().map(per_ns), bandwidth.order),
            inner: ExactSampler::new(&bare, cap, array),
            size,
            level: Level::new(),
            frames: VecDeque::new(),
            spare: Vec::new(),
            stages: [vec![0.0; padded], vec![0.0; second]],
            negative_luminance: 0,
        }
    }

    /// Checks and converts a frame. The pixels have seen the first for a long time.
    fn store(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        let before = self.frames.back().map(|before| before.t);
        self.negative_luminance += input::admit_frame(before, frame, self.size)?;
        let mut rate: &[f32] = &[];
        if self.law.between == BetweenFrames::Hermite {
            let refuse = |because| SensorError::Frame { frame: frame.index, because };
            rate = usable_rate(frame).map_err(refuse)?;
        }
        let mut seen = self.spare.pop().unwrap_or_default();
        (seen.index, seen.t) = (frame.index, frame.t.0);
        let luminance = frame.luminance.pixels();
        seen.fill(self.level, [luminance, rate], self.law.k2);
        if before.is_none() {
            for stage in self.stages.iter_mut().filter(|stage| !stage.is_empty()) {
                stage.copy_from_slice(&seen.logs);
            }
            let mut first = self.inner.spare();
            (first.index, first.t) = (seen.index, seen.t);
            first.luminance.extend(luminance.iter().map(|l| l.max(0.0)));
            first.luminance.resize(seen.logs.len(), 0.0);
            first.rate.resize(seen.logs.len(), 0.0);
            self.inner.advance_stored(first, sink)?;
        }
        self.frames.push_back(seen);
        Ok(())
    }

    /// Passes the leg behind the frame at this position through the filter and the law.
    fn cross_leg(&mut self, at: usize, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        let [from, to] = [at, at + 1].map(|at| (self.frames[at].index, self.frames[at].t));
        let mut start = 0.0;
        for cuts in self.rule.cuts(to.1 - from.1).chunks(TOGETHER) {
            let mut ends: Vec<PendingFrame> = Vec::new();
            for cut in cuts {
                let mut end = self.inner.spare();
                end.t = from.1 + cut;
                // Events are counted between the frames of the sequence.
                end.index = if end.t == to.1 { to.0 } else { from.0 };
                end.luminance.resize(self.stages[0].len(), 0.0);
                end.rate.resize(self.stages[0].len(), 0.0);
                ends.push(end);
            }
            let times: Vec<f64> = cuts.iter().map(|cut| *cut as f64).collect();
            self.filter(at, start, &times, &mut ends);
            start = times[times.len() - 1];
            ends.into_iter().try_for_each(|end| self.inner.advance_stored(end, sink))?;
        }
        Ok(())
    }

    /// Moves the stages from `start` along a leg, and fills in the brightness at these times, ns.
    fn filter(&mut self, at: usize, start: f64, times: &[f64], ends: &mut [PendingFrame]) {
        let leg = self.law.leg(&self.frames, at);
        let [first, second] = &mut self.stages;
        let chunks = first.len().div_ceil(CHUNK);
        let mut second: Vec<&mut [f64]> = second.chunks_mut(CHUNK).collect();
        second.resize_with(chunks, || &mut []);
        let mut outputs: Vec<Vec<PieceEnd<'_>>> = std::iter::repeat_with(Vec::new).take(chunks).collect();
        for (end, t) in ends.iter_mut().zip(times) {
            let parts = end.luminance.chunks_mut(CHUNK).zip(end.rate.chunks_mut(CHUNK));
            for (output, (luminance, rate)) in outputs.iter_mut().zip(parts) {
                output.push(PieceEnd { t: *t, luminance, rate });
            }
        }
        let level = self.level;
        let parts = first.par_chunks_mut(CHUNK).zip(second).zip(outputs).enumerate();
        parts.for_each(|(i, ((first, second), mut ends))| {
            let stages = StageSlice { at: i * CHUNK, first, second };
            dispatch!(level, simd => leg.cross(simd, start, stages, &mut ends));
        });
    }
}

impl FilterLaw {
    /// The leg behind the frame at this position.
    fn leg<'a>(&'a self, frames: &'a VecDeque<SeenFrame>, at: usize) -> FilterLeg<'a> {
        let [from, to] = [&frames[at], &frames[at + 1]];
        let length = (to.t - from.t) as f64;
        let (mut before, mut after) = (from, to);
        if self.between == BetweenFrames::Catmull {
            before = at.checked_sub(1).map_or(from, |at| &frames[at]);
            after = frames.get(at + 2).unwrap_or(to);
        }
        // Without neighbours, both slopes are that of the line between the frames.
        let [earlier, later] = [from.t - before.t, after.t - to.t].map(|t| t as f64);
        FilterLeg {
            law: self,
            logs: [before, from, to, after].map(|frame| &frame.logs[..]),
            slopes: [from, to].map(|frame| &frame.slopes[..]),
            weights: [secant_weights([earlier, length]), secant_weights([length, later])],
            length,
        }
    }
}

impl SeenFrame {
    /// Takes luminance and its rate per second, which is empty unless it is needed.
    fn fill(&mut self, level: Level, [luminance, rate]: [&[f32]; 2], k2: f64) {
        let Self { logs, slopes, .. } = self;
        // Padding is black.
        logs.clear();
        logs.extend(luminance.iter().map(|l| f64::from(l.max(0.0)) + k2));
        logs.resize(logs.len().next_multiple_of(8), k2);
        slopes.clear();
        slopes.extend(rate.iter().zip(&*logs).map(|(rate, level)| f64::from(*rate) * SECONDS / level));
        slopes.resize(slopes.len().next_multiple_of(8), 0.0);
        logs.par_chunks_mut(CHUNK).for_each(|logs| dispatch!(level, simd => take_logs(simd, logs)));
    }
}

#[inline(always)]
fn take_logs<S: Simd>(simd: S, levels: &mut [f64]) {
    for i in (0..levels.len()).step_by(8) {
        store_eight(ln_eight(load_eight(simd, levels, i)), levels, i);
    }
}

impl SensorPixels for LowPassPixels {
    fn advance(&mut self, frame: &DenseFrame, sink: &mut dyn EventSink) -> Result<(), SensorError> {
        self.store(frame, sink)?;
        // A `catmull` leg waits for the frame after its end, and needs the one before its start.
        let [wanted, kept] = if self.law.between == BetweenFrames::Catmull { [3, 3] } else { [2, 1] };
        if let Some(at) = self.frames.len().checked_sub(wanted) {
            self.cross_leg(at, sink)?;
        }
        while self.frames.len() > kept {
            self.spare.extend(self.frames.pop_front());
        }
        Ok(())
    }

    fn finish(&mut self, sink: &mut dyn EventSink) -> Result<SimulationAccount, SensorError> {
        // Without waiting, the last leg has been crossed and one frame is left.
        if let Some(at) = self.frames.len().checked_sub(2) {
            self.cross_leg(at, sink)?;
        }
        let account = self.inner.finish(sink)?;
        Ok(SimulationAccount { negative_luminance: self.negative_luminance, ..account })
    }
}

#[cfg(test)]
mod tests;
