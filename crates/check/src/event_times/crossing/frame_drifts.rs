//! The drifts of the pixels between the two frames around the present.

use super::BLOCKS;
use crate::drift::DriftLaw;
use gs2e_event::{Event, Polarity};
use gs2e_image::{Image, Size};

/// A frame as the sensor sees it.
#[derive(Debug, Clone)]
pub struct BrightnessFrame {
    /// Stamp, us.
    pub t_us: i64,
    /// Brightness on the grey scale.
    pub brightness: Image<f32>,
    /// Pixels with a colour at the end of its scale, whose brightness is a bound only.
    pub cut: Vec<bool>,
}

/// The frames around the present, and what the drifts need of those before.
#[derive(Debug)]
pub(super) struct FrameDrifts {
    law: DriftLaw,
    width: usize,
    /// True for the lines of the picture that are compared.
    compared: Vec<bool>,
    middle_us: f64,
    /// `ln(L + k2)` of the first frame; NaN where it is cut off.
    first_logs: Vec<f64>,
    first_us: i64,
    /// Integral of brightness since the first frame, at the earlier of both frames.
    exposure: Vec<f64>,
    /// The two frames around the present. Drifts are computed for the pixels with events only: most
    /// pixels have none between two frames, and a logarithm costs more than an event.
    frames: [BrightnessFrame; 2],
}

/// An event, and the drift of its pixel as the frames show it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Number of the pixel, and of the block in which it lies, both counted from the start of its row of
    /// blocks.
    pub(super) pixel: usize,
    pub(super) block: usize,
    pub(super) t_us: f64,
    pub(super) polarity: Polarity,
    pub(super) threshold: f64,
    /// Drift since the first frame; NaN if it is unknown.
    pub(super) drift: f64,
    /// `rate` and `rate (t - m)`.
    pub(super) moves: [f64; 2],
    /// Mean brightness between the two frames, on the grey scale.
    pub(super) brightness: f64,
}

impl Crossing {
    /// Change of the voltage by which the event is explained.
    pub(super) fn jump(&self) -> f64 {
        match self.polarity {
            Polarity::On => self.threshold,
            Polarity::Off => -self.threshold,
        }
    }

    /// Returns true if the drift has the direction of the event; false if it is unknown.
    pub(super) fn is_along(&self) -> bool {
        self.moves[0] * self.jump() > 0.0
    }
}

/// Integral of a brightness that is linear between its ends. Negative ones count as black.
fn integral_between(step_us: f64, ends: [f32; 2]) -> f64 {
    let [a, b] = ends.map(|l| f64::from(l.max(0.0)));
    step_us * (0.5 * (a + b))
}

impl FrameDrifts {
    /// Every `apart`-th line is compared.
    pub(super) fn new(law: DriftLaw, first: BrightnessFrame, end_us: i64, apart: u64) -> Self {
        let BrightnessFrame { t_us, brightness, cut } = &first;
        let log = |(l, cut): (&f32, &bool)| if *cut { f64::NAN } else { law.brightness(*l) };
        let first_logs: Vec<f64> = brightness.pixels().iter().zip(cut).map(log).collect();
        Self {
            law,
            width: brightness.size().width as usize,
            compared: (0..u64::from(brightness.size().height)).map(|y| y.is_multiple_of(apart)).collect(),
            middle_us: f64::midpoint(*t_us as f64, end_us as f64),
            exposure: vec![0.0; first_logs.len()],
            first_logs,
            first_us: *t_us,
            frames: [first.clone(), first],
        }
    }

    pub(super) fn size(&self) -> Size {
        self.frames[1].brightness.size()
    }

    /// Time from the first frame to the middle of the clip, us.
    pub(super) fn half_us(&self) -> f64 {
        self.middle_us - self.first_us as f64
    }

    pub(super) fn take_frame(&mut self, frame: BrightnessFrame) {
        assert_eq!(frame.brightness.pixels().len(), self.exposure.len(), "frames of one size");
        let [from, to] = &self.frames;
        let step_us = (to.t_us - from.t_us) as f64;
        let ends = from.brightness.pixels().iter().zip(to.brightness.pixels());
        // Every pixel of every frame comes here: without indices, the sums are vectors.
        for (exposure, (a, b)) in self.exposure.iter_mut().zip(ends) {
            *exposure += integral_between(step_us, [*a, *b]);
        }
        self.frames.swap(0, 1);
        self.frames[1] = frame;
    }

    /// The pixel of an event; `None` off the sensor, and on lines that are not compared.
    pub(super) fn pixel(&self, event: &Event) -> Option<usize> {
        let [x, y] = [event.x, event.y].map(usize::from);
        let is_compared = *self.compared.get(y)? && x < self.width;
        is_compared.then_some(y * self.width + x)
    }

    /// The bits of the values that determine the drift of a pixel.
    pub(super) fn met_at(&self, pixel: usize) -> u64 {
        let of_frame = |frame: &BrightnessFrame| {
            u64::from(frame.brightness.pixels()[pixel].to_bits()) ^ u64::from(frame.cut[pixel])
        };
        let [from, to] = &self.frames;
        let drift = self.first_logs[pixel].to_bits() ^ self.exposure[pixel].to_bits();
        drift ^ of_frame(from) ^ of_frame(to)
    }

    /// The column of blocks in which a pixel lies. Pixels may be counted from any line.
    pub(super) fn column(&self, pixel: usize) -> usize {
        pixel % self.width * BLOCKS / self.width
    }

    /// An event of the given pixel of its row of blocks, which begins at pixel `first`.
    pub(super) fn crossing(&self, event: &Event, pixel: usize, first: usize) -> Crossing {
        let [from, to] = self.drifts(first + pixel);
        let [start, end] = [0, 1].map(|i| self.frames[i].t_us as f64);
        let rate = (to - from) / (end - start);
        // A file holds the microsecond that contains the event: half of one later on average.
        let t_us = event.t.floor_micros() as f64 + 0.5;
        let [a, b] = [0, 1].map(|i| f64::from(self.frames[i].brightness.pixels()[first + pixel]));
        Crossing {
            pixel,
            block: self.column(pixel),
            t_us,
            polarity: event.polarity,
            threshold: self.law.thresholds[usize::from(event.polarity == Polarity::Off)],
            drift: from + rate * (t_us - start),
            moves: [rate, rate * (t_us - self.middle_us)],
            brightness: f64::midpoint(a, b),
        }
    }

    /// Integral of a pixel's brightness between the two frames.
    fn added_exposure(&self, pixel: usize) -> f64 {
        let [from, to] = &self.frames;
        let ends = [from, to].map(|frame| frame.brightness.pixels()[pixel]);
        integral_between((to.t_us - from.t_us) as f64, ends)
    }

    /// Drifts of a pixel at the two frames; NaN where they are unknown.
    fn drifts(&self, pixel: usize) -> [f64; 2] {
        let exposures = [self.exposure[pixel], self.exposure[pixel] + self.added_exposure(pixel)];
        [0, 1].map(|i| {
            let BrightnessFrame { t_us, brightness, cut } = &self.frames[i];
            let log = if cut[pixel] { f64::NAN } else { self.law.brightness(brightness.pixels()[pixel]) };
            self.law.drift(log - self.first_logs[pixel], (t_us - self.first_us) as f64, exposures[i])
        })
    }
}
