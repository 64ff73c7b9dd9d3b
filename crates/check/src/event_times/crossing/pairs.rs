//! Residuals of pairs of events that follow each other on a pixel: the drift between them, less a
//! threshold.
//!
//! The level of a pixel is not known where its thresholds differ from the stated ones, where noise
//! adds events, or where a dead time drops some. Between two events it is: the drift is one
//! threshold of the pixel, whatever came before. A regression on the change of the rate between
//! them shows offset and scale.
//!
//! - **Thresholds that differ** are two unknown numbers per pixel. The means of its ON pairs and of
//!   its OFF pairs are removed, so no law of the thresholds is needed. A mean over the pixels would
//!   be biased: those of low thresholds make more events.
//! - **An event of the noise floor, of a hot pixel, or a lost event** spoils the two pairs that it
//!   is part of. Most of these are off by a large part of a threshold, and are left out. The rest
//!   biases the result, as they come early in their pairs: at 25 lux and slow motion by 14 us, with
//!   a standard error of 4 us. Pairs in which such an event has a probability of 1 % or more are
//!   therefore left out, whatever they show.
//! - **Noise of the voltage** ends a pair early where the drift is about to turn, so pairs in which
//!   it has a standard deviation of a tenth of a threshold or more are left out too, as are events
//!   against the drift.
//! - **Noise of the photoreceptor** returns, so that its deviation does not grow with the length of a
//!   pair. It is large in all pairs or in none, and a bound on it would leave out all pairs of a
//!   sensor. A bound on the length of a pair would bias the result, because noise makes the pairs
//!   shorter that it ends early. All pairs are used, and the bias of their residuals is part of the
//!   limit. It has two causes. The noise leans towards the drift at events, by less where the drift is
//!   faster ([`DriftLaw::receptor_lean`]): the residual of a pair is on average the lean at its start
//!   less that at its end. And a pair that ends late by noise meets a later value of a regressor: if
//!   that changes by `c` per time, and the noise has the variance `s^2` per time, both have the
//!   covariance `c T s^2 / r` in a pair of the length `T`. That is the change of the regressor, `c T`,
//!   times `s^2 / r`, twice the lean of a steady drift. No mean of a pixel removes a covariance.

use super::line_sums::{LineSums, MeanSums};
use super::{BAND, Crossing, SMALL};
use crate::drift::DriftLaw;
use gs2e_event::Polarity;

/// Largest probability of an event within a pair that does not come from the drift.
const MAX_DISTURBED: f64 = 0.01;
/// Largest standard deviation of the voltage over a pair by its noise, thresholds.
const MAX_NOISE: f64 = 0.1;
/// Standard deviations of the thresholds by which a pair may be off, in addition to [`SMALL`].
const SPREADS: f64 = 3.0;

/// Sums over the pairs of all pixels.
#[derive(Debug)]
pub(super) struct PairResiduals {
    law: DriftLaw,
    /// The previous event of each pixel.
    last: Vec<PairStart>,
    /// Sums over the pairs of each pixel that end with an ON or with an OFF event; empty for equal
    /// thresholds.
    groups: Vec<[MeanSums; 2]>,
    blocks: Vec<LineSums>,
    /// Number of pairs that are left out because noise may be their cause.
    pub(super) noisy: u64,
}

/// The event with which a pair starts, or the first frame.
#[derive(Debug, Clone, Copy)]
struct PairStart {
    t_us: f64,
    /// Drift at the event; NaN if it is unknown, or if the event does not follow it.
    drift: f64,
    moves: [f64; 2],
    /// Expected noise of the photoreceptor at the event, thresholds.
    lean: f64,
}

impl PairResiduals {
    pub(super) fn new(law: DriftLaw, first_us: f64, pixels: usize, blocks: usize) -> Self {
        // From zero, the first frame is like an event: the voltage is at the level, and does not
        // move yet.
        let drift = if law.from_zero { 0.0 } else { f64::NAN };
        let start = PairStart { t_us: first_us, drift, moves: [0.0; 2], lean: 0.0 };
        Self {
            law,
            last: vec![start; pixels],
            groups: vec![[MeanSums::default(); 2]; if law.spread > 0.0 { pixels } else { 0 }],
            blocks: vec![LineSums::default(); blocks],
            noisy: 0,
        }
    }

    /// The bits of the values that an event meets at a pixel.
    pub(super) fn met_by(&self, pixel: usize, polarity: Polarity) -> u64 {
        let sums = self.groups.get(pixel).map_or(0.0, |groups| groups[group_of(polarity)].n);
        self.last[pixel].t_us.to_bits() ^ sums.to_bits()
    }

    pub(super) fn see(&mut self, crossing: &Crossing) {
        let Crossing { pixel, block, t_us, drift, moves, threshold, brightness, .. } = *crossing;
        // A pair has a residual only if both of its events follow the drift, and if the drift is known.
        let drift = if crossing.is_along() { drift } else { f64::NAN };
        let from = self.last[pixel];
        let lean = self.law.receptor_lean(brightness, moves[0]);
        let now = lean.map_or(0.0, |lean| lean.after(from.lean, (t_us - from.t_us).max(0.0)));
        // Every event starts a pair, also one that is left out: the next pair is counted from it.
        self.last[pixel] = PairStart { t_us, drift, moves, lean: now };
        let left = drift - from.drift - crossing.jump();
        if left.is_nan() {
            return;
        }
        if self.is_noisy(crossing, t_us - from.t_us) {
            self.noisy += 1;
            return;
        }
        let moves = [0, 1].map(|i| moves[i] - from.moves[i]);
        // The bound follows the spread: a bound in thresholds alone would leave out the pixels whose
        // thresholds are far from the stated ones, and with them the widest residuals.
        let size = left.abs() / (SMALL * threshold + SPREADS * self.law.spread);
        if size < 1.0 {
            let leaning = from.lean - now;
            let late = lean.map_or(0.0, |lean| 2.0 * lean.steady);
            self.blocks[block].add(moves, left);
            self.blocks[block].add_expected(moves, leaning + late);
            self.blocks[block].add_late(moves, late);
            if let Some(groups) = self.groups.get_mut(pixel) {
                groups[group_of(crossing.polarity)].add(moves, [left, leaning + late]);
            }
        }
        if (size - 1.0).abs() < BAND {
            self.blocks[block].add_near_bound(moves);
        }
    }

    /// Returns true if a pair of this length may end with an event of noise, or end early by noise.
    fn is_noisy(&self, Crossing { brightness, threshold, .. }: &Crossing, length_us: f64) -> bool {
        // Files of strangers may go back in time.
        let length_us = length_us.max(0.0);
        let floor: f64 = self.law.floor_rates(*brightness).iter().sum();
        let own = floor + self.law.receptor_events(*brightness);
        let others = own * length_us + self.law.disturbances(*brightness, length_us);
        others >= MAX_DISTURBED || self.law.noise(*brightness, length_us) >= MAX_NOISE * threshold
    }

    /// The sums of each block. `block` is the block of a pixel.
    pub(super) fn blocks(&self, block: impl Fn(usize) -> usize) -> Vec<LineSums> {
        let mut blocks = self.blocks.clone();
        for (pixel, groups) in self.groups.iter().enumerate() {
            let sums = &mut blocks[block(pixel)];
            for group in groups.iter().filter(|group| group.n > 0.0) {
                *sums = sums.less(*group);
                // The mean takes as much as one pair says, so a single pair says nothing.
                sums.n -= 1.0;
            }
        }
        blocks
    }
}

/// The group of the pairs that end with an event of this polarity.
fn group_of(polarity: Polarity) -> usize {
    usize::from(polarity == Polarity::Off)
}
