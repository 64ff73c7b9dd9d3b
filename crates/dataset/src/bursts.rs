//! Runs of consecutive frames at some pixels, evenly spread over a recording.
//!
//! A short sequence is kept as a whole, in [`RUNS`] runs that share their border frames. Memory is
//! bounded for any number of frames.

use super::places::{PixelPlaces, quadrant};
use super::samples::KNOWN;
use gs2e_image::{Image, Size};
use gs2e_sensor::WHITE;
use std::ops::Range;

/// Number of runs.
pub(super) const RUNS: usize = 8;
/// Maximum number of frame intervals in a run.
const MAX_INTERVALS: usize = 64;
/// Maximum number of pixels.
const MAX_PIXELS: usize = 4096;

/// Logarithm of brightness of a pixel, and its change per microsecond.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BrightnessAt {
    pub(super) log: f64,
    pub(super) rate: f64,
}

/// The runs.
#[derive(Debug, Clone)]
pub(super) struct FrameBursts {
    size: Size,
    /// Stamps of all frames, us.
    stamps_us: Vec<f64>,
    /// Frame intervals of each run, counted from the first of the recording.
    pub(super) runs: Vec<Range<usize>>,
    /// Indices of the pixels, ascending.
    pub(super) pixels: Vec<usize>,
    /// Logarithm of the grey of each pixel, by frame; empty for frames of no run, NaN where it is not known.
    logs: Vec<Vec<f32>>,
}

impl FrameBursts {
    /// Runs without frames. `lattice` is a spread choice of pixels.
    pub(super) fn new(size: Size, stamps_us: &[i64], lattice: &[usize]) -> Self {
        let intervals = stamps_us.len().saturating_sub(1);
        let start = |run: usize| run * intervals / RUNS;
        let run = |run: usize| start(run)..(start(run) + MAX_INTERVALS).min(start(run + 1));
        let step = lattice.len().div_ceil(MAX_PIXELS).max(1);
        Self {
            size,
            stamps_us: stamps_us.iter().map(|t| *t as f64).collect(),
            runs: (0..RUNS).map(run).filter(|run| !run.is_empty()).collect(),
            pixels: lattice.iter().step_by(step).copied().collect(),
            logs: vec![Vec::new(); stamps_us.len()],
        }
    }

    /// Number of all frames.
    pub(super) fn frames(&self) -> usize {
        self.logs.len()
    }

    /// Indices of the frames of all runs.
    pub(super) fn needed(&self) -> impl Iterator<Item = usize> {
        self.runs.iter().flat_map(|run| run.start..=run.end)
    }

    /// Keeps a frame, with grey from 0 to 255, if it belongs to a run.
    pub(super) fn keep(&mut self, index: usize, frame: &Image<f32>) {
        let log = |pixel: &usize| {
            let grey = frame.pixels()[*pixel];
            if KNOWN.contains(&grey) { libm::logf(grey) } else { f32::NAN }
        };
        if self.needed().any(|needed| needed == index) {
            self.logs[index] = self.pixels.iter().map(log).collect();
        }
    }

    /// Times of the first and the last frame of a run, us.
    pub(super) fn span_us(&self, run: usize) -> [f64; 2] {
        [self.stamps_us[self.runs[run].start], self.stamps_us[self.runs[run].end]]
    }

    /// The last run that begins before a time, or the first.
    pub(super) fn run_at(&self, t_us: f64) -> usize {
        let later = self.runs.partition_point(|run| self.stamps_us[run.start] <= t_us);
        later.saturating_sub(1)
    }

    /// Length of a frame interval, us.
    pub(super) fn length_us(&self, interval: usize) -> f64 {
        self.stamps_us[interval + 1] - self.stamps_us[interval]
    }

    /// The frame interval that holds a time.
    pub(super) fn interval_at(&self, t_us: f64) -> Option<usize> {
        let after = self.stamps_us.partition_point(|stamp| *stamp <= t_us);
        (after > 0 && after < self.stamps_us.len()).then(|| after - 1)
    }

    /// Logarithm in a frame; `None` if it is not known.
    pub(super) fn log(&self, frame: usize, place: usize) -> Option<f64> {
        let log = *self.logs.get(frame)?.get(place)?;
        (!log.is_nan()).then(|| f64::from(log))
    }

    /// Brightness between two frames, by linear interpolation of the logarithm.
    pub(super) fn brightness(&self, t_us: f64, place: usize) -> Option<BrightnessAt> {
        let interval = self.interval_at(t_us)?;
        let (from, to) = (self.log(interval, place)?, self.log(interval + 1, place)?);
        let rate = (to - from) / self.length_us(interval);
        Some(BrightnessAt { log: from + rate * (t_us - self.stamps_us[interval]), rate })
    }

    /// These frames behind a low-pass filter of first order on the logarithm, with this time constant at
    /// white. It is longer in dim light, as v2e has it: `tau / (0.1 + 0.9 light)`.
    pub(super) fn slowed(&self, tau_us: f64) -> Self {
        let mut slowed = self.clone();
        for interval in self.runs.iter().flat_map(Clone::clone) {
            let length = self.length_us(interval);
            let known = if self.logs[interval].is_empty() { 0 } else { self.logs[interval + 1].len() };
            for place in 0..known {
                let before = f64::from(slowed.logs[interval][place]);
                let now = f64::from(self.logs[interval + 1][place]);
                let light = 0.1 + 0.9 * libm::exp(now) / WHITE;
                let step = (now - before) * (1.0 - libm::exp(-length * light / tau_us));
                #[expect(clippy::cast_possible_truncation, reason = "a logarithm is stored with 32 bits")]
                let slow = (before + step) as f32;
                // The filter starts again where the logarithm was not known.
                slowed.logs[interval + 1][place] =
                    if slow.is_nan() { self.logs[interval + 1][place] } else { slow };
            }
        }
        slowed
    }

    /// Mean change of the logarithm per pixel and us in a window of the recording, and in all runs. `None` if
    /// no run lies in that window.
    pub(super) fn activity(&self, window_us: [f64; 2]) -> Option<[f64; 2]> {
        let (mut within, mut all) = (Vec::new(), Vec::new());
        for interval in self.runs.iter().flat_map(Clone::clone) {
            let change =
                |place: usize| Some((self.log(interval + 1, place)? - self.log(interval, place)?).abs());
            let changes: Vec<f64> = (0..self.pixels.len()).filter_map(change).collect();
            let rate = changes.iter().sum::<f64>() / changes.len().max(1) as f64 / self.length_us(interval);
            all.push(rate);
            if self.stamps_us[interval + 1] > window_us[0] && self.stamps_us[interval] < window_us[1] {
                within.push(rate);
            }
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        (!within.is_empty()).then(|| [mean(&within), mean(&all)])
    }

    /// The places in [`Self::pixels`].
    pub(super) fn places(&self) -> PixelPlaces {
        PixelPlaces::new(self.size, &self.pixels)
    }

    /// The quadrant of a pixel, 0 to 3.
    pub(super) fn quadrant(&self, place: usize) -> usize {
        quadrant(self.size, self.pixels[place])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 8, height: 6 };

    fn bursts(frames: i64) -> FrameBursts {
        let stamps: Vec<i64> = (0..frames).map(|i| 1000 * i).collect();
        FrameBursts::new(SIZE, &stamps, &(0..SIZE.pixels()).collect::<Vec<_>>())
    }

    #[test]
    fn short_sequences_are_kept_whole_and_long_ones_in_runs() {
        let needed = |frames| {
            let mut needed: Vec<usize> = bursts(frames).needed().collect();
            needed.dedup();
            needed
        };
        assert_eq!(needed(3), [0, 1, 2]);
        assert_eq!(needed(400), (0..400).collect::<Vec<_>>());
        // 8 runs of 64 intervals.
        assert_eq!(needed(100_001).len(), 8 * 65);
        assert_eq!(needed(1), [0; 0]);
    }

    #[test]
    fn brightness_between_frames_is_linear_in_the_logarithm() {
        let mut found = bursts(3);
        for (index, grey) in [40.0, 80.0, 10.0].into_iter().enumerate() {
            found.keep(index, &Image::filled(SIZE, grey));
        }
        let at = found.brightness(250.0, 5).unwrap();
        assert!((at.log - (40f64.ln() + 0.25 * 2f64.ln())).abs() < 1e-6, "{at:?}");
        assert!((at.rate - 1e-3 * 2f64.ln()).abs() < 1e-9, "{at:?}");
        // Grey 10 is too dark to know its logarithm.
        assert_eq!(found.brightness(1500.0, 5), None);
    }
}
