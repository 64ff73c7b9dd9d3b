//! The voltage at which events of one polarity happen, measured from the pixels that are about to
//! fire: no residual lies beyond the threshold, and many lie close to it.
//!
//! A residual below the threshold means `dv < s + threshold` at the true thresholds. So
//! `dv / (s + threshold)` at the stated thresholds is below the ratio of true to stated, and close
//! to it if the pixel is about to fire.
//!
//! With equal pixels, this edge is sharp to 2 %. With unequal pixels it has the width of their
//! spread. The ratios of the observed drifts are then computed for thresholds of the stated law, and
//! a quantile near the edge is compared with theirs.

use super::DEVIATIONS;
use super::unequal::LEAST_THRESHOLD;
use gs2e_num::seed::normal::normal_quantile;

/// Minimum number of pixels near the threshold. An edge of fewer is not measured.
const MIN_NEAR: usize = 1000;
/// The edge is the value that this share of its pixels does not exceed. The rest may be noise.
const EDGE: f64 = 0.995;
/// Share for unequal pixels. A thousand of them have 20 beyond it, enough for a quantile.
const UNEQUAL_EDGE: f64 = 0.98;
/// Number of values that a law of unequal pixels is computed from.
const MODELLED: usize = 40_000;
/// Change of the thresholds for which the answer of an unequal edge is computed.
const TRIED: f64 = 0.1;
/// Ratio of a pixel whose events all have the wrong sign, in place of infinity.
const MAX_RATIO: f64 = 1000.0;

/// A measured threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventEdge {
    /// Number of pixels used.
    pub pixels: usize,
    /// The measured threshold, relative to the stated one. With unequal pixels, their mean.
    pub measured: f64,
    /// Smallest and largest value of `measured` that scatter and reversals of the drift can cause if
    /// the stated thresholds hold; 1 and 1 for equal pixels.
    pub within: [f64; 2],
    /// The value of `measured` for pixels that drift straight from the first frame to this one: near 1
    /// if enough pixels are about to fire. If it is lower, the stream cannot show the threshold.
    /// With unequal pixels, the relative change of the edge for a change of the thresholds.
    pub reachable: f64,
}

/// A pixel whose drift may show a threshold.
#[derive(Debug, Clone, Copy)]
pub(super) struct NearPixel {
    /// Size of the drift, in stated thresholds.
    pub(super) way: f64,
    /// The drift that the events say, in stated thresholds; negative if they have the wrong sign.
    pub(super) said: f64,
    /// Standard deviation of the drift by noise, in thresholds.
    pub(super) blur: f64,
    /// Relative standard deviation of the edge by the pixel's own thresholds.
    pub(super) spread: f64,
}

impl NearPixel {
    fn measured(self) -> f32 {
        ratio(self.way, self.said + 1.0)
    }

    fn reachable(self) -> f32 {
        self.straight(1.0)
    }

    /// The ratio of a pixel with this drift that goes straight, and whose threshold is `threshold`.
    fn straight(self, threshold: f64) -> f32 {
        ratio(self.way, (self.way / threshold).floor() + 1.0)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "seven digits are plenty for a limit of percents")]
fn ratio(way: f64, next: f64) -> f32 {
    if next > 0.0 { (way / next).min(MAX_RATIO) as f32 } else { MAX_RATIO as f32 }
}

/// The edge of equal pixels; `None` if there are too few.
pub(super) fn find_edge(near: &[NearPixel]) -> Option<EventEdge> {
    (near.len() >= MIN_NEAR).then(|| EventEdge {
        pixels: near.len(),
        measured: quantile(&mut near.iter().map(|pixel| pixel.measured()).collect::<Vec<_>>(), EDGE),
        within: [1.0; 2],
        reachable: quantile(&mut near.iter().map(|pixel| pixel.reachable()).collect::<Vec<_>>(), EDGE),
    })
}

/// The edge of unequal pixels. `other` is the threshold of the other polarity, in thresholds of this
/// one.
pub(super) fn find_unequal_edge(near: &[NearPixel], other: f64) -> Option<EventEdge> {
    if near.len() < MIN_NEAR {
        return None;
    }
    // The share of the pixels below a quantile of the law scatters like a binomial count.
    let share = DEVIATIONS * (UNEQUAL_EDGE * (1.0 - UNEQUAL_EDGE) / near.len() as f64).sqrt();
    // Where the drift turns, residuals lie anywhere between both thresholds, and fewer pixels are
    // about to fire.
    let turned = 1.0 - (1.0 - UNEQUAL_EDGE) * (1.0 + other);
    let mut stated = modelled(near, 1.0);
    let [low, middle, high] =
        [turned - share, UNEQUAL_EDGE, UNEQUAL_EDGE + share].map(|at| quantile(&mut stated, at));
    let [lower, upper] =
        [1.0 - TRIED, 1.0 + TRIED].map(|scale| quantile(&mut modelled(near, scale), UNEQUAL_EDGE));
    let measured = quantile(&mut near.iter().map(|pixel| pixel.measured()).collect::<Vec<_>>(), UNEQUAL_EDGE);
    Some(EventEdge {
        pixels: near.len(),
        measured: measured / middle,
        within: [low / middle, high / middle],
        reachable: (middle - lower).min(upper - middle) / (TRIED * middle),
    })
}

/// Ratios of pixels with these drifts and thresholds of the stated law times `scale`. The quantiles
/// of the law are spread evenly over the pixels, so that the result is the same in every run.
fn modelled(near: &[NearPixel], scale: f64) -> Vec<f32> {
    let (each, step) = ((MODELLED / near.len()).max(1), near.len().div_ceil(MODELLED));
    let drawn = near.iter().step_by(step).flat_map(|pixel| std::iter::repeat_n(*pixel, each));
    let value = |(i, pixel): (usize, NearPixel)| {
        // Multiples of an irrational number fill the unit interval evenly. At its ends, the quantile is
        // infinite.
        let place = ((i as f64 + 0.5) * std::f64::consts::SQRT_2).fract().clamp(1e-9, 1.0 - 1e-9);
        // Noise of the voltage moves the point of the next event like a part of the threshold.
        let own = pixel.blur / (pixel.way.floor() + 1.0);
        let threshold =
            scale * (1.0 + libm::hypot(pixel.spread, own) * normal_quantile(place)).max(LEAST_THRESHOLD);
        pixel.straight(threshold)
    };
    drawn.enumerate().map(value).collect()
}

/// The value that this share of the values does not exceed.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index below the length")]
fn quantile(values: &mut [f32], share: f64) -> f64 {
    let rank = ((share * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1;
    f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1)
}
