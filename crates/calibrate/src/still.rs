//! Pixels that see constant light: noise of the frames, leak, and hot pixels.

use crate::course::CourseMoments;
use crate::estimate::{Estimate, median, together};
use crate::ladder::FrameNoise;
use crate::recording::{PixelTrains, Recording};

/// Events per second above which a pixel in constant light is hot.
pub(crate) const HOT_HZ: f64 = 5.0;
/// Noise of frames where no pixel shows it: rounding, and a typical camera.
const TYPICAL: FrameNoise = FrameNoise { constant: 0.6, per_grey: 0.025 };
/// Fewest still pixels.
const FEWEST: usize = 100;
/// Fewest pairs of neighbouring events.
const FEWEST_PAIRS: f64 = 30.0;
/// Groups of pixels whose scatter is the error of the Fano factor.
const GROUPS: usize = 16;

/// The pixels whose frames differ by noise alone, and what they show.
#[derive(Debug, Clone)]
pub(crate) struct StillPixels {
    pub noise: FrameNoise,
    /// The pixels; empty if there are too few.
    pub pixels: Vec<usize>,
}

fn moments(course: &[f64]) -> CourseMoments {
    let n = course.len() as f64;
    let mean = course.iter().sum::<f64>() / n;
    let variance = course.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
    let next = course.windows(2).map(|p| (p[0] - mean) * (p[1] - mean)).sum::<f64>() / (n - 1.0);
    CourseMoments { mean, variance, next }
}

/// Finds the still pixels. Only frames decide: a choice by events would bias what events say.
pub(crate) fn still_pixels(recording: &Recording) -> StillPixels {
    let mut found = Vec::new();
    for pixel in 0..recording.size.pixels() {
        let course: Vec<f64> = recording.course(pixel).collect();
        let moments = moments(&course);
        if moments.is_still(course.len()) {
            found.push((pixel, moments.mean, moments.variance));
        }
    }
    if found.len() < FEWEST {
        return StillPixels { noise: TYPICAL, pixels: Vec::new() };
    }
    let noise = noise_of(&mut found);
    StillPixels { noise, pixels: found.into_iter().map(|(pixel, ..)| pixel).collect() }
}

/// The line through the medians of the darker and the brighter half.
fn noise_of(found: &mut [(usize, f64, f64)]) -> FrameNoise {
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let half = found.len() / 2;
    let middle = |part: &[(usize, f64, f64)]| {
        let [mut greys, mut variances]: [Vec<f64>; 2] =
            [part.iter().map(|p| p.1).collect(), part.iter().map(|p| p.2).collect()];
        [median(&mut greys), median(&mut variances)]
    };
    let [[dark, low], [bright, high]] = [middle(&found[..half]), middle(&found[half..])];
    let per_grey = if bright > 1.3 * dark { ((high - low) / (bright - dark)).max(0.0) } else { 0.0 };
    // Rounding alone has a variance of a twelfth.
    FrameNoise { constant: (low - per_grey * dark).max(1.0 / 12.0), per_grey }
}

/// What pixels in constant light say.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConstantLight {
    /// Share of hot pixels.
    pub hot: Estimate,
    /// Events per pixel and second of each sign, without hot pixels.
    pub rates_hz: [Estimate; 2],
    /// Share of neighbouring events of a calm pixel that have the other sign.
    pub alternate: Estimate,
    /// Variance of the numbers of events of calm pixels by their mean: 1 where pixels are alike and events do
    /// not know of each other.
    pub fano: Estimate,
    /// Balance of the voltage by the contrast ON, events per pixel and second.
    pub leak_hz: Estimate,
    /// Median rate of a hot pixel, and its deviation in decades.
    pub hot_rate: [f64; 2],
}

/// Rates of pixels in constant light, for contrasts whose ratio OFF by ON is `ratio`.
pub(crate) fn constant_light(
    trains: &PixelTrains,
    pixels: &[usize],
    span_us: (i64, i64),
    ratio: Estimate,
) -> Option<ConstantLight> {
    let seconds = (span_us.1 - span_us.0) as f64 * 1e-6;
    if pixels.len() < FEWEST || seconds <= 0.0 {
        return None;
    }
    let middle_us = span_us.0.midpoint(span_us.1);
    let (mut hot, mut balances, mut drift) = (Vec::new(), Vec::new(), 0.0);
    let (mut sums, mut squares) = ([0.0; 2], [0.0; 2]);
    let (mut pairs, mut opposite, mut totals) = (0.0, 0.0, Vec::new());
    for pixel in pixels {
        let (us, on) = trains.of(*pixel);
        let within = us.iter().zip(on).filter(|(us, _)| (span_us.0..=span_us.1).contains(us));
        let (mut counts, mut balance) = ([0.0; 2], [0.0; 2]);
        within.for_each(|(us, on)| {
            counts[usize::from(!on)] += 1.0;
            balance[usize::from(*us >= middle_us)] += if *on { 1.0 } else { -ratio.value };
        });
        let rate = (counts[0] + counts[1]) / seconds;
        if rate > HOT_HZ {
            hot.push(libm::log10(rate));
            continue;
        }
        for side in [0, 1] {
            sums[side] += counts[side];
            squares[side] += counts[side] * counts[side];
        }
        totals.push(counts[0] + counts[1]);
        pairs += on.len().saturating_sub(1) as f64;
        opposite += on.windows(2).filter(|pair| pair[0] != pair[1]).count() as f64;
        balances.push((balance[0] + balance[1]) / seconds);
        drift += (balance[1] - balance[0]) / seconds;
    }
    let (all, calm) = (pixels.len() as f64, balances.len().max(2) as f64);
    let share = hot.len() as f64 / all;
    // One pixel more or less is always possible.
    let share = Estimate::found(share, (share * (1.0 - share) / all).sqrt() + 1.0 / all);
    let mean = balances.iter().sum::<f64>() / calm;
    let variance = balances.iter().map(|b| (b - mean) * (b - mean)).sum::<f64>() / (calm - 1.0);
    // Until each pixel has leaked once, the rate is between the share of ON in both contrasts and the whole,
    // by what the pixels saw before. A uniform law over this interval has 0.58 of its half as its deviation.
    let open = 0.5 * mean * ratio.value * (2.0 / (1.0 + (mean * seconds).abs())).min(1.0);
    let statistical = (variance / calm).sqrt() + 1.0 / (calm * seconds);
    // By the scatter over the pixels: events of noise come in pairs.
    let rates_hz = [0, 1].map(|side| {
        let mean = sums[side] / calm;
        let variance = (squares[side] / calm - mean * mean).max(0.0);
        Estimate::found(mean / seconds, (variance / calm).sqrt() / seconds)
    });
    // Noise makes single events of pixels that were near a threshold at the start: the halves then differ.
    let unequal = drift / calm;
    let by_ratio = ratio.se.unwrap_or(ratio.value) * rates_hz[1].value;
    let leak = Estimate::found(mean + open, together(&[statistical, 0.6 * open, unequal, by_ratio]));
    let alternate = opposite / pairs;
    let alternate = Estimate::found(alternate, (alternate * (1.0 - alternate) / pairs).sqrt() + 1.0 / pairs);
    Some(ConstantLight {
        hot: share,
        rates_hz,
        alternate: alternate.only_if(pairs >= FEWEST_PAIRS, 0.0),
        fano: fano(&totals),
        leak_hz: leak,
        hot_rate: median_and_spread(&mut hot),
    })
}

/// The median of rates whose decades are given, and their deviation in decades; zeros of none.
fn median_and_spread(decades: &mut [f64]) -> [f64; 2] {
    if decades.is_empty() {
        return [0.0; 2];
    }
    let middle = median(decades);
    let square: f64 = decades.iter().map(|r| (r - middle) * (r - middle)).sum();
    let spread = (square / decades.len() as f64).sqrt();
    [libm::exp(middle * std::f64::consts::LN_10), spread]
}

/// The Fano factor of counts. Its error is a jackknife over groups, because a few pixels make most events.
fn fano(totals: &[f64]) -> Estimate {
    let of = |without: usize| {
        let [mut n, mut sum, mut squares] = [0.0; 3];
        for (_, total) in totals.iter().enumerate().filter(|(i, _)| i % GROUPS != without) {
            n += 1.0;
            sum += total;
            squares += total * total;
        }
        (squares - sum * sum / n) / sum
    };
    let events: f64 = totals.iter().sum();
    if events < FEWEST_PAIRS {
        return Estimate::unknown(0.0);
    }
    let all: Vec<f64> = (0..GROUPS).map(of).collect();
    let mean = all.iter().sum::<f64>() / GROUPS as f64;
    let square: f64 = all.iter().map(|f| (f - mean) * (f - mean)).sum();
    Estimate::found(of(GROUPS), (square * (GROUPS - 1) as f64 / GROUPS as f64).sqrt())
}
