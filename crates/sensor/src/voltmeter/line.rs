//! Brightness with a linear logarithm between frames.
//!
//! With `P = L + k2` at the start and `g` the slope of `ln P`, `D(t) = (k1 g + k4 - k5 k2) t + k5 P
//! t E(g t)` where `E(x) = (e^x - 1)/x`. The form is exact, and it does not change when a signal of
//! that form is sampled more finely. The midpoint form of the published program is the case `g =
//! 0`.

use super::DriftGain;
use super::curve::{DriftCurve, FrameEnds, One, Wide};
use super::drift::DriftProcess;
use fearless_simd::{Select as _, Simd, SimdBase as _, SimdMask as _, f64x8};
use gs2e_num::elementary;

/// `slope t + bend t E(growth t)`: coefficients slope, bend, growth, and the largest second
/// derivative.
#[derive(Debug)]
pub(super) struct LineDrift;

impl DriftCurve for LineDrift {
    #[inline(always)]
    fn between<S: Simd>(process: &DriftProcess, ends: &FrameEnds<S>) -> Wide<S> {
        let FrameEnds { levels: [from, to], step, inverse, .. } = *ends;
        let zero = f64x8::splat(step.simd, 0.0);
        let DriftProcess { k1, k2, k4, k5, .. } = *process;
        match process.gain {
            DriftGain::Log => {
                let growth = step * inverse;
                // The leak counts `L`, but `bend` multiplies `L + k2`: the constant takes `k2` off again.
                let slope = growth * k1 + (k4 - k5 * k2);
                // `D'' = k5 (L + k2) growth`, and the brightness is largest at one of the ends.
                [slope, from * k5, growth, (growth * k5).abs() * from.max(to)]
            }
            DriftGain::Midpoint => {
                let middle = (from + to) * 0.5;
                let signal = (to - from) * k1 / middle * inverse;
                [signal + k4 + (middle - k2) * k5, zero, zero, zero]
            }
        }
    }

    #[inline(always)]
    fn level<S: Simd>(process: &DriftProcess, ends: &FrameEnds<S>, t: f64) -> f64x8<S> {
        let FrameEnds { levels: [from, to], step, inverse, .. } = *ends;
        match process.gain {
            DriftGain::Log => from * exp_small(step * inverse * t),
            DriftGain::Midpoint => (from + to) * 0.5,
        }
    }

    #[inline(always)]
    fn rise<S: Simd>(process: &DriftProcess, curve: &Wide<S>, t: f64) -> f64x8<S> {
        let [slope, bend, growth, _] = *curve;
        // If the leak does not depend on brightness, `bend` is 0 and the general form gives the
        // same value.
        if process.k5 == 0.0 { slope * t } else { (slope + bend * mean_growth(growth * t)) * t }
    }

    #[inline(always)]
    fn curvature<S: Simd>(curve: &Wide<S>, _: [f64; 2]) -> f64x8<S> {
        curve[3]
    }

    fn bulge_of_one(curve: &One, [from, to]: [f64; 2]) -> f64 {
        curve[3] * ((to - from) * (to - from) * 0.125)
    }

    fn rise_of_one([slope, bend, growth, _]: &One, t: f64) -> f64 {
        if *bend == 0.0 { slope * t } else { (slope + bend * mean_growth_of_one(growth * t)) * t }
    }

    fn rate_of_one([slope, bend, growth, _]: &One, t: f64) -> f64 {
        slope + bend * exp_of_one(growth * t)
    }

    fn turns_of_one(curve: &One, [from, to]: [f64; 2]) -> [Option<f64>; 2] {
        // The rate is monotonic in time, so opposite signs at the ends are one turn between them.
        let turns = || Self::rate_of_one(curve, from) * Self::rate_of_one(curve, to) < 0.0;
        if Self::is_straight(curve) || !turns() {
            return [None, None];
        }
        let [slope, bend, growth, _] = curve;
        // The rate has both signs only if slope and bend have opposite ones, so the logarithm exists.
        let t = libm::log(-slope / bend) / growth;
        [(t > from && t < to).then_some(t), None]
    }

    fn is_straight([_, bend, growth, _]: &One) -> bool {
        bend * growth == 0.0
    }

    fn are_straight(process: &DriftProcess) -> bool {
        process.k5 == 0.0 || process.gain == DriftGain::Midpoint
    }
}

/// Magnitude of `x` below which `E` and the exponential are summed as series.
const SMALL: f64 = 1.0 / 32.0;

/// Coefficients of `E(x) = (e^x - 1)/x`. The first omitted term is `SMALL^8/9!` = 3e-18.
const SERIES: [f64; 8] =
    [1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0];

/// `E(x)`. Where the closed form is used, its error is below `2^-53/SMALL`, 4e-15.
#[inline(always)]
fn mean_growth<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let series = series_small(x);
    let large = x.abs().simd_ge(SMALL);
    // Between close frames no lane is large, and the exponential is not needed.
    if large.any_true() { large.select((elementary::exp_eight(x) - 1.0) / x, series) } else { series }
}

#[inline(always)]
fn exp_small<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    // `e^x = 1 + x E(x)`: one table of coefficients serves both functions.
    let series = x * series_small(x) + 1.0;
    let large = x.abs().simd_ge(SMALL);
    if large.any_true() { large.select(elementary::exp_eight(x), series) } else { series }
}

#[inline(always)]
fn series_small<S: Simd>(x: f64x8<S>) -> f64x8<S> {
    let c = SERIES;
    // Two independent halves, which a processor evaluates in parallel.
    let square = x * x;
    let low = (x * c[1] + c[0]) + (x * c[3] + c[2]) * square;
    let high = (x * c[5] + c[4]) + (x * c[7] + c[6]) * square;
    low + high * (square * square)
}

fn mean_growth_of_one(x: f64) -> f64 {
    if x.abs() >= SMALL { (libm::exp(x) - 1.0) / x } else { series_of_one(x) }
}

fn exp_of_one(x: f64) -> f64 {
    if x.abs() >= SMALL { libm::exp(x) } else { 1.0 + x * series_of_one(x) }
}

fn series_of_one(x: f64) -> f64 {
    let c = SERIES;
    let square = x * x;
    let low = (c[0] + c[1] * x) + (c[2] + c[3] * x) * square;
    let high = (c[4] + c[5] * x) + (c[6] + c[7] * x) * square;
    low + high * (square * square)
}

#[cfg(test)]
mod tests {
    use super::super::curve::{of_one, wide_arithmetic};
    use super::super::{VoltmeterModel, VoltmeterPreset};
    use super::*;

    fn process(change: impl Fn(&mut VoltmeterModel)) -> DriftProcess {
        let mut sensor = VoltmeterModel::new(VoltmeterPreset::Dvs240.k());
        change(&mut sensor);
        DriftProcess::new(&sensor)
    }

    fn between(process: &DriftProcess, greys: [f64; 2], length: f64) -> One {
        of_one::<LineDrift>(process, greys.map(|l| [l + process.k2, 0.0]), length)
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
        let k = VoltmeterPreset::Dvs240.k();
        let process = process(|_| {});
        for greys in [[0.0, 255.0], [255.0, 0.0], [100.0, 101.0], [64.0, 64.0], [0.0, 0.0]] {
            let length = 1e9;
            let piece = between(&process, greys, length);
            for t in [1.0, 1e3, 0.3 * length, length] {
                let wanted = by_quadrature(k, greys, [length, t]);
                let found = LineDrift::rise_of_one(&piece, t);
                // Simpson's rule on 2000 panels of a smooth function of log range 2.5 has an error
                // of 1e-13 of the leak, which is 13.
                assert!((found - wanted).abs() < 2e-12, "{greys:?} {t}: {found} {wanted}");
                assert_eq!(wide_arithmetic::<LineDrift>(&process, &piece, t)[0].to_bits(), found.to_bits());
            }
        }
    }

    #[test]
    fn the_largest_step_in_thresholds() {
        // Grey 0 to 255, signal alone.
        for (preset, wanted) in [(VoltmeterPreset::Dvs346, 13.799_77), (VoltmeterPreset::Gs2eSi, 3.454_38)] {
            let [k1, k2, ..] = preset.k();
            let process = process(|sensor| sensor.k = [k1, k2, 0.0, 0.0, 0.0, 0.0]);
            let rise = LineDrift::rise_of_one(&between(&process, [0.0, 255.0], 417e3), 417e3);
            assert!((rise - wanted).abs() < 5e-6, "{rise}");
        }
    }

    #[test]
    fn the_midpoint_form_is_linear_in_time() {
        let process = process(|sensor| {
            sensor.k = VoltmeterPreset::Dvs346.k();
            sensor.gain = DriftGain::Midpoint;
        });
        let piece = between(&process, [100.0, 110.0], 416e3);
        let wanted = 5.265 * 10.0 / 125.0 + (1e-7 + 5e-9 * 105.0) * 416.0;
        assert!((LineDrift::rise_of_one(&piece, 416e3) - wanted).abs() < 1e-15);
        assert!((LineDrift::rise_of_one(&piece, 104e3) - 0.25 * wanted).abs() < 1e-15);
    }

    #[test]
    fn bulges_bound_the_distance_from_the_chord() {
        let process = process(|sensor| sensor.k[4] = 1e-3);
        for greys in [[10.0, 200.0], [200.0, 190.0], [190.0, 0.0], [0.0, 255.0]] {
            let piece = between(&process, greys, 2e5);
            let [end, curvature] = wide_arithmetic::<LineDrift>(&process, &piece, 2e5);
            let bound = LineDrift::bulge_of_one(&piece, [0.0, 2e5]);
            assert!(curvature * 2e5 * 2e5 / 8.0 >= bound);
            let stray = |i: i32| {
                let share = f64::from(i) / 1000.0;
                (LineDrift::rise_of_one(&piece, share * 2e5) - share * end).abs()
            };
            let largest = (0..=1000).map(stray).fold(0.0, f64::max);
            assert!(bound >= largest && bound < 6.0 * largest, "{greys:?}: {bound} {largest}");
        }
    }

    #[test]
    fn turns_are_where_leak_and_signal_cancel() {
        let process = process(|sensor| sensor.k = [1.0, 1.0, 0.0, 0.0, 1e-2, 0.0]);
        let piece = between(&process, [200.0, 0.0], 1e6);
        let [turn, none] = LineDrift::turns_of_one(&piece, [0.0, 1e6]);
        let turn = turn.unwrap();
        assert!(LineDrift::rate_of_one(&piece, turn).abs() < 1e-15 * 2e-3 && none.is_none());
        assert!(LineDrift::rate_of_one(&piece, 0.0) > 0.0 && LineDrift::rate_of_one(&piece, 1e6) < 0.0);
    }

    #[test]
    fn series_and_library_meet() {
        for x in [SMALL * (1.0 - 1e-15), SMALL, -SMALL, 1e-9, -1e-300, 0.0, 3.0, -7.0] {
            let wanted = if x == 0.0 { 1.0 } else { libm::expm1(x) / x };
            let tolerance = if x.abs() < SMALL { 4e-16 } else { 4e-15 * wanted.max(1.0) };
            assert!((mean_growth_of_one(x) - wanted).abs() < tolerance, "{x}");
            assert!((exp_of_one(x) - libm::exp(x)).abs() < 4e-16 * libm::exp(x).max(1.0), "{x}");
        }
    }
}
