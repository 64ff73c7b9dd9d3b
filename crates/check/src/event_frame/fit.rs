//! Events against frames at one instant: the counts of each pixel, and the change of its brightness
//! since the first frame.

mod balance;
mod edge;
mod floor;
mod lag;
mod unequal;

pub(crate) use balance::DriftBalance;
pub use balance::FrameComparison;
pub use edge::EventEdge;
pub use floor::SpoiltPixels;
pub use lag::LagSums;
pub(super) use unequal::MAX_SPREAD;

use crate::drift::{DriftLaw, length};
use balance::PixelChange;
use edge::{NearPixel, find_edge, find_unequal_edge};
use unequal::UnequalLaw;

/// Largest uncertainty of a pixel's drift, in thresholds, for its use in an edge. With an edge that
/// is sharp to 2 %, an error of the threshold of a tenth is still visible.
const MAX_BLUR: f64 = 0.04;
/// For unequal pixels, in spreads of their thresholds: it widens their edge by an eighth.
const MAX_UNEQUAL_BLUR: f64 = 0.5;
/// Largest effect of unequal thresholds on the edge of a pixel, in that of one threshold: pixels with
/// many events of both polarities would blur it.
const MAX_PIXEL_SPREAD: f64 = 1.5;
/// Thresholds beyond a possible residual from which on a pixel is stray: single events that the bound misses
/// are not.
pub(crate) const STRAY: f64 = 3.0;
/// Standard deviations of a sum or a quantile that are allowed.
const DEVIATIONS: f64 = 4.0;

/// The state of all pixels at one anchor, as statistics.
///
/// For each pixel, `dv` is the drift since the first frame, and `s = A on - B off` the drift
/// according to its events. The residual voltage is `dv - s` minus the pixel's initial voltage:
/// between `-B` and `A`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AnchorFit {
    /// Stamp of the anchor.
    pub t_us: i64,
    /// Number of events so far.
    pub events: u64,
    /// Sums over pixels with a drift of more than a threshold, separately for up and down.
    pub slopes: [SlopeSums; 2],
    /// Number of these pixels with a possible residual.
    pub possible: u64,
    /// Number of them whose residual the noise floor or their own thresholds may make impossible.
    pub maybe_impossible: SpoiltPixels,
    /// Number of pixels with a drift of more than two thresholds, and of those among them whose
    /// events have the same sign.
    pub doubled: [u64; 2],
    /// Number of them whose sign the noise floor may turn.
    pub turned_by_floor: SpoiltPixels,
    /// Number of all compared pixels whose events and drift differ by `STRAY` thresholds more than is
    /// possible.
    pub stray: u64,
    /// Number of the compared pixels.
    pub compared: u64,
    /// Delay of the events, if a span of frames shows it.
    pub lag: LagSums,
    /// Thresholds at which ON and OFF events happen, relative to the stated ones.
    pub edges: [Option<EventEdge>; 2],
    /// Expected sum of `s` over pixels: the drift, in whole thresholds towards 0 if voltages start
    /// at 0, and exact on average if they start anywhere.
    pub expected: f64,
    /// Pixels that are left out, because the frames do not determine their brightness closely
    /// enough.
    pub unknown: u64,
    /// Mean number of events per compared pixel that noise makes, and that move its reference.
    pub disturbed: f64,
}

/// A pixel at an anchor.
#[derive(Debug, Clone, Copy)]
struct FittedPixel {
    /// Its drift minus that of its events.
    left: f64,
    /// True if noise cannot be the reason for having no event.
    must_fire: bool,
}

/// Sums of `dv` and `s` over pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlopeSums {
    /// Number of pixels.
    pub pixels: u64,
    /// Sum of `s dv`.
    pub products: f64,
    /// Sum of `s^2`, less what noise and unequal thresholds are expected to add to it.
    pub squares: f64,
    /// Sum of `|s|`.
    pub sizes: f64,
    /// Sum of `|s|` times the further error of the pixel, by rounded frames.
    pub errors: f64,
    /// Variance of `products - squares` by noise and unequal thresholds.
    pub scatter: f64,
}

impl std::ops::Add for SlopeSums {
    type Output = Self;

    fn add(self, o: Self) -> Self {
        Self {
            pixels: self.pixels + o.pixels,
            products: self.products + o.products,
            squares: self.squares + o.squares,
            sizes: self.sizes + o.sizes,
            errors: self.errors + o.errors,
            scatter: self.scatter + o.scatter,
        }
    }
}

impl SlopeSums {
    /// The factor that brings `s` nearest to `dv`: `<s, dv> / <s, s>`.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.products / self.squares
    }

    /// Largest distance of a sound stream's factor from 1 that residuals and noise can cause. With
    /// `|dv - s| <= most`, `|factor - 1| <= most <|s|> / <s, s>`.
    #[must_use]
    pub(crate) fn allowance(&self, most: f64) -> f64 {
        (most * self.sizes + self.errors + DEVIATIONS * self.scatter.sqrt()) / self.squares
    }

    /// Adds a pixel with the events `s`. `second` and `fourth` are the cumulants of the part of `s`
    /// that does not follow the drift.
    fn add(&mut self, s: f64, dv: f64, error: f64, [second, fourth]: [f64; 2]) {
        self.errors += s.abs() * error;
        self.pixels += 1;
        self.products += s * dv;
        // A part without correlation to the drift adds its variance to the square, and nothing to
        // the product.
        self.squares += s * s - second;
        self.sizes += s.abs();
        // `s (dv - s)` changes by `s e` and by `e^2`, whose variance is the fourth cumulant plus
        // twice the square of the second.
        self.scatter += s * s * second + 2.0 * second * second + fourth;
    }
}

/// Sums over pixels for a [`AnchorFit`].
struct FitSums {
    law: DriftLaw,
    unequal: UnequalLaw,
    /// Largest possible difference of drift and events.
    most_residual: f64,
    near: [Vec<NearPixel>; 2],
    known: u64,
    /// The sums so far.
    fit: AnchorFit,
}

impl FitSums {
    fn new(law: &DriftLaw, slack: f64, t_us: i64) -> Self {
        Self {
            law: *law,
            unequal: UnequalLaw::new(law.thresholds, law.spread),
            // 2 % for events in the microsecond of the anchor, and for the law's finer steps.
            most_residual: 1.02 * law.most_residual() + slack,
            near: [Vec::new(), Vec::new()],
            known: 0,
            fit: AnchorFit { t_us, ..AnchorFit::default() },
        }
    }

    /// Adds a pixel, and returns what it shows, if its drift is known.
    fn add(&mut self, change: PixelChange, counts: [u32; 2]) -> Option<FittedPixel> {
        let PixelChange { dv, s, blur, error, unequal, disturbed, floor, .. } = change;
        let (law, fit) = (self.law, &mut self.fit);
        if dv.is_nan() {
            fit.unknown += 1;
            return None;
        }
        self.known += 1;
        fit.disturbed += disturbed;
        fit.events += counts.map(u64::from).iter().sum::<u64>();
        let side = usize::from(dv <= 0.0);
        let threshold = law.thresholds[side];
        let steps = (dv.abs() / threshold).floor();
        fit.expected += if law.from_zero { steps * threshold.copysign(dv) } else { dv };
        fit.expected += floor.mean(law.thresholds);
        // Below a threshold, a residual alone may explain the drift.
        if dv.abs() > threshold {
            self.add_slope(side, change, counts);
            let fit = &mut self.fit;
            fit.possible += u64::from((dv - s).abs() <= self.most_residual + error);
            let by_floor = floor.spoils_residual(self.most_residual + error, side, law.thresholds);
            fit.maybe_impossible.add((by_floor + law.beyond_spread_error(counts)).min(1.0));
        }
        let shows_sign = dv.abs() > 2.0 * threshold + unequal && law.shows_sign(dv, counts);
        let fit = &mut self.fit;
        let most = self.most_residual + error + STRAY * law.least_threshold();
        fit.stray += u64::from((dv - s).abs() > most);
        // With two thresholds of drift, a residual hardly turns the sign of `s`; nor does the spread
        // of the thresholds, beyond its own bound.
        if shows_sign {
            fit.doubled[0] += 1;
            fit.doubled[1] += u64::from(s * dv > 0.0);
            // A standard deviation of what else is uncertain.
            let size = dv.abs() - unequal / 3.0 - blur;
            fit.turned_by_floor.add(floor.turns_sign(size, side, law.thresholds));
        }
        self.add_near(side, change, counts);
        let must_fire = shows_sign && dv.abs() > self.most_residual + error;
        Some(FittedPixel { left: dv - s, must_fire })
    }

    /// The drift of a pixel minus that of its events, so that its mean over the pixels does not depend
    /// on how far these have moved. By the stated thresholds it would: the mean of `1 / t` is not that
    /// of `1 / mean t`.
    fn mean_left(&self, PixelChange { dv, floor, .. }: PixelChange, counts: [u32; 2]) -> f64 {
        dv - (self.unequal.sum(counts) - floor.mean(self.unequal.even))
    }

    fn add_slope(
        &mut self,
        side: usize,
        PixelChange { dv, rounding, floor, .. }: PixelChange,
        counts: [u32; 2],
    ) {
        let even = self.unequal.even;
        let s = self.unequal.sum(counts) - floor.mean(even);
        let [second, fourth] = floor.cumulants(even);
        let second = second + self.unequal.variance(counts);
        self.fit.slopes[side].add(s, dv, rounding, [second, fourth]);
    }

    fn add_near(&mut self, side: usize, PixelChange { dv, s, blur, .. }: PixelChange, counts: [u32; 2]) {
        let law = &self.law;
        let unequal = law.spread > 0.0;
        let most = if unequal { MAX_UNEQUAL_BLUR * law.spread } else { MAX_BLUR * law.least_threshold() };
        let threshold = law.thresholds[side];
        // The size of `s`, negative if the events have the wrong sign.
        let [way, said, blur_share] = [dv.abs(), s.copysign(s * dv), blur].map(|value| value / threshold);
        // Every event has the deviation of its own threshold.
        let [along, against] = [counts[side], counts[1 - side]].map(f64::from);
        let spread = law.spread / threshold * length([along + 1.0, against]) / (said + 1.0).max(1e-9);
        let usable = blur < most && spread * threshold <= MAX_PIXEL_SPREAD * law.spread;
        // A pixel without half a threshold of drift is too far from its next event to show an edge.
        if law.from_zero && usable && way > 0.5 {
            self.near[side].push(NearPixel { way, said, blur: blur_share, spread });
        }
    }

    fn fit(self) -> AnchorFit {
        let [a, b] = self.law.thresholds;
        let spread = self.law.spread;
        let edge = |side: usize| {
            let [own, other] = if side == 0 { [a, b] } else { [b, a] };
            match spread > 0.0 {
                true => find_unequal_edge(&self.near[side], other / own),
                false => find_edge(&self.near[side]),
            }
        };
        let disturbed = self.fit.disturbed / self.known.max(1) as f64;
        AnchorFit { edges: [edge(0), edge(1)], disturbed, compared: self.known, ..self.fit }
    }
}

/// The remaining drift in thresholds of its own polarity. If thresholds differ, it may be larger by
/// `unequal`, and is shown as a share of both.
#[expect(clippy::cast_possible_truncation, reason = "seven digits are plenty for a picture")]
fn in_thresholds(left: f64, [on, off]: [f64; 2], unequal: f64) -> f32 {
    (left / (unequal + if left > 0.0 { on } else { off })) as f32
}
