//! The photoreceptor's noise in the exact law: an Ornstein-Uhlenbeck voltage on the dyadic clock.
//!
//! Between known ends `a` and `b`, a time `h` apart, the process is Gaussian too. In the middle it has the
//! mean `(a + b) / (2 cosh z)` and the variance `s^2 tanh z`, where `z = theta h / 2` and `s` is its standard
//! deviation. So the clock carries over: a root cell takes one normal draw for the end, a split one for the
//! middle. The values at the ends of cells have the exact law, whatever is split. Most cells are not: one
//! number decides them (`touch.rs`).
//!
//! In a leaf, the bridge is taken for a Brownian one of the same quadratic variation, `2 theta s^2` per time,
//! around the chord. Two things are neglected: the mean strays from the chord by at most `|u| (theta h)^2 /
//! 8`, as it solves `m'' = theta^2 m`, and the variance in the middle is smaller by the share `(theta h)^2 /
//! 12`. A leaf has `theta h` of at most [`SHORT`], so both are below 4e-5.
//!
//! Deviation and bandwidth follow the light. They are those of the middle of a root cell for the whole cell,
//! as the noise of the Brownian voltage is.

use super::VoltmeterModel;
use super::touch::{CellShape, WideShape};
use crate::chain::PixelArray;
use crate::noise::ReceptorPoint;
use crate::noise::grey_table::GreyTable;
use crate::statistics::RenewalProcess;
use crate::statistics::receptor_rate::{ReceptorRate, leak_distance};
use crate::voltmeter::tree::ROOT;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, f64x8};
use gs2e_num::elementary::{exp_eight, load_eight};
use gs2e_num::seed::{DrawSpace, Seed, SeedCell};
use std::f64::consts::TAU;

/// Largest length of a leaf as a share of the time `1 / theta` in which the noise returns.
pub(super) const SHORT: f64 = 1.0 / 64.0;
/// Longest leaf of a path that has touched a line, ns. Longer ones would seldom be straight enough, and
/// whether they are depends on how frames cut the drift.
pub(super) const LONGEST: f64 = 32_768.0;
/// Block of the draws that split a cell: that of the Brownian motion, and that of this noise. The ends of a
/// root cell are those of block 0.
pub(super) const BLOCK: u32 = 1;
/// Bits of a draw that its normal deviate does not use, and their step as a part of a number from 0 to 1.
pub(super) const SPARE: u64 = 0xfff;
pub(super) const SPARE_UNIT: f64 = 1.0 / 4096.0;

/// The photoreceptor's noise of all pixels of a sensor.
#[derive(Debug)]
pub(super) struct ReceptorNoise {
    /// `theta` per ns, the share of the noise that is left after a root cell, and the share of the deviation
    /// that the root cell adds.
    rates: ByLight<3>,
    /// The shape of a root cell, where all rates are equal.
    shape: CellShape,
    /// Deviation where the factor of the amplitude is 1, in thresholds.
    deviations: ByLight<1>,
    /// Factor of the amplitude of each pixel, padded with 1 to a multiple of 8. Empty where all have the
    /// same.
    amplitude: Vec<f64>,
    /// Largest standard deviation at any light, in thresholds, where the factor is 1.
    largest: f64,
}

/// Values that may follow the light.
#[derive(Debug)]
enum ByLight<const N: usize> {
    /// The same at any light.
    Equal([f64; N]),
    ByGrey(GreyTable<N>),
}

/// The noise of eight pixels in a root cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct WideReceptor<S: Simd> {
    /// `theta`, per ns.
    pub(super) rate: f64x8<S>,
    /// Standard deviation, in thresholds.
    pub(super) deviation: f64x8<S>,
    /// Share of the voltage that is left after a root cell.
    decay: f64x8<S>,
    /// Share of the deviation that the root cell adds.
    added: f64x8<S>,
    /// The shape of the root cell; absent where it has to be computed.
    shape: Option<WideShape<S>>,
}

impl<const N: usize> ByLight<N> {
    /// The values at a grey.
    #[inline(always)]
    fn at(&self, grey: f32) -> [f64; N] {
        match self {
            Self::Equal(values) => *values,
            Self::ByGrey(table) => table.at(grey),
        }
    }

    /// The values of eight pixels.
    #[inline(always)]
    fn eight<S: Simd>(&self, greys: f64x8<S>) -> [f64x8<S>; N] {
        match self {
            Self::Equal(values) => {
                let mut wide = [f64x8::splat(greys.simd, 0.0); N];
                // A loop: a closure may be compiled without the instruction set in use.
                for (to, value) in wide.iter_mut().zip(values) {
                    *to = f64x8::splat(greys.simd, *value);
                }
                wide
            }
            Self::ByGrey(table) => table.eight(greys),
        }
    }
}

impl ReceptorNoise {
    /// The noise of a sensor; `None` if it has none.
    pub(super) fn new(sensor: &VoltmeterModel, array: &PixelArray) -> Option<Self> {
        let noise = &sensor.photoreceptor_noise;
        if noise.is_absent() {
            return None;
        }
        let (white_lux, k1) = (sensor.settings.front_end.white_lux(), sensor.k[0]);
        let of_rate = |cutoff_hz: f64| {
            let rate = TAU * cutoff_hz * 1e-9;
            let decay = libm::exp(-rate * ROOT as f64);
            [rate, decay, (1.0 - decay * decay).sqrt()]
        };
        let first = noise.points[0];
        let are_equal = |value: fn(&ReceptorPoint) -> f64| {
            noise.points.iter().all(|point| value(point).to_bits() == value(&first).to_bits())
        };
        let rates = if are_equal(|point| point.cutoff_hz) {
            ByLight::Equal(of_rate(first.cutoff_hz))
        } else {
            ByLight::ByGrey(GreyTable::new(|grey| of_rate(noise.at_grey(grey, white_lux).cutoff_hz)))
        };
        let deviations = if are_equal(|point| point.deviation) {
            ByLight::Equal([k1 * first.deviation])
        } else {
            ByLight::ByGrey(GreyTable::new(|grey| [k1 * noise.at_grey(grey, white_lux).deviation]))
        };
        let mut amplitude = Vec::new();
        if noise.spread > 0.0 {
            amplitude.extend((0..array.size.pixels()).map(|pixel| noise.amplitude(array.site(pixel))));
            amplitude.resize(amplitude.len().next_multiple_of(8), 1.0);
        }
        let largest = noise.points.iter().map(|point| k1 * point.deviation).fold(0.0, f64::max);
        let [_, decay, _] = of_rate(first.cutoff_hz);
        Some(Self { rates, shape: CellShape::new(decay), deviations, amplitude, largest })
    }

    /// The noise of eight pixels from `first` on, at these greys.
    #[inline(always)]
    pub(super) fn eight<S: Simd>(&self, greys: f64x8<S>, first: usize) -> WideReceptor<S> {
        let simd = greys.simd;
        let [rate, decay, added] = self.rates.eight(greys);
        let [mut deviation] = self.deviations.eight(greys);
        if !self.amplitude.is_empty() {
            deviation *= load_eight(simd, &self.amplitude, first);
        }
        let shape = match self.rates {
            ByLight::Equal(_) => Some(WideShape::splat(simd, &self.shape)),
            ByLight::ByGrey(_) => None,
        };
        WideReceptor { rate, deviation, decay, added, shape }
    }

    /// Deviation of a pixel at a grey, in thresholds.
    fn deviation_of(&self, grey: f32, pixel: usize) -> f64 {
        let [deviation] = self.deviations.at(grey);
        deviation * self.factor(pixel)
    }

    /// A bound on the variance of the difference of a pixel's noise at two times, at any light.
    pub(super) fn change_variance(&self, pixel: usize) -> f64 {
        let deviation = self.largest * self.factor(pixel);
        2.0 * deviation * deviation
    }

    fn factor(&self, pixel: usize) -> f64 {
        self.amplitude.get(pixel).copied().unwrap_or(1.0)
    }

    /// The quantile `share` of a pixel's voltage without this noise, after a long time at a grey.
    pub(super) fn at_rest(&self, grey: f32, pixel: usize, at_rest: &RenewalProcess, share: f64) -> f64 {
        let [theta, ..] = self.rates.at(grey);
        let RenewalProcess { drift, variance, up, down } = *at_rest;
        let deviation = self.deviation_of(grey, pixel);
        if variance == 0.0 {
            let noise = ReceptorRate { deviation, theta, up, down };
            // Rates are per ns here and in the drift.
            return noise.at_rest(drift).quantile(share);
        }
        // A Brownian motion forgets what pairs of events have moved. The leak ends before its threshold.
        let distance = leak_distance(deviation, theta, drift).min(0.5 * (up + down));
        at_rest.residual(share) - if drift == 0.0 { 0.0 } else { distance.copysign(drift) }
    }

    /// The voltage of a pixel at the first frame, which it has seen for a long time.
    pub(super) fn initial(&self, grey: f32, pixel: usize, [x, y]: [u16; 2], seed: Seed) -> f64 {
        // Draw 0 of the cell is that of the voltage at the first frame.
        let normal = seed.normal(SeedCell { x, y, level: 0, index: 0 }, DrawSpace::Initial, 1);
        self.deviation_of(grey, pixel) * normal
    }
}

impl<S: Simd> WideReceptor<S> {
    /// The voltages at the end of a root cell, from those at its start and a normal deviate.
    #[inline(always)]
    pub(super) fn go_on(&self, start: f64x8<S>, normal: f64x8<S>) -> f64x8<S> {
        start * self.decay + self.deviation * self.added * normal
    }

    /// The shape of the root cell.
    #[inline(always)]
    pub(super) fn shape(&self) -> WideShape<S> {
        match self.shape {
            Some(shape) => shape,
            None => WideShape::new(self.decay),
        }
    }
}

/// The voltage in the middle of a cell of this length, ns, between two ends.
#[inline(always)]
pub(super) fn middle<S: Simd>(
    [rate, deviation]: [f64x8<S>; 2],
    [from, to]: [f64x8<S>; 2],
    length: f64,
    normal: f64x8<S>,
) -> f64x8<S> {
    // With `e = exp(-z)`: `1/(2 cosh z) = e/(1 + e^2)` and `tanh z = (1 - e^2)/(1 + e^2)`.
    let e = exp_eight(rate * (-0.5 * length));
    let square = e * e;
    let share = 1.0 / (square + 1.0);
    (from + to) * e * share + deviation * ((1.0 - square) * share).sqrt() * normal
}

/// A bound on the distance between the mean of a bridge and its chord over a cell: `|u| (theta h)^2 / 8`, and
/// never more than `|u|`, because the mean lies between 0 and the chord.
#[inline(always)]
pub(super) fn bow<S: Simd>(rate: f64x8<S>, [from, to]: [f64x8<S>; 2], length: f64) -> f64x8<S> {
    let turns = rate * length;
    (turns * turns * 0.125).min(1.0) * from.abs().max(to.abs())
}

#[cfg(test)]
mod tests;
