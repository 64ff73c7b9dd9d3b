//! The delay of the events and the bandwidth of the pixels.
//!
//! A delay shifts the voltage, and a low-pass of first order keeps the light ahead of it by `tau V'`. Both
//! are the same for a steady rise; they differ where the voltage bends, and by light. So the sum is known
//! well, and its parts badly.

use crate::anchor::{Anchor, AnchorFilter, anchors};
use crate::ladder::{self, Expected, FitForm, FrameNoise, LAG, LOST, Ladder, LadderFit, OFF, ON, Start};
use crate::recording::Recording;

/// Delays that are tried first, us.
const COARSE_US: [f64; 10] = [-6e3, -4e3, -2e3, 0.0, 2e3, 4e3, 6e3, 8e3, 10e3, 12e3];
/// Distances from the best at which it is tried again, us.
const FINE_US: [f64; 2] = [1000.0, 500.0];
/// Anchors that decide about the delay: more make it no better, and slow.
const ENOUGH: usize = 40_000;

/// Shortest lag that a fit may find, us.
const EARLIEST_US: f64 = -200.0;
/// Longest typical lag, us.
const TYPICAL_LAG_US: f64 = 3000.0;
/// Delays this far from the best, us, have to fit worse by the margin where the delay is determined.
const FAR_US: f64 = 1500.0;
/// Misfits that differ by less do not tell two models apart.
const MARGIN: f64 = 0.02;

/// What all fits of a recording share.
#[derive(Debug)]
pub(crate) struct Trials<'a> {
    pub recording: &'a Recording,
    pub filter: AnchorFilter<'a>,
    pub noise: FrameNoise,
    pub form: FitForm,
}

impl Trials<'_> {
    fn start(&self, lost: f64) -> Start {
        let mut value = [0.0; 9];
        value[ladder::ON] = 0.25;
        value[ladder::OFF] = 0.25;
        value[LAG] = 2000.0;
        value[ladder::SLOPE] = 0.75;
        value[ladder::BLUR] = 0.5;
        value[ladder::LOST] = lost;
        // A share that moved would follow the spread: pixels of low contrast have short gaps.
        let all = (0..value.len()).filter(|of| *of != ladder::LOST);
        Start { value, free: all.collect() }
    }

    fn fit(&self, found: &[Anchor], lost: f64) -> Option<LadderFit> {
        let width = self.recording.size.width as usize;
        let expected = Expected { noise: self.noise, form: self.form };
        Ladder::new(found, width, expected, self.start(lost)).fit()
    }

    /// The better fit with the delay, by enough anchors.
    fn at(&self, delay_us: f64) -> Option<LadderFit> {
        let mut found = anchors(self.recording, &self.filter, delay_us);
        let share = found.len().div_ceil(ENOUGH);
        if share > 1 {
            // Whole pixels, from all over the picture.
            found.retain(|anchor| (anchor.pixel * 7919 / 16).is_multiple_of(share));
        }
        Some(self.both(&found)?.0)
    }

    /// The fits with the change in dead times kept, and lost; the better one first.
    fn both(&self, found: &[Anchor]) -> Option<(LadderFit, LadderFit)> {
        let kept = self.fit(found, 0.0)?;
        // Without a dead time there is nothing to lose.
        let lost = if self.filter.dead_us > 0.0 { self.fit(found, 1.0)? } else { kept.clone() };
        Some(if kept.misfit <= lost.misfit { (kept, lost) } else { (lost, kept) })
    }

    /// The contrasts of the first and of the second half.
    fn halves(&self, found: Vec<Anchor>, lost: f64) -> Option<[[f64; 2]; 2]> {
        let middle_us = 0.5e6 * self.recording.seconds();
        let (first, second): (Vec<_>, Vec<_>) =
            found.into_iter().partition(|anchor| anchor.since_us < middle_us);
        let of = |half: &[Anchor]| self.fit(half, lost).map(|fit| [fit.value[ON], fit.value[OFF]]);
        Some([of(&first)?, of(&second)?])
    }

    /// The delay of smallest misfit, and the fit with it.
    pub(crate) fn best(&self) -> Option<BestDelay> {
        let tried = |delays: &[f64]| -> Vec<(f64, f64)> {
            let fits = delays.iter().filter_map(|delay| Some((*delay, self.at(*delay)?)));
            // A lag below 0 would be a voltage ahead of the light.
            let possible = fits.filter(|(_, fit)| fit.value[LAG] > EARLIEST_US);
            possible.map(|(delay, fit)| (delay, fit.misfit + price(delay, fit.value[LAG]))).collect()
        };
        let least = |all: &[(f64, f64)]| all.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
        let coarse = tried(&COARSE_US);
        let mut best = least(&coarse)?;
        for step in FINE_US {
            let near = least(&tried(&[best.0 - step, best.0 + step]));
            best = near.filter(|near| near.1 < best.1).unwrap_or(best);
        }
        let is_far = |delay: f64| (delay - best.0).abs() >= FAR_US;
        let is_sharp = coarse.iter().filter(|(delay, _)| is_far(*delay)).all(|(_, m)| *m > best.1 + MARGIN);
        let found = anchors(self.recording, &self.filter, best.0);
        let (fit, other) = self.both(&found)?;
        let halves = self.halves(found, fit.value[LOST]);
        Some(BestDelay { delay_us: best.0, fit, other, halves, is_sharp })
    }
}

/// A delay with its fit.
#[derive(Debug)]
pub(crate) struct BestDelay {
    pub delay_us: f64,
    pub fit: LadderFit,
    /// The same with the other reference after a dead time.
    pub other: LadderFit,
    /// Contrasts ON and OFF of the first and of the second half, if they determine them.
    pub halves: Option<[[f64; 2]; 2]>,
    /// True if no other delay fits nearly as well.
    pub is_sharp: bool,
}

/// What is added to a misfit for a lag beyond that of a camera in usable light, and for events ahead of the
/// light, so that a flat misfit does not lead there.
fn price(delay_us: f64, lag_us: f64) -> f64 {
    let beyond = (lag_us - TYPICAL_LAG_US).max(0.0) - delay_us.min(0.0);
    MARGIN * (beyond / TYPICAL_LAG_US) * (beyond / TYPICAL_LAG_US)
}
