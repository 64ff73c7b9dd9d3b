//! Pixels that see no change, and their events.

use crate::drift::DriftLaw;
use crate::motion::warp::FlowAt;
use crate::tally::TallyReference;
use gs2e_image::Size;
use gs2e_sensor::frames::anchors::AnchorFrames;

/// Largest drift of a still pixel at all known instants, in thresholds.
const STILL: f64 = 0.1;
/// Smallest and largest radius, px, in which a pixel's neighbours must be still too, so that
/// nothing passes unnoticed between two instants.
const NEIGHBOURHOOD_PX: [f64; 2] = [2.0, 24.0];
/// Image motion over the whole clip, px, below which a pixel with a depth counts as still.
const STANDS: f64 = 0.25;
/// Numbers of bins of the summed rate; each is a time scale.
const BINS: [usize; 3] = [64, 256, 1024];
/// Minimum number of images that show which pixels are still where no flow is known.
const WITHOUT_FLOW: usize = 8;
/// Largest error of the brightness of a still pixel by rounded frames, in thresholds.
const ROUNDED: f64 = 0.25;

/// The statistics of still pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StillPixelCounts {
    /// Number of still pixels.
    pub pixels: u64,
    /// Number of their events.
    pub events: u64,
    /// Expected number of events from noise at their brightness.
    pub expected: f64,
    /// Number of mean intervals between events in the clip.
    pub intervals: f64,
    /// True if all voltages were 0 at the first frame.
    pub from_zero: bool,
    /// Largest autocorrelation of their summed rate, in standard deviations.
    pub rhythm: f64,
}

/// Counts the events of still pixels in a stream.
#[derive(Debug)]
pub(crate) struct StillPixelWatch {
    still: Vec<bool>,
    end_us: i64,
    found: StillPixelCounts,
    bins: [Vec<u32>; BINS.len()],
}

impl StillPixelWatch {
    /// Finds the still pixels; `None` if neither frames nor flow determine them.
    pub(crate) fn new(
        size: Size,
        end_us: i64,
        law: &DriftLaw,
        anchors: &AnchorFrames,
        against: &TallyReference<'_>,
    ) -> Option<Self> {
        let TallyReference { flows, hot_hz, .. } = *against;
        let enough = anchors.images.len() >= if flows.is_empty() { WITHOUT_FLOW } else { 2 };
        if !enough || end_us <= 0 {
            return None;
        }
        let mut still = find_still(size, end_us, law, anchors, flows);
        still.iter_mut().zip(hot_hz).for_each(|(still, hz)| *still &= *hz <= 0.0);
        let (mut expected, mut pixels) = (0.0, 0u64);
        for i in still.iter().enumerate().filter_map(|(i, still)| still.then_some(i)) {
            let sum: f64 = anchors.images.iter().map(|image| f64::from(image.pixels()[i].max(0.0))).sum();
            // A pixel is still to a tenth of a threshold, so its mean luminance determines its
            // noise.
            expected += law.noise_events(sum / anchors.images.len() as f64) * end_us as f64;
            pixels += 1;
        }
        let intervals = expected / pixels.max(1) as f64;
        let from_zero = law.from_zero;
        let found = StillPixelCounts { pixels, events: 0, expected, intervals, from_zero, rhythm: 0.0 };
        Some(Self { still, end_us, found, bins: BINS.map(|n| vec![0; n]) })
    }

    /// Returns true if the pixel is still.
    pub(crate) fn is_still(&self, pixel: usize) -> bool {
        self.still[pixel]
    }

    /// Sees an event. Returns true if its pixel is still.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the bins")]
    pub(crate) fn see(&mut self, pixel: usize, t_us: i64) -> bool {
        if !self.still[pixel] {
            return false;
        }
        self.found.events += 1;
        // Events outside of the clip count to its outer bins.
        let share = (t_us as f64 / self.end_us as f64).clamp(0.0, 1.0);
        for bins in &mut self.bins {
            let at = ((share * bins.len() as f64) as usize).min(bins.len() - 1);
            bins[at] += 1;
        }
        true
    }

    pub(crate) fn finish(self) -> StillPixelCounts {
        let rhythm = self.bins.iter().map(|bins| peak_autocorrelation(bins)).fold(0.0, f64::max);
        StillPixelCounts { rhythm, ..self.found }
    }
}

/// The pixels with constant brightness, in their neighbourhood too, at all instants, and with
/// nothing moving behind them.
fn find_still(
    size: Size,
    end_us: i64,
    law: &DriftLaw,
    anchors: &AnchorFrames,
    flows: &[FlowAt],
) -> Vec<bool> {
    let most = STILL * law.least_threshold();
    let seconds = end_us as f64 * 1e-6;
    let standing = STANDS / seconds;
    let mut fastest = 0.0f64;
    let mut still = vec![true; size.pixels()];
    for flow in flows {
        for (still, [u, v]) in still.iter_mut().zip(flow.px_s.pixels()) {
            let speed = f64::from(u * u + v * v).sqrt();
            // NaN, which means no depth, counts as still.
            if speed > standing {
                *still = false;
                fastest = fastest.max(speed);
            }
        }
    }
    // Every image is compared with the first, so that slow changes add up.
    let first = anchors.images[0].pixels();
    let rounded = ROUNDED * law.least_threshold();
    for (still, luminance) in still.iter_mut().zip(first) {
        *still &= law.rounding_error(*luminance) <= rounded;
    }
    for image in &anchors.images[1..] {
        for (i, now) in image.pixels().iter().enumerate() {
            // Only the light must be constant; the leak is part of the noise floor.
            let way = law.drift(law.brightness(*now) - law.brightness(first[i]), 0.0, 0.0);
            // An unknown luminance is NaN, which `brightness` takes for black.
            still[i] &= way.abs() <= most && !now.is_nan() && !first[i].is_nan();
        }
    }
    // Motion of the fastest pixel between two known instants; without flow, the largest radius.
    let between = if flows.is_empty() { NEIGHBOURHOOD_PX[1] } else { fastest * seconds / flows.len() as f64 };
    erode_mask(&mut still, size, between.clamp(NEIGHBOURHOOD_PX[0], NEIGHBOURHOOD_PX[1]));
    still
}

/// Removes pixels within this distance, px, of pixels that are not still, in the larger of both
/// axes.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 24")]
fn erode_mask(still: &mut [bool], size: Size, reach: f64) {
    let (width, height, reach) = (size.width as usize, size.height as usize, reach.ceil() as usize);
    let mut line = |at: &dyn Fn(usize) -> usize, length: usize| {
        let before: Vec<bool> = (0..length).map(|k| still[at(k)]).collect();
        // Number of moving pixels among the first k.
        let mut moving = vec![0usize; length + 1];
        for k in 0..length {
            moving[k + 1] = moving[k] + usize::from(!before[k]);
        }
        for k in 0..length {
            let [from, to] = [k.saturating_sub(reach), (k + reach + 1).min(length)];
            still[at(k)] = moving[to] == moving[from];
        }
    };
    // A square neighbourhood is separable: rows first, then columns.
    (0..height).for_each(|y| line(&|x| y * width + x, width));
    (0..width).for_each(|x| line(&|y| y * width + x, height));
}

/// The largest autocorrelation of counts at lags from two bins to half of all bins, in standard
/// deviations of uncorrelated counts. Slow changes are removed by differences, whose own
/// correlation of -1/2 concerns neighbours only.
fn peak_autocorrelation(bins: &[u32]) -> f64 {
    let steps: Vec<f64> = bins.windows(2).map(|w| f64::from(w[1]) - f64::from(w[0])).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let steps: Vec<f64> = steps.into_iter().map(|step| step - mean).collect();
    let energy: f64 = steps.iter().map(|step| step * step).sum();
    if energy <= 0.0 {
        return 0.0;
    }
    let at = |lag: usize| {
        let sum: f64 = steps.iter().zip(&steps[lag..]).map(|(a, b)| a * b).sum();
        // Bartlett's formula: the variance at large lags is (1 + 2 rho_1^2) / n, with rho_1 = -1/2.
        sum / energy / (1.5 / steps.len() as f64).sqrt()
    };
    (2..steps.len() / 2).map(at).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planted::SplitMixDraws;

    #[test]
    fn what_repeats_itself_is_told_from_chance_and_from_a_slow_start() {
        let mut draws = SplitMixDraws(5);
        let mut chance = |at: &dyn Fn(usize, usize) -> usize| {
            let mut bins = vec![0u32; 256];
            for _ in 0..20_000 {
                bins[at(draws.below(256), draws.below(10))] += 1;
            }
            peak_autocorrelation(&bins)
        };
        assert!(chance(&|bin, _| bin) < 5.0);
        // A rising rate: seven of ten events in the later half.
        assert!(chance(&|bin, pick| if pick < 4 { 128 + bin / 2 } else { bin }) < 5.0);
        // A tenth of the events is in step, every 32 bins.
        assert!(chance(&|bin, pick| if pick == 0 { 32 * (bin % 8) } else { bin }) > 8.0);
    }

    #[test]
    fn still_pixels_keep_away_from_what_moves() {
        let size = Size { width: 9, height: 7 };
        let mut still = vec![true; 63];
        still[3 * 9 + 4] = false;
        erode_mask(&mut still, size, 2.0);
        let gone = |i: usize| (i % 9).abs_diff(4) <= 2 && (i / 9).abs_diff(3) <= 2;
        assert!((0..63).all(|i| still[i] != gone(i)));
    }
}
