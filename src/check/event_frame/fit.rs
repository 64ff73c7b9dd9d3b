//! Events against frames at one instant: the counts of each pixel, and the change of its brightness
//! since the first frame.

mod balance;
mod lag;

pub(in crate::check) use balance::DriftBalance;
pub use balance::FrameComparison;
pub use lag::LagSums;

use crate::check::drift::DriftLaw;
use balance::PixelChange;

/// Minimum number of pixels near the threshold. An edge of fewer is not measured.
const MIN_NEAR: usize = 1000;
/// The edge is the value that this share of its pixels does not exceed. The rest may be noise.
const EDGE: f64 = 0.995;
/// Shown threshold of a pixel whose events all have the wrong sign, in place of infinity.
const MAX_SHOWN: f64 = 1000.0;
/// Largest uncertainty of a pixel's drift, in thresholds, for its use in an edge. With an edge that
/// is sharp to 2 %, an error of the threshold of a tenth is still visible.
const MAX_BLUR: f64 = 0.04;

/// The state of all pixels at one anchor, as statistics.
///
/// For each pixel, `dv` is the drift since the first frame, and `s = A on - B off` the drift
/// according to its events. The residual voltage is `dv - s` minus the pixel's initial voltage:
/// between `-B` and `A`.
#[derive(Debug, Clone, PartialEq)]
pub struct AnchorFit {
    /// Stamp of the anchor.
    pub t_us: i64,
    /// Number of events so far.
    pub events: u64,
    /// Sums over pixels with a drift of more than a threshold, separately for up and down.
    pub slopes: [SlopeSums; 2],
    /// Number of these pixels with a possible residual.
    pub possible: u64,
    /// Number of pixels with a drift of more than two thresholds, and of those among them whose
    /// events have the same sign.
    pub doubled: [u64; 2],
    /// Number of the former without any event, where noise cannot be the reason.
    pub silent: u64,
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

/// Sums of `dv` and `s` over pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlopeSums {
    /// Number of pixels.
    pub pixels: u64,
    /// Sum of `s dv`.
    pub products: f64,
    /// Sum of `s^2`.
    pub squares: f64,
    /// Sum of `|s|`.
    pub sizes: f64,
    /// Sum of `|s|` times the further error of the pixel, by rounded frames and by thresholds that
    /// differ between pixels.
    pub errors: f64,
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
        }
    }
}

impl SlopeSums {
    /// The factor that brings `s` nearest to `dv`: `<s, dv> / <s, s>`.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.products / self.squares
    }

    /// Largest distance of a sound stream's factor from 1 that residuals alone can cause. With
    /// `|dv - s| <= most`, `|factor - 1| <= most <|s|> / <s, s>`.
    #[must_use]
    pub fn allowance(&self, most: f64) -> f64 {
        (most * self.sizes + self.errors) / self.squares
    }

    fn add(&mut self, s: f64, dv: f64, error: f64) {
        self.errors += s.abs() * error;
        self.pixels += 1;
        self.products += s * dv;
        self.squares += s * s;
        self.sizes += s.abs();
    }
}

/// The voltage at which events of one polarity happen, measured from the pixels that are about to
/// fire: no residual lies beyond the threshold, and many lie close to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EventEdge {
    /// Number of pixels used.
    pub pixels: usize,
    /// The measured threshold, relative to the stated one.
    pub shown: f64,
    /// The value for pixels that drift straight from the first frame to this one: near 1 if enough
    /// pixels are about to fire. If it is lower, the stream cannot show the threshold.
    pub reachable: f64,
}

/// Sums over pixels for a [`AnchorFit`].
struct FitSums {
    thresholds: [f64; 2],
    /// Largest possible difference of drift and events.
    most_residual: f64,
    /// True if residuals are 0 at the first frame.
    from_zero: bool,
    events: u64,
    slopes: [SlopeSums; 2],
    possible: u64,
    doubled: [u64; 2],
    silent: u64,
    lag: LagSums,
    near: [Vec<[f32; 2]>; 2],
    expected: f64,
    unknown: u64,
    known: u64,
    disturbed: f64,
    spread: f64,
}

impl FitSums {
    fn new(law: &DriftLaw, slack: f64) -> Self {
        Self {
            thresholds: law.thresholds,
            // 2 % for events in the microsecond of the anchor, and for the law's finer steps.
            most_residual: 1.02 * law.most_residual() + slack,
            from_zero: law.from_zero,
            events: 0,
            slopes: [SlopeSums::default(); 2],
            possible: 0,
            doubled: [0; 2],
            silent: 0,
            lag: LagSums::default(),
            near: [Vec::new(), Vec::new()],
            expected: 0.0,
            unknown: 0,
            known: 0,
            disturbed: 0.0,
            spread: law.spread,
        }
    }

    /// Adds a pixel, and returns its drift minus that of its events, if its drift is known.
    fn add(&mut self, change: PixelChange, [on, off]: [u32; 2]) -> Option<f64> {
        let PixelChange { dv, s, blur, error, disturbed } = change;
        let [a, b] = self.thresholds;
        if dv.is_nan() {
            self.unknown += 1;
            return None;
        }
        self.known += 1;
        self.disturbed += disturbed;
        self.events += u64::from(on) + u64::from(off);
        let (side, threshold) = if dv > 0.0 { (0, a) } else { (1, b) };
        let steps = (dv.abs() / threshold).floor();
        self.expected += if self.from_zero { steps * threshold.copysign(dv) } else { dv };
        // Below a threshold, a residual alone may explain the drift.
        if dv.abs() > threshold {
            self.slopes[side].add(s, dv, error);
            self.possible += u64::from((dv - s).abs() <= self.most_residual + error);
        }
        // With two thresholds of drift, a residual hardly turns the sign of `s`.
        if dv.abs() > 2.0 * threshold {
            self.doubled[0] += 1;
            self.doubled[1] += u64::from(s * dv > 0.0);
            self.silent += u64::from(on + off == 0 && dv.abs() > self.most_residual + error);
        }
        // A pixel without half a threshold of drift is too far from its next event to show an edge.
        let sharp = self.from_zero && self.spread == 0.0 && blur < MAX_BLUR * a.min(b);
        if sharp && dv.abs() > threshold / 2.0 {
            // The size of `s`, negative if the events have the wrong sign.
            self.near[side].push(edge_ratios(dv.abs(), s.copysign(s * dv), threshold, steps));
        }
        Some(dv - s)
    }

    fn fit(self, t_us: i64) -> AnchorFit {
        let Self { events, slopes, possible, doubled, silent, lag, near, expected, unknown, .. } = self;
        AnchorFit {
            t_us,
            events,
            slopes,
            possible,
            doubled,
            silent,
            lag,
            edges: near.map(find_edge),
            expected,
            unknown,
            disturbed: self.disturbed / self.known.max(1) as f64,
        }
    }
}

/// The remaining drift in thresholds of its own polarity.
#[expect(clippy::cast_possible_truncation, reason = "seven digits are plenty for a picture")]
fn in_thresholds(left: f64, [on, off]: [f64; 2]) -> f32 {
    (if left > 0.0 { left / on } else { left / off }) as f32
}

/// A residual below the threshold means `dv < s + threshold` at the true thresholds. So
/// `dv / (s + threshold)` at the stated thresholds is below the ratio of true to stated, and close
/// to it if the pixel is about to fire. The second value is the same for a pixel whose events are
/// the whole `steps` of its drift.
#[expect(clippy::cast_possible_truncation, reason = "seven digits are plenty for a limit of percents")]
fn edge_ratios(dv: f64, s: f64, threshold: f64, steps: f64) -> [f32; 2] {
    let shown = if s + threshold > 0.0 { (dv / (s + threshold)).min(MAX_SHOWN) } else { MAX_SHOWN };
    [shown as f32, (dv / (threshold * (steps + 1.0))) as f32]
}

fn find_edge(near: Vec<[f32; 2]>) -> Option<EventEdge> {
    let pixels = near.len();
    let (shown, reachable): (Vec<f32>, Vec<f32>) = near.into_iter().map(|[s, r]| (s, r)).unzip();
    (pixels >= MIN_NEAR).then(|| EventEdge {
        pixels,
        shown: edge_quantile(shown),
        reachable: edge_quantile(reachable),
    })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index below the length")]
fn edge_quantile(mut values: Vec<f32>) -> f64 {
    let rank = (EDGE * values.len() as f64).ceil() as usize - 1;
    f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1)
}
