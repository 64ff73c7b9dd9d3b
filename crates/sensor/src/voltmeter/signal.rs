//! The effect of brightness alone on a pixel between two events: the label of an event
//! (`label.rs`).
//!
//! It is needed only where an event happens, so it works on one pixel at a time and computes its
//! own logarithms.

use super::BetweenFrames;
use super::exact::PendingFrame;
use super::window::{FrameLeg, TimeStep};
use crate::label;
use gs2e_event::{EventLabel, Polarity};

/// Seconds in a nanosecond.
const SECONDS: f64 = 1e-9;

impl TimeStep<'_> {
    /// The rise of the voltage by brightness alone up to an event in a leg, `t` ns after the window's
    /// start. `log` is `ln(L + k2)` at the pixel's previous event; it is set to that of this event.
    pub(super) fn rise(&self, pixel: usize, leg: &FrameLeg, t: f64, log: &mut f64) -> f64 {
        let before = std::mem::replace(log, self.log(pixel, leg, t));
        self.law.process.k1 * (*log - before)
    }

    /// The label of an event after this rise.
    pub(super) fn label(&self, pixel: usize, rise: f64, polarity: Polarity) -> EventLabel {
        let barriers = self.law.thresholds.of(pixel);
        match polarity {
            Polarity::On => label::label_of(rise, barriers.up),
            Polarity::Off => label::label_of(-rise, barriers.down),
        }
    }

    /// `ln(L + k2)` of a pixel of the image in a leg, `t` ns after the window's start.
    fn log(&self, pixel: usize, leg: &FrameLeg, t: f64) -> f64 {
        let from = self.log_at(pixel, leg.frame);
        if leg.inverse == 0.0 {
            return from;
        }
        let step = self.log_at(pixel, leg.frame + 1) - from;
        let s = (t - leg.stamp) * leg.inverse;
        if self.law.between == BetweenFrames::Linear {
            return from + step * s;
        }
        // The cubic of `cubic.rs`, for one pixel: labels must see the brightness that makes the
        // events.
        let [a, b] = [leg.frame, leg.frame + 1].map(|frame| self.slope(pixel, frame) / leg.inverse);
        from + (((a + b - 2.0 * step) * s + (3.0 * step - 2.0 * a - b)) * s + a) * s
    }

    /// `ln(L + k2)` at a frame.
    fn log_at(&self, pixel: usize, frame: usize) -> f64 {
        libm::log(self.law.level(self.frames[frame], pixel))
    }

    /// The slope of the cubic at a frame, per ns: the rendered rate, or the slope of the parabola
    /// through three frames, or of the line through two at the ends of the sequence.
    fn slope(&self, pixel: usize, frame: usize) -> f64 {
        let here = self.frames[frame];
        if self.law.between == BetweenFrames::Hermite {
            return f64::from(here.rate[pixel]) * SECONDS / self.law.level(here, pixel);
        }
        let secant = |first: usize| {
            let length = (self.frames.get(first + 1)?.t - self.frames[first].t) as f64;
            Some(((self.log_at(pixel, first + 1) - self.log_at(pixel, first)) / length, length))
        };
        match (frame.checked_sub(1).and_then(secant), secant(frame)) {
            // Each secant is weighted by the length of the other.
            (Some((earlier, before)), Some((later, after))) => {
                (earlier * after + later * before) / (before + after)
            }
            (Some((only, _)), None) | (None, Some((only, _))) => only,
            (None, None) => 0.0,
        }
    }
}

impl super::exact::ExactSettings {
    /// `L + k2`.
    fn level(&self, frame: &PendingFrame, pixel: usize) -> f64 {
        f64::from(frame.luminance[pixel]) + self.process.k2
    }

    /// `ln(L + k2)` of all pixels of a frame.
    pub(super) fn logs<'a>(&'a self, frame: &'a PendingFrame) -> impl Iterator<Item = f64> {
        (0..self.size.pixels()).map(|pixel| libm::log(self.level(frame, pixel)))
    }
}
