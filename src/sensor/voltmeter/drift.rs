//! The drift `D(t)` of one pixel and its noise, from the luminance at the frames.
//!
//! `D = k1 ln(L + k2) + integral of (k4 + k5 L)`. Between frames `ln(L + k2)` is linear, so with `P = L + k2` at the
//! start of a piece and `g` the slope of `ln P`, `D(t) = (k1 g + k4 - k5 k2) t + k5 P t E(g t)`, `E(x) = (e^x - 1)/x`:
//! exact, and unchanged when a signal of that form is sampled finer.

use super::bridge::Barriers;
use super::{Gain, Voltmeter};
use crate::sensor::statistics::Renewal;

/// Microseconds in a nanosecond.
const US: f64 = 1e-3;

/// The process with time in nanoseconds and brightness in grey 0..255.
#[derive(Debug, Clone, Copy)]
pub(super) struct Process {
    k1: f64,
    k2: f64,
    k3: f64,
    k4: f64,
    k5: f64,
    k6: f64,
    gain: Gain,
}

impl Process {
    pub(super) fn new(sensor: &Voltmeter) -> Self {
        let [k1, k2, k3, k4, k5, k6] = sensor.k;
        let root = US.sqrt();
        Self { k1, k2, k3: k3 * root, k4: k4 * US, k5: k5 * US, k6: k6 * root, gain: sensor.gain }
    }

    /// Whether no brightness makes noise.
    pub(super) fn is_noiseless(&self) -> bool {
        self.k3 == 0.0 && self.k6 == 0.0
    }

    /// `ln(L + k2)`, the brightness that is interpolated.
    pub(super) fn log_brightness(&self, luminance: f32) -> f64 {
        libm::log(f64::from(luminance) + self.k2)
    }

    /// Standard deviation of the noise per square root of a nanosecond, at grey `luminance`.
    pub(super) fn sigma(&self, luminance: f64) -> f64 {
        self.k3 * luminance.sqrt() / (luminance + self.k2) + self.k6
    }

    /// What a pixel of constant grey does, per nanosecond.
    pub(super) fn at_rest(&self, luminance: f64, barriers: Barriers) -> Renewal {
        let sigma = self.sigma(luminance);
        let Barriers { up, down } = barriers;
        Renewal { drift: self.k4 + self.k5 * luminance, variance: sigma * sigma, up, down }
    }

    /// The drift along the time between two frames `1/inverse` ns apart.
    pub(super) fn between(&self, from: Sample, to: Sample, inverse: f64) -> Smooth {
        let (p0, p1) = (f64::from(from.luminance) + self.k2, f64::from(to.luminance) + self.k2);
        match self.gain {
            Gain::Log => {
                let growth = (to.log - from.log) * inverse;
                Smooth {
                    slope: self.k1 * growth + (self.k4 - self.k5 * self.k2),
                    bend: self.k5 * p0,
                    growth,
                    level: p0,
                    curvature: (self.k5 * growth).abs() * p0.max(p1),
                }
            }
            Gain::Midpoint => {
                let middle = 0.5 * (p0 + p1);
                let signal = self.k1 * (p1 - p0) / middle * inverse;
                Smooth { slope: signal + self.k4 + self.k5 * (middle - self.k2), ..Smooth::still(middle) }
            }
        }
    }

    /// No drift at all, at the brightness of `sample`: what follows the last frame.
    pub(super) fn after(&self, sample: Sample) -> Smooth {
        Smooth::still(f64::from(sample.luminance) + self.k2)
    }

    /// A bound on what the drift strays from its chord between two frames `length` ns apart: the integral of a
    /// brightness that only rises (or falls) is within a quarter of its step times the length.
    pub(super) fn bow(&self, from: f32, to: f32, length: f64) -> f64 {
        match self.gain {
            Gain::Log => 0.25 * length * (self.k5 * (f64::from(to) - f64::from(from))).abs(),
            Gain::Midpoint => 0.0,
        }
    }

    /// Grey at `t` ns after the start of a piece.
    pub(super) fn luminance(&self, piece: &Smooth, t: f64) -> f64 {
        (piece.level * exp(piece.growth * t) - self.k2).max(0.0)
    }
}

/// One pixel of one frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) luminance: f32,
    pub(super) log: f64,
}

/// The drift along one piece, as a function of the time since its start: `slope t + bend t E(growth t)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Smooth {
    slope: f64,
    bend: f64,
    growth: f64,
    /// `L + k2` at the start.
    level: f64,
    /// Largest second derivative of the drift.
    curvature: f64,
}

impl Smooth {
    /// No drift, at a constant `L + k2`.
    fn still(level: f64) -> Self {
        Self { slope: 0.0, bend: 0.0, growth: 0.0, level, curvature: 0.0 }
    }

    /// `D(t) - D(0)`.
    pub(super) fn rise(&self, t: f64) -> f64 {
        (self.slope + self.bend * mean_growth(self.growth * t)) * t
    }

    /// `D'(t)`.
    pub(super) fn rate(&self, t: f64) -> f64 {
        self.slope + self.bend * exp(self.growth * t)
    }

    /// Where in (0, `length`) the drift turns around, if it does.
    pub(super) fn turn(&self, length: f64) -> Option<f64> {
        if self.rate(0.0) * self.rate(length) >= 0.0 {
            return None;
        }
        let t = libm::log(-self.slope / self.bend) / self.growth;
        (t > 0.0 && t < length).then_some(t)
    }

    /// The same piece, begun `t` later.
    pub(super) fn from(&self, t: f64) -> Self {
        let growth = exp(self.growth * t);
        Self { bend: self.bend * growth, level: self.level * growth, ..*self }
    }
}

/// Where `mean_growth` and `exp` are summed as series.
const SMALL: f64 = 1.0 / 32.0;

/// `(e^x - 1) / x`, 1 at 0. The series ends below `SMALL^8/9!` = 3e-18.
#[inline]
fn mean_growth(x: f64) -> f64 {
    if x.abs() >= SMALL {
        return libm::expm1(x) / x;
    }
    let square = x * x;
    let low = (1.0 + x * 0.5) + (1.0 / 6.0 + x * (1.0 / 24.0)) * square;
    let high = (1.0 / 120.0 + x * (1.0 / 720.0)) + (1.0 / 5040.0 + x * (1.0 / 40320.0)) * square;
    low + high * (square * square)
}

#[inline]
fn exp(x: f64) -> f64 {
    if x.abs() < SMALL { 1.0 + x * mean_growth(x) } else { libm::exp(x) }
}

/// The drift of one pixel over a window, piece by piece, 0 at its start.
#[derive(Debug, Default)]
pub(super) struct Path {
    parts: Vec<Part>,
    end: f64,
}

/// The drift along one piece, clipped to the window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    /// Time of its start, ns since the window's start.
    pub(super) from: f64,
    /// Time of its end.
    pub(super) to: f64,
    /// Drift at its start.
    pub(super) at: f64,
    /// Drift along it.
    pub(super) smooth: Smooth,
}

impl Path {
    /// The path through these parts, with this drift at the window's end.
    pub(super) fn fill(&mut self, parts: impl Iterator<Item = Part>, end: f64) {
        self.parts.clear();
        self.parts.extend(parts);
        self.end = end;
    }

    /// The parts in order of time.
    pub(super) fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// The part that holds `t`; at a stamp, the later one.
    pub(super) fn part(&self, t: f64) -> &Part {
        let after = self.parts.iter().position(|part| t < part.to).unwrap_or(self.parts.len() - 1);
        &self.parts[after]
    }

    /// Drift at `t` ns since the window's start.
    pub(super) fn at(&self, t: f64) -> f64 {
        let part = self.part(t);
        part.at + part.smooth.rise(t - part.from)
    }

    /// Drift over the whole window.
    pub(super) fn end(&self) -> f64 {
        self.end
    }

    /// A bound on the distance of the drift from its chord between `a` and `b` (drifts `at_a`, `at_b`): the largest at
    /// the stamps inside, plus what a piece can stray from its own chord.
    pub(super) fn straying(&self, [a, b]: [f64; 2], [at_a, at_b]: [f64; 2]) -> f64 {
        let slope = (at_b - at_a) / (b - a);
        let (mut knots, mut curves) = (0.0f64, 0.0f64);
        for part in &self.parts {
            let length = part.to.min(b) - part.from.max(a);
            if length <= 0.0 {
                continue;
            }
            if part.from > a {
                knots = knots.max((part.at - at_a - slope * (part.from - a)).abs());
            }
            curves = curves.max(part.smooth.curvature * length * length * 0.125);
        }
        knots + curves
    }
}

#[cfg(test)]
mod tests {
    use super::super::Preset;
    use super::*;

    fn process(change: impl Fn(&mut Voltmeter)) -> Process {
        let mut sensor = Voltmeter::new(Preset::Dvs240.k());
        change(&mut sensor);
        Process::new(&sensor)
    }

    fn sample(process: &Process, luminance: f32) -> Sample {
        Sample { luminance, log: process.log_brightness(luminance) }
    }

    /// `D` over `[0, t]` of a piece by Simpson's rule on the drift's definition.
    fn by_quadrature(k: [f64; 6], [l0, l1]: [f64; 2], [length, t]: [f64; 2]) -> f64 {
        let [k1, k2, _, k4, k5, _] = k;
        let luminance = |t: f64| (l0 + k2) * ((l1 + k2) / (l0 + k2)).powf(t / length) - k2;
        let n = 2000;
        let h = t / f64::from(n);
        let leak: f64 = (0..=n)
            .map(|i| {
                let weight = if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
                weight * (k4 + k5 * luminance(f64::from(i) * h))
            })
            .sum();
        k1 * ((luminance(t) + k2) / (l0 + k2)).ln() + leak * h / 3.0 * 1e-3
    }

    #[test]
    fn drift_is_the_integral_of_its_definition() {
        let k = Preset::Dvs240.k();
        let process = process(|_| {});
        for [l0, l1] in [[0.0f32, 255.0], [255.0, 0.0], [100.0, 101.0], [64.0, 64.0], [0.0, 0.0]] {
            let length = 1e9;
            let piece = process.between(sample(&process, l0), sample(&process, l1), 1.0 / length);
            for t in [1.0, 1e3, 0.3 * length, length] {
                let wanted = by_quadrature(k, [l0, l1].map(f64::from), [length, t]);
                // Simpson on 2000 panels of a smooth function of log range 2.5 is good to 1e-13 of the leak, 13.
                assert!((piece.rise(t) - wanted).abs() < 2e-12, "{l0} {l1} {t}: {} {wanted}", piece.rise(t));
                let later = piece.from(0.5 * t);
                let halves = piece.rise(0.5 * t) + later.rise(0.5 * t);
                assert!((halves - piece.rise(t)).abs() < 1e-13 * piece.rise(t).abs().max(1.0));
            }
        }
    }

    #[test]
    fn the_largest_step_in_thresholds() {
        // numerics.md 10: grey 0 to 255, signal alone.
        for (preset, wanted) in [(Preset::Dvs346, 13.799_77), (Preset::Gs2eSi, 3.454_38)] {
            let [k1, k2, ..] = preset.k();
            let process = process(|sensor| sensor.k = [k1, k2, 0.0, 0.0, 0.0, 0.0]);
            let piece = process.between(sample(&process, 0.0), sample(&process, 255.0), 1.0 / 417e3);
            assert!((piece.rise(417e3) - wanted).abs() < 5e-6, "{}", piece.rise(417e3));
        }
    }

    #[test]
    fn the_midpoint_form_is_linear_in_time() {
        let k = Preset::Dvs346.k();
        let process = process(|sensor| {
            sensor.k = k;
            sensor.gain = Gain::Midpoint;
        });
        let piece = process.between(sample(&process, 100.0), sample(&process, 110.0), 1.0 / 416e3);
        let wanted = 5.265 * 10.0 / 125.0 + (1e-7 + 5e-9 * 105.0) * 416.0;
        assert!((piece.rise(416e3) - wanted).abs() < 1e-15);
        assert!((piece.rise(104e3) - 0.25 * wanted).abs() < 1e-15);
        assert!((process.luminance(&piece, 0.0) - 105.0).abs() < 1e-13);
    }

    #[test]
    fn straying_bounds_the_distance_from_the_chord() {
        let process = process(|sensor| sensor.k[4] = 1e-3);
        let greys = [10.0, 200.0, 190.0, 0.0, 0.0, 255.0].map(|l| sample(&process, l));
        let mut at = 0.0;
        let parts: Vec<Part> = (0..5)
            .map(|i| {
                let smooth = process.between(greys[i], greys[i + 1], 1.0 / 2e5);
                let from = 2e5 * i as f64;
                let part = Part { from, to: from + 2e5, at, smooth };
                at += smooth.rise(2e5);
                part
            })
            .collect();
        let mut path = Path::default();
        path.fill(parts.into_iter(), at);
        let [a, b, n] = [5e4, 9.3e5, 1000.0];
        for (a, b) in [(a, b), (a, 1.9e5), (4.1e5, 5.9e5)] {
            let chord = |t: f64| path.at(a) + (path.at(b) - path.at(a)) * (t - a) / (b - a);
            let times = (0..=1000).map(|i| a + (b - a) * f64::from(i) / n);
            let largest = times.map(|t| (path.at(t) - chord(t)).abs()).fold(0.0, f64::max);
            let bound = path.straying([a, b], [path.at(a), path.at(b)]);
            assert!(bound >= largest && bound < 6.0 * largest, "{bound} {largest}");
        }
    }

    #[test]
    fn turns_are_where_leak_and_signal_cancel() {
        let process = process(|sensor| sensor.k = [1.0, 1.0, 0.0, 0.0, 1e-2, 0.0]);
        let piece = process.between(sample(&process, 200.0), sample(&process, 0.0), 1e-6);
        let turn = piece.turn(1e6).unwrap();
        assert!(piece.rate(turn).abs() < 1e-15 * 2e-3, "{}", piece.rate(turn));
        assert!(piece.rate(0.0) > 0.0 && piece.rate(1e6) < 0.0);
    }

    #[test]
    fn series_and_library_meet() {
        for x in [SMALL * (1.0 - 1e-15), SMALL, -SMALL, 1e-9, -1e-300, 0.0] {
            let wanted = if x == 0.0 { 1.0 } else { libm::expm1(x) / x };
            assert!((mean_growth(x) - wanted).abs() < 4e-16, "{x}");
            assert!((exp(x) - libm::exp(x)).abs() < 4e-16, "{x}");
        }
    }
}
