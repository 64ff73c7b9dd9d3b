//! The delay of the events and the bandwidth of the pixels.
//!
//! A delay shifts the voltage, and a low-pass of first order keeps the light ahead of it by `tau V'`. Both
//! are the same for a steady rise; they differ where the voltage bends, and by light. So the sum is known
//! well, and its parts badly.

use crate::anchor::{Anchor, AnchorFilter, EventRule, anchors};
use crate::ladder::{self, Expected, FitForm, FrameNoise, LAG, Ladder, LadderFit, OFF, ON, Start};
use crate::linear::MOST;
use crate::recording::Recording;

/// Delays that are tried first, us.
const COARSE_US: [f64; 10] = [-6e3, -4e3, -2e3, 0.0, 2e3, 4e3, 6e3, 8e3, 10e3, 12e3];
/// Distances from the best at which it is tried again, us.
const FINE_US: [f64; 2] = [1000.0, 500.0];
/// Anchors that decide about the delay: more make it no better, and slow.
const ENOUGH: usize = 40_000;

/// Dead times that are assumed where the gaps show none, in the longest that is possible.
const ASSUMED: [f64; 6] = [0.0625, 0.125, 0.25, 0.5, 0.75, 1.0];
/// An assumption on dead times is open if its misfit is below this factor of the smallest, and this much
/// more: where the dead time is known, and where it is not.
const OPEN_KNOWN: [f64; 2] = [1.1, 0.005];
const OPEN_ASSUMED: [f64; 2] = [1.02, 0.003];
/// Misfit, by the smallest, beyond which longer dead times are not tried.
const CLOSED: f64 = 1.5;
/// Steps between two assumed dead times.
const BETWEEN: usize = 8;

/// Shortest lag that a fit may find, us.
const EARLIEST_US: f64 = -200.0;
/// Longest typical lag, us.
const TYPICAL_LAG_US: f64 = 3000.0;
/// Delays this far from the best, us, have to fit worse by the margin where the delay is determined.
const FAR_US: f64 = 1500.0;
/// Misfits that differ by less do not tell two models apart.
const MARGIN: f64 = 0.02;

/// What is known of the dead time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DeadTime {
    /// The dead time, us, if the gaps determine it.
    pub found: Option<f64>,
    /// The longest that is possible, us.
    pub longest_us: f64,
}

/// What all fits of a recording share.
#[derive(Debug)]
pub(crate) struct Trials<'a> {
    pub recording: &'a Recording,
    pub filter: AnchorFilter<'a>,
    pub dead: DeadTime,
    pub noise: FrameNoise,
    pub form: FitForm,
}

impl Trials<'_> {
    fn fit(&self, found: &[Anchor]) -> Option<LadderFit> {
        let width = self.recording.size.width as usize;
        let expected = Expected { noise: self.noise, form: self.form };
        let mut value = [0.0; MOST];
        value[ladder::ON] = 0.25;
        value[ladder::OFF] = 0.25;
        value[LAG] = 2000.0;
        value[ladder::SLOPE] = 0.75;
        value[ladder::BLUR] = 0.5;
        let start = Start { value, free: (0..value.len()).collect() };
        Ladder::new(found, width, expected, start).fit()
    }

    fn anchors(&self, rule: EventRule) -> Vec<Anchor> {
        anchors(self.recording, &self.filter, rule)
    }

    /// The fit with the delay, by enough anchors.
    fn at(&self, delay_us: f64) -> Option<LadderFit> {
        let fit = |rule| {
            let mut found = self.anchors(rule);
            let share = found.len().div_ceil(ENOUGH);
            if share > 1 {
                // Whole pixels, from all over the picture.
                found.retain(|anchor| (anchor.pixel * 7919 / 16).is_multiple_of(share));
            }
            self.fit(&found)
        };
        let dead_us = self.dead.found.unwrap_or(0.0);
        let kept = fit(EventRule { delay_us, dead_us, loses: false })?;
        // A dead time that is not known shifts the events of all delays alike.
        let lost = (dead_us > 0.0).then(|| fit(EventRule { delay_us, dead_us, loses: true })).flatten();
        Some(lost.filter(|lost| lost.misfit < kept.misfit).unwrap_or(kept))
    }

    /// The fits with all assumptions on dead times, in their order.
    fn assumed(&self, delay_us: f64) -> Vec<(EventRule, LadderFit)> {
        let of = |dead_us: f64, loses: bool| {
            let rule = EventRule { delay_us, dead_us, loses };
            self.fit(&self.anchors(rule)).map(|fit| (rule, fit))
        };
        if let Some(dead) = self.dead.found {
            return [false, true].into_iter().filter_map(|loses| of(dead, loses)).collect();
        }
        // Nothing is lost in no time.
        let mut all: Vec<_> = of(0.0, false).into_iter().collect();
        for part in if self.dead.longest_us > 0.0 { &ASSUMED[..] } else { &[] } {
            let least = all.iter().map(|(_, fit)| fit.misfit).fold(f64::INFINITY, f64::min);
            let Some(next) = of(part * self.dead.longest_us, true) else { break };
            let is_closed = next.1.misfit > CLOSED * least;
            all.push(next);
            if is_closed {
                break;
            }
        }
        all
    }

    /// The smallest and the largest contrast ON and OFF of the assumptions that are open.
    fn open(&self, all: &[(EventRule, LadderFit)], least: f64) -> [[f64; 2]; 2] {
        let [factor, more] = if self.dead.found.is_some() { OPEN_KNOWN } else { OPEN_ASSUMED };
        let limit = factor * least + more;
        let row = |fit: &LadderFit| [fit.misfit, fit.value[ON], fit.value[OFF]];
        let mut rows: Vec<[f64; 3]> = all.iter().map(|(_, fit)| row(fit)).collect();
        if self.dead.found.is_none() {
            // Dead times between those that were tried.
            let between = |pair: &[[f64; 3]]| {
                let [a, b] = [pair[0], pair[1]];
                (1..BETWEEN).map(move |k| {
                    let share = k as f64 / BETWEEN as f64;
                    [0, 1, 2].map(|i| a[i] + share * (b[i] - a[i]))
                })
            };
            let more: Vec<_> = rows.windows(2).flat_map(between).collect();
            rows.extend(more);
        }
        let open = rows.iter().filter(|row| row[0] <= limit);
        open.fold([[f64::INFINITY, f64::NEG_INFINITY]; 2], |mut range, row| {
            for side in [0, 1] {
                let [low, high] = range[side];
                range[side] = [low.min(row[1 + side]), high.max(row[1 + side])];
            }
            range
        })
    }

    /// The contrasts of the first and of the second half.
    fn halves(&self, rule: EventRule) -> Option<[[f64; 2]; 2]> {
        let middle_us = 0.5e6 * self.recording.seconds();
        let (first, second): (Vec<_>, Vec<_>) =
            self.anchors(rule).into_iter().partition(|anchor| anchor.since_us < middle_us);
        let of = |half: &[Anchor]| self.fit(half).map(|fit| [fit.value[ON], fit.value[OFF]]);
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
        let all = self.assumed(best.0);
        let (rule, fit) = all.iter().min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))?.clone();
        let open = self.open(&all, fit.misfit);
        let halves = self.halves(rule);
        Some(BestDelay { rule, fit, open, halves, is_sharp })
    }
}

/// A delay with its fit.
#[derive(Debug)]
pub(crate) struct BestDelay {
    pub rule: EventRule,
    pub fit: LadderFit,
    /// Smallest and largest contrast ON and OFF with what may be of dead times.
    pub open: [[f64; 2]; 2],
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
