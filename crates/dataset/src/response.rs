//! Thresholds of an unknown sensor, from frames of the same pixels.
//!
//! A pixel whose brightness changes steadily has, on average, half a threshold of change since its last
//! event, whatever the speed, and `rate lag` more if its events are late by `lag`. If it
//! changes steadily at two instants, its change between them in the logarithm is therefore
//!
//! ```text
//! d = C_on (N_on + u) - C_off (N_off + w) + lag (rate_b - rate_a) + r
//! ```
//!
//! where `u` is half the number of rising ends, the later counted as 1 and the earlier as -1, `w`
//! the same for falling ends, and `r` has the mean 0. The events depend on `r`, so least squares would
//! be biased. Three sums over samples that depend on the frames alone give three equations: over all
//! with `d > 0`, over all with `d < 0`, and weighted with `rate_b - rate_a`.
//!
//! Pixels that turned since their last event need up to both thresholds until the next; they are not
//! steady, and are left out. An end is steady if brightness changes by a threshold before and after
//! it, in one direction. Since this needs the thresholds, the estimate is repeated.
//!
//! A sensor may respond to linear light, or to the encoded grey that a simulator read. Both are tried:
//! under the right one the thresholds of dark and of bright pixels agree. Standard errors are those of
//! the jackknife over quadrants of pairs of instants.

use super::samples::{DatasetFrames, LADDER, SampleDecode};
use super::{EventDataset, OpenEvents, for_each_event, jackknife_error};
use glam::{DMat3, DVec3};
use gs2e_check::{Finding, Judgement, Verdict};
use gs2e_event::{EventFileError, Polarity};

/// Thresholds at the first round.
const FIRST: [f64; 2] = [0.2; 2];
/// Number of rounds.
const ROUNDS: usize = 4;
/// Largest ratio of the changes before and after an end.
const MAX_UNEVEN: f64 = 3.0;
/// Number of groups of samples by brightness.
const GROUPS: usize = 3;
/// Minimum number of samples in each direction.
const MIN_SAMPLES: usize = 100;

/// The response of the sensor under one decoding.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorResponse {
    /// The decoding.
    pub decode: SampleDecode,
    /// Threshold of ON events in the logarithm, and its standard error.
    pub on: [f64; 2],
    /// Threshold of OFF events, and its standard error.
    pub off: [f64; 2],
    /// Relative spread of the thresholds over groups of samples by brightness.
    pub uneven: f64,
    /// Number of samples.
    pub samples: usize,
}

impl SensorResponse {
    /// Measures under both decodings, and returns the better one first; nothing if too few pixels
    /// change steadily.
    ///
    /// # Errors
    /// The events cannot be read.
    pub fn measure(
        events: OpenEvents<'_>,
        frames: &DatasetFrames,
        rough_us: f64,
    ) -> Result<Vec<Self>, EventFileError> {
        let mut found = Vec::new();
        for decode in SampleDecode::ALL {
            found.extend(measure_decoded(events, frames, decode, rough_us)?);
        }
        found.sort_by(|a, b| a.uneven.total_cmp(&b.uneven));
        Ok(found)
    }

    /// The findings; `other` is the response under the other decoding.
    pub(super) fn findings(&self, other: Option<&Self>, dataset: &EventDataset<'_>) -> Vec<Finding> {
        let estimate = |value: f64, because| Judgement::new(Verdict::Pass, value, None, "1", because);
        let state = |statement: &str, name: &str, [value, error]: [f64; 2]| {
            let because = format!(
                "{name} events are {value:.4} +- {error:.4} apart in the logarithm of {}, from {} samples",
                self.decode.name(),
                self.samples
            );
            dataset.finding("event_frame", statement, Ok(estimate(value, because)))
        };
        let other = other.filter(|other| other.uneven.is_finite()).map_or_else(String::new, |other| {
            format!(", and by {:.1} % in {}", 100.0 * other.uneven, other.decode.name())
        });
        let uneven = format!(
            "from dark to bright pixels the thresholds vary by {:.1} % in {}{other}",
            100.0 * self.uneven,
            self.decode.name()
        );
        let decode = if self.uneven.is_finite() {
            Ok(estimate(self.uneven, uneven))
        } else {
            Err("too few samples of dark, middle or bright pixels".to_owned())
        };
        vec![
            state("threshold-on", "ON", self.on),
            state("threshold-off", "OFF", self.off),
            dataset.finding("event_frame", "decode", decode),
        ]
    }
}

fn measure_decoded(
    events: OpenEvents<'_>,
    frames: &DatasetFrames,
    decode: SampleDecode,
    rough_us: f64,
) -> Result<Option<SensorResponse>, EventFileError> {
    let (mut thresholds, mut offset) = (FIRST, rough_us);
    let mut last = None;
    for _ in 0..ROUNDS {
        let samples = steady_samples(events, frames, SteadyLaw { decode, thresholds }, offset)?;
        let Some([on, off, lag]) = solve(samples.iter()) else { return Ok(None) };
        // A wrong start must not leave the range in which pixels are selected.
        thresholds = [on, off].map(|threshold| threshold.clamp(0.01, 2.0));
        offset += lag;
        last = Some((samples, [on, off, lag]));
    }
    Ok(last.and_then(|(samples, found)| describe(&samples, found, frames, decode)))
}

/// The estimates with their errors; `None` if they are not determined.
fn describe(
    samples: &[SteadySample],
    [on, off, _]: [f64; 3],
    frames: &DatasetFrames,
    decode: SampleDecode,
) -> Option<SensorResponse> {
    let instants = frames.instants();
    let pairs = instants.len() - 1;
    let blocks = 4 * pairs;
    let without = |skip: usize, which: usize| {
        solve(samples.iter().filter(|sample| sample.block != skip)).map_or(f64::NAN, |found| found[which])
    };
    let error = |which: usize| jackknife_error(blocks, &|skip| without(skip, which));
    Some(SensorResponse {
        decode,
        on: [on, error(0)],
        off: [off, error(1)],
        uneven: spread_over_brightness(samples)?,
        samples: samples.len(),
    })
}

/// A pixel between two instants at which it changes steadily.
#[derive(Debug, Clone, Copy)]
struct SteadySample {
    /// Quadrant of a pair of instants.
    block: usize,
    /// Change of the logarithm.
    change: f64,
    /// ON and OFF events, with the halves of both ends.
    steps: [f64; 2],
    /// Rate at the later end minus that at the earlier, per us.
    rate: f64,
    /// Mean grey of both ends.
    grey: f32,
}

/// The three sums of samples: thresholds of ON and OFF events, and the lag, us. `None` if they are
/// not determined.
fn solve<'a>(samples: impl Iterator<Item = &'a SteadySample>) -> Option<[f64; 3]> {
    let (mut rows, mut sums, mut counts) = ([DVec3::ZERO; 3], [0.0; 3], [0; 2]);
    for sample in samples {
        let of = DVec3::new(sample.steps[0], -sample.steps[1], sample.rate);
        let direction = usize::from(sample.change < 0.0);
        counts[direction] += 1;
        rows[direction] += of;
        sums[direction] += sample.change;
        // In units of the mean, so that the matrix is well scaled.
        rows[2] += of * (sample.rate * 1e4);
        sums[2] += sample.change * (sample.rate * 1e4);
    }
    if counts.iter().any(|count| *count < MIN_SAMPLES) {
        return None;
    }
    let matrix = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let found = matrix.try_inverse().map(|inverse| inverse * DVec3::from_array(sums))?;
    (found.is_finite() && found.x > 0.0 && found.y > 0.0).then(|| found.to_array())
}

/// Relative standard deviation, over groups of equally many samples by brightness, of the mean of
/// both thresholds; infinite if a group does not determine them.
fn spread_over_brightness(samples: &[SteadySample]) -> Option<f64> {
    let mut sorted = samples.to_vec();
    sorted.sort_by(|a, b| a.grey.total_cmp(&b.grey));
    let size = sorted.len().div_ceil(GROUPS).max(1);
    let mean_of = |group: &[SteadySample]| solve(group.iter()).map(|[on, off, _]| libm::sqrt(on * off));
    let Some(means) = sorted.chunks(size).map(mean_of).collect::<Option<Vec<f64>>>() else {
        return Some(f64::INFINITY);
    };
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    let squares: f64 = means.iter().map(|value| (value - mean) * (value - mean)).sum();
    Some((squares / means.len() as f64).sqrt() / mean)
}

/// The decoding of frames, and the thresholds that a steady change exceeds.
#[derive(Clone, Copy)]
struct SteadyLaw {
    decode: SampleDecode,
    thresholds: [f64; 2],
}

/// A steady end: the rate, per us.
fn steady_rate(frames: &DatasetFrames, instant: usize, place: usize, law: SteadyLaw) -> Option<f64> {
    let SteadyLaw { decode, thresholds } = law;
    LADDER.iter().find_map(|step| {
        let (before, after) = (instant.checked_sub(*step)?, instant + step);
        let first = frames.change([before, instant], place, decode)?;
        let second = frames.change([instant, after], place, decode)?;
        let threshold = if first > 0.0 { thresholds[0] } else { thresholds[1] };
        let [small, large] = [first.abs().min(second.abs()), first.abs().max(second.abs())];
        let is_steady = first * second > 0.0 && small > threshold && large < MAX_UNEVEN * small;
        let span = frames.stamps_us[after] - frames.stamps_us[before];
        is_steady.then(|| (first + second) / span as f64)
    })
}

/// The samples between each two neighbouring instants.
fn steady_samples(
    events: OpenEvents<'_>,
    frames: &DatasetFrames,
    law: SteadyLaw,
    offset_us: f64,
) -> Result<Vec<SteadySample>, EventFileError> {
    let instants = frames.instants();
    let pairs: Vec<[usize; 2]> = instants.windows(2).map(|pair| [pair[0], pair[1]]).collect();
    let counts = count_between(events, frames, &pairs, offset_us)?;
    let rates: Vec<Vec<Option<f64>>> = instants
        .iter()
        .map(|instant| {
            (0..frames.pixels.len()).map(|place| steady_rate(frames, *instant, place, law)).collect()
        })
        .collect();
    let mut samples = Vec::new();
    for (number, (pair, counts)) in pairs.iter().zip(&counts).enumerate() {
        for (place, [on, off]) in counts.iter().enumerate() {
            let ends = rates[number][place].zip(rates[number + 1][place]);
            let Some(([a, b], change)) =
                ends.map(|(a, b)| [a, b]).zip(frames.change(*pair, place, law.decode))
            else {
                continue;
            };
            // Half a threshold of the direction of each end, the later minus the earlier.
            let half = |rate: f64, rising: bool| if (rate > 0.0) == rising { 0.5 } else { 0.0 };
            let steps = [
                f64::from(*on) + half(b, true) - half(a, true),
                f64::from(*off) + half(b, false) - half(a, false),
            ];
            let grey = 0.5 * (frames.grey(pair[0], place) + frames.grey(pair[1], place));
            let block = 4 * number + frames.quadrant(place);
            samples.push(SteadySample { block, change, steps, rate: b - a, grey });
        }
    }
    Ok(samples)
}

/// ON and OFF events of each pixel between two frames, for each pair of frames.
fn count_between(
    events: OpenEvents<'_>,
    frames: &DatasetFrames,
    pairs: &[[usize; 2]],
    offset_us: f64,
) -> Result<Vec<Vec<[u32; 2]>>, EventFileError> {
    let places = frames.places();
    let mut counts = vec![vec![[0; 2]; frames.pixels.len()]; pairs.len()];
    let ends: Vec<[f64; 2]> =
        pairs.iter().map(|pair| pair.map(|frame| frames.stamps_us[frame] as f64 + offset_us)).collect();
    for_each_event(events, |event, t_us| {
        let Some(place) = places.of(event) else { return };
        for (counts, [from, to]) in counts.iter_mut().zip(&ends) {
            // An event in the microsecond of a frame belongs to the span that ends there.
            if (t_us as f64) > *from && (t_us as f64) <= *to {
                counts[place][usize::from(event.polarity == Polarity::Off)] += 1;
            }
        }
    })?;
    Ok(counts)
}
