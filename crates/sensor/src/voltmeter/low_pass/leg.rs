//! The filter between two frames.

use super::response::Response;
use super::{FilterLaw, SECONDS, StageRates};
use crate::voltmeter::BetweenFrames;
use crate::voltmeter::cubic::log_cubic;
use crate::voltmeter::curve::FrameEnds;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, SimdMask as _, f64x8, u64x8};
use gs2e_num::elementary::{exp_eight, load_eight, store_eight};

/// The brightness of all pixels between two frames.
#[derive(Debug)]
pub(super) struct FilterLeg<'a> {
    pub(super) law: &'a FilterLaw,
    /// `ln(L + k2)` at the frame before the leg, at its ends, and at the frame after it. Where there is no
    /// such frame, the end stands for it.
    pub(super) logs: [&'a [f64]; 4],
    /// Rendered slopes at the ends, per ns; only for `hermite`.
    pub(super) slopes: [&'a [f64]; 2],
    /// Weights of the steps before and after each end in its slope, per ns.
    pub(super) weights: [[f64; 2]; 2],
    /// Time between the frames, ns.
    pub(super) length: f64,
}

/// The outputs of the stages of some pixels, from the pixel `at` on.
#[derive(Debug)]
pub(super) struct StageSlice<'a> {
    pub(super) at: usize,
    pub(super) first: &'a mut [f64],
    /// Empty with one stage.
    pub(super) second: &'a mut [f64],
}

/// The end of a piece for the same pixels.
#[derive(Debug)]
pub(super) struct PieceEnd<'a> {
    /// Time since the leg's start, ns.
    pub(super) t: f64,
    pub(super) luminance: &'a mut [f32],
    /// Change of the luminance per second.
    pub(super) rate: &'a mut [f32],
}

/// The brightness of eight pixels as a cubic of the share `s` of the leg.
struct WideCubic<S: Simd> {
    start: f64x8<S>,
    coefficients: [f64x8<S>; 3],
}

/// Input and rate of the stages at a time.
#[derive(Clone, Copy)]
struct InputPoint<S: Simd> {
    /// `V`.
    log: f64x8<S>,
    /// `dV/dt`, per ns.
    slope: f64x8<S>,
    /// `lambda`, per ns.
    rate: f64x8<S>,
}

/// Outputs of the stages; with one, both are its own.
#[derive(Clone, Copy)]
struct StageOutputs<S: Simd> {
    first: f64x8<S>,
    last: f64x8<S>,
}

impl FilterLeg<'_> {
    /// Moves the stages from `start`, ns, along the leg, and fills in the ends of the pieces.
    #[inline(always)]
    pub(super) fn cross<S: Simd>(
        &self,
        simd: S,
        start: f64,
        stages: StageSlice<'_>,
        ends: &mut [PieceEnd<'_>],
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.cross_chunk(simd, start, stages, ends),
        );
    }

    #[inline(always)]
    fn cross_chunk<S: Simd>(&self, simd: S, start: f64, stages: StageSlice<'_>, ends: &mut [PieceEnd<'_>]) {
        let StageSlice { at, first, second } = stages;
        let two = !second.is_empty();
        // Where all pixels have one rate, the answers are the same for all.
        let mut shared: Vec<Response<S>> = Vec::with_capacity(ends.len());
        if let StageRates::Equal(rate) = self.law.rates {
            let mut from = start;
            for end in &*ends {
                shared.push(Response::new(f64x8::splat(simd, rate * (end.t - from))));
                from = end.t;
            }
        }
        for i in (0..first.len()).step_by(8) {
            let cubic = self.cubic(simd, at + i);
            let rests = cubic.stays_at(load_eight(simd, first, i))
                && (!two || cubic.stays_at(load_eight(simd, second, i)));
            if rests {
                // What has followed a light that stays does so on, whatever the rates: the bits are those of
                // the answer below.
                let still = f64x8::splat(simd, 0.0);
                // A loop: a closure may be compiled without the instruction set in use.
                for end in ends.iter_mut() {
                    self.store(cubic.start, still, end, i);
                }
                continue;
            }
            let mut point = self.point(&cubic, start);
            let mut from = start;
            let y = load_eight(simd, first, i);
            let mut outputs =
                StageOutputs { first: y, last: if two { load_eight(simd, second, i) } else { y } };
            for (piece, end) in ends.iter_mut().enumerate() {
                let next = self.point(&cubic, end.t);
                let response = match shared.get(piece) {
                    Some(response) => *response,
                    None => Response::new(self.turns(&cubic, [&point, &next], [from, end.t])),
                };
                outputs = outputs.go_on([&point, &next], &response, two);
                // A stage moves by the distance from its input.
                let input = if two { outputs.first } else { next.log };
                self.store(outputs.last, (input - outputs.last) * next.rate, end, i);
                (point, from) = (next, end.t);
            }
            store_eight(outputs.first, first, i);
            if two {
                store_eight(outputs.last, second, i);
            }
        }
    }

    /// The brightness of eight pixels from `i` on.
    #[inline(always)]
    fn cubic<S: Simd>(&self, simd: S, i: usize) -> WideCubic<S> {
        let [before, from, to, after] = self.logs;
        let [start, end] = [load_eight(simd, from, i), load_eight(simd, to, i)];
        let step = end - start;
        let slopes = if self.law.between == BetweenFrames::Hermite {
            [load_eight(simd, self.slopes[0], i), load_eight(simd, self.slopes[1], i)]
        } else {
            let [[a, b], [c, d]] = self.weights;
            [
                (start - load_eight(simd, before, i)) * a + step * b,
                step * c + (load_eight(simd, after, i) - end) * d,
            ]
        };
        let ends = FrameEnds { levels: [start, end], step, slopes, inverse: 1.0 / self.length };
        WideCubic { start, coefficients: log_cubic(&ends) }
    }

    /// The input at a time, ns since the leg's start.
    #[inline(always)]
    fn point<S: Simd>(&self, cubic: &WideCubic<S>, t: f64) -> InputPoint<S> {
        let s = t / self.length;
        let [c1, c2, c3] = cubic.coefficients;
        let log = cubic.start + ((c3 * s + c2) * s + c1) * s;
        let slope = ((c3 * (3.0 * s) + c2 * 2.0) * s + c1) * (1.0 / self.length);
        InputPoint { log, slope, rate: self.rate(log) }
    }

    /// `lambda` where `ln(L + k2)` is `log`.
    #[inline(always)]
    fn rate<S: Simd>(&self, log: f64x8<S>) -> f64x8<S> {
        match &self.law.rates {
            StageRates::Equal(rate) => f64x8::splat(log.simd, *rate),
            StageRates::ByGrey(curve) => {
                let greys = exp_eight(log) - self.law.k2;
                curve.eight(greys)
            }
        }
    }

    /// Length of a piece in time constants: Simpson's rule.
    #[inline(always)]
    fn turns<S: Simd>(
        &self,
        cubic: &WideCubic<S>,
        [from, to]: [&InputPoint<S>; 2],
        times: [f64; 2],
    ) -> f64x8<S> {
        let middle = self.point(cubic, 0.5 * (times[0] + times[1]));
        (from.rate + middle.rate * 4.0 + to.rate) * ((times[1] - times[0]) * (1.0 / 6.0))
    }

    /// Writes the brightness of eight pixels at the end of a piece.
    #[inline(always)]
    fn store<S: Simd>(&self, log: f64x8<S>, slope: f64x8<S>, end: &mut PieceEnd<'_>, i: usize) {
        /// Largest value of a frame.
        const MOST: f64 = f32::MAX as f64;
        /// Darkest level in units of `k2`. A cubic may lie below black, and the logarithm behind the filter
        /// needs a number above 0 also when it has been rounded.
        const LEAST: f64 = 1.0 / 1024.0;
        /// In units of `k2`: adding and subtracting this rounds to `2^-40 k2`, so that logarithm and
        /// exponential leave black at 0.
        const ROUNDER: f64 = 1.5 * 4096.0;
        let k2 = self.law.k2;
        let level = exp_eight(log).max(LEAST * k2);
        let luminance = (((level - k2) + ROUNDER * k2) - ROUNDER * k2).min(MOST);
        let rate = (level * slope * (1.0 / SECONDS)).max(-MOST).min(MOST);
        let (luminance, rate): ([f64; 8], [f64; 8]) = (luminance.into(), rate.into());
        let (to, change) = (&mut end.luminance[i..i + 8], &mut end.rate[i..i + 8]);
        // Loops without a closure, which the compiler turns into vector conversions.
        #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
        for lane in 0..8 {
            to[lane] = luminance[lane] as f32;
        }
        #[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
        for lane in 0..8 {
            change[lane] = rate[lane] as f32;
        }
    }
}

impl<S: Simd> WideCubic<S> {
    /// Returns true if the brightness of all eight is constant, and these outputs have reached it.
    #[inline(always)]
    fn stays_at(&self, outputs: f64x8<S>) -> bool {
        let [c1, c2, c3] = self.coefficients;
        // Without the sign: a negative zero is a zero.
        let moving = (c1.to_bits() | c2.to_bits() | c3.to_bits()) << 1;
        let away = outputs.to_bits() ^ self.start.to_bits();
        let zero = u64x8::splat(outputs.simd, 0);
        (moving | away).simd_eq(zero).all_true()
    }
}

impl<S: Simd> StageOutputs<S> {
    /// The outputs at the end of a piece. `V` is taken for the cubic in time constants that has its values
    /// and slopes at both ends; for one rate, it is that cubic.
    #[inline(always)]
    fn go_on(self, [from, to]: [&InputPoint<S>; 2], response: &Response<S>, two: bool) -> Self {
        let Response { turns, decay, one, two: of_two } = *response;
        let rise = to.log - from.log;
        // Slopes per unit of `s`, which runs from 0 to 1 over the piece.
        let [a, b] = [from.slope * (turns / from.rate), to.slope * (turns / to.rate)];
        let (square, cube) = (rise * 3.0 - a * 2.0 - b, a + b - rise * 2.0);
        let deviation = self.first - from.log;
        let first = from.log + (deviation * decay + (a * one[0] + square * one[1] + cube * one[2]));
        if !two {
            return Self { first, last: first };
        }
        let behind = self.last - from.log;
        let kept = (behind + deviation * turns) * decay;
        let last = from.log + (kept + (a * of_two[0] + square * of_two[1] + cube * of_two[2]));
        Self { first, last }
    }
}
