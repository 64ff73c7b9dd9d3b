//! The greys of a pixel over time: whether they differ by noise alone.

use crate::ladder::FrameNoise;
use std::ops::Range;

/// Largest variance of a still pixel: a constant, and a part per grey.
const STILL: FrameNoise = FrameNoise { constant: 4.5, per_grey: 0.08 };
/// Mean greys that are neither black nor white.
const USABLE: Range<f64> = 2.0..250.0;
/// Covariance of neighbouring frames that noise has at most, in standard deviations.
const DEVIATIONS: f64 = 3.0;

/// Mean, variance and the covariance of neighbours of a course.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CourseMoments {
    pub mean: f64,
    pub variance: f64,
    pub next: f64,
}

impl CourseMoments {
    /// Returns true if a course of this many greys differs by noise alone.
    pub(crate) fn is_still(&self, frames: usize) -> bool {
        let bound = STILL.constant + STILL.per_grey * self.mean;
        // Light that moves is alike in neighbouring frames; noise is not.
        let is_white = self.next <= self.variance * DEVIATIONS / (frames as f64).sqrt();
        is_usable_grey(self.mean) && self.variance < bound && is_white
    }
}

/// Returns true if a mean grey is neither black nor white, so that the frames can show a change.
#[must_use]
pub fn is_usable_grey(mean: f64) -> bool {
    USABLE.contains(&mean)
}

/// A course that is given frame after frame. It keeps sums only.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GreyCourse {
    frames: usize,
    first: f64,
    last: f64,
    /// Sums of the differences to the first grey, of their squares, and of the products of neighbours. The
    /// first grey is taken off so that a constant course has no variance by rounding.
    sum: f64,
    squares: f64,
    products: f64,
}

impl GreyCourse {
    /// Adds the grey of the next frame.
    pub fn push(&mut self, grey: f64) {
        if self.frames == 0 {
            self.first = grey;
        }
        let difference = grey - self.first;
        if self.frames > 0 {
            self.products += difference * self.last;
        }
        self.sum += difference;
        self.squares += difference * difference;
        self.last = difference;
        self.frames += 1;
    }

    /// Mean grey; 0 without frames.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.first + self.sum / self.frames.max(1) as f64
    }

    /// Returns true if the frames differ by noise alone. Only they decide: a choice by events would bias what
    /// events say.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.frames > 1 && self.moments().is_still(self.frames)
    }

    fn moments(&self) -> CourseMoments {
        let n = self.frames as f64;
        let mean = self.sum / n;
        let variance = (self.squares / n - mean * mean).max(0.0);
        // The first difference is 0, so the sum without it is the whole.
        let next = (self.products - mean * (2.0 * self.sum - self.last)) / (n - 1.0) + mean * mean;
        CourseMoments { mean: self.first + mean, variance, next }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_num::seed::{DrawSpace, Seed, SeedCell};

    fn course(grey: impl Fn(usize) -> f64) -> GreyCourse {
        let mut course = GreyCourse::default();
        (0..400).for_each(|frame| course.push(grey(frame)));
        course
    }

    #[test]
    fn noise_is_still_and_a_slow_change_is_not() {
        let mut draws = Seed(3).draws(SeedCell { x: 0, y: 0, level: 0, index: 0 }, DrawSpace::Choice);
        let noise: Vec<f64> = (0..400).map(|_| draws.normal()).collect();
        let drift = |frame: usize| 0.02 * frame as f64;
        assert!(course(|frame| 100.0 + 1.5 * noise[frame]).is_still());
        assert!(course(|_| 0.1 + 33.7).is_still());
        // A drift of 8 grey has a variance of 5.3, and one of 4 grey hides in no noise either.
        assert!(!course(|frame| 100.0 + noise[frame] + drift(frame)).is_still());
        assert!(!course(|frame| 100.0 + 0.5 * drift(frame)).is_still());
        assert!(!course(|frame| 100.0 + 6.0 * noise[frame]).is_still());
        assert!(!course(|_| 255.0).is_still() && !is_usable_grey(course(|_| 255.0).mean()));
    }

    /// The sums are those of all differences to the mean.
    #[test]
    fn moments_are_those_of_the_greys() {
        let grey = |frame: usize| 90.0 + 20.0 * (0.05 * frame as f64).sin() + (frame % 7) as f64;
        let greys: Vec<f64> = (0..400).map(grey).collect();
        let mean = greys.iter().sum::<f64>() / 400.0;
        let variance = greys.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 400.0;
        let next = greys.windows(2).map(|p| (p[0] - mean) * (p[1] - mean)).sum::<f64>() / 399.0;
        let found = course(grey).moments();
        for (found, wanted) in [(found.mean, mean), (found.variance, variance), (found.next, next)] {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }
}
