//! Brightness with a cubic logarithm between frames, given by its slopes at the frames.
//!
//! The signal's part of the drift is `k1` times that cubic, so it is exact between frames. The
//! leak's part is the integral of the parabola through the brightness at both frames and in the
//! middle, which is a cubic too. Slopes are not limited.

use super::curve::{DriftCurve, FrameEnds, One, Wide};
use super::drift::DriftProcess;
use fearless_simd::{Simd, SimdBase as _, f64x8};
use gs2e_num::elementary;

/// `((c3 s + c2) s + c1) s` with `s = t/h`: coefficients c1, c2, c3 and `1/h`.
#[derive(Debug)]
pub(super) struct CubicDrift;

/// `V - V0` as coefficients of `s`, `s^2` and `s^3`.
#[inline(always)]
pub(super) fn log_cubic<S: Simd>(ends: &FrameEnds<S>) -> [f64x8<S>; 3] {
    let FrameEnds { step, slopes, inverse, .. } = *ends;
    // Slopes per unit of `s`, which runs from 0 to 1 between the frames.
    let [a, b] = scaled(slopes, 1.0 / inverse);
    [a, step * 3.0 - a * 2.0 - b, a + b - step * 2.0]
}

/// The weights of the steps before and after a frame in the slope there, from the lengths of both intervals:
/// the slope of the parabola through three frames. A length of 0 stands for no interval, and the slope is
/// then that of the line through two frames.
pub(super) fn secant_weights([earlier, later]: [f64; 2]) -> [f64; 2] {
    let whole = earlier + later;
    // The parabola weights each secant by the length of the other interval. Beyond an end there is no
    // secant.
    match (earlier > 0.0, later > 0.0) {
        (true, true) => [later / (earlier * whole), earlier / (later * whole)],
        (true, false) => [1.0 / earlier, 0.0],
        (false, true) => [0.0, 1.0 / later],
        (false, false) => [0.0, 0.0],
    }
}

/// Each vector times a number. A loop: a closure given to `map` may be compiled without the instruction set
/// in use.
#[inline(always)]
fn scaled<S: Simd, const N: usize>(mut vectors: [f64x8<S>; N], factor: f64) -> [f64x8<S>; N] {
    for vector in &mut vectors {
        *vector *= factor;
    }
    vectors
}

#[inline(always)]
fn horner<S: Simd>([c1, c2, c3]: [f64x8<S>; 3], s: f64) -> f64x8<S> {
    ((c3 * s + c2) * s + c1) * s
}

impl DriftCurve for CubicDrift {
    #[inline(always)]
    fn between<S: Simd>(process: &DriftProcess, ends: &FrameEnds<S>) -> Wide<S> {
        let DriftProcess { k1, k2, k4, k5, .. } = *process;
        let inverse = ends.inverse;
        let length = 1.0 / inverse;
        let signal = scaled(log_cubic(ends), k1);
        let mut leak = [f64x8::splat(signal[0].simd, 0.0); 3];
        // The middle of the interval takes an exponential, which only the leak needs.
        if k5 != 0.0 {
            let middle = Self::level(process, ends, 0.5 * length) - k2;
            let [first, last] = [ends.levels[0] - k2, ends.levels[1] - k2];
            // The parabola through these three greys, integrated over `s`.
            leak = [
                first,
                (middle * 4.0 - first * 3.0 - last) * 0.5,
                (first - middle * 2.0 + last) * (2.0 / 3.0),
            ];
        }
        let [l1, l2, l3] = scaled(leak, k5 * length);
        let inverse = f64x8::splat(l1.simd, inverse);
        [signal[0] + l1 + k4 * length, signal[1] + l2, signal[2] + l3, inverse]
    }

    #[inline(always)]
    fn level<S: Simd>(_: &DriftProcess, ends: &FrameEnds<S>, t: f64) -> f64x8<S> {
        let start = ends.levels[0];
        // After the last frame the brightness stays, and the step is not set.
        if ends.inverse == 0.0 {
            return start;
        }
        start * elementary::exp_eight(horner(log_cubic(ends), t * ends.inverse))
    }

    #[inline(always)]
    fn rise<S: Simd>(_: &DriftProcess, [c1, c2, c3, inverse]: &Wide<S>, t: f64) -> f64x8<S> {
        let s = *inverse * t;
        ((*c3 * s + *c2) * s + *c1) * s
    }

    #[inline(always)]
    fn curvature<S: Simd>([_, c2, c3, inverse]: &Wide<S>, times: [f64; 2]) -> f64x8<S> {
        // The second derivative is linear in time, so its largest value is at one of the ends.
        let from = (*c3 * (*inverse * (3.0 * times[0])) + *c2).abs();
        let to = (*c3 * (*inverse * (3.0 * times[1])) + *c2).abs();
        from.max(to) * 2.0 * *inverse * *inverse
    }

    /// Around `s0`, the quadratic part differs from its chord by at most a quarter of its
    /// coefficient, the cubic part by at most `2/sqrt 27` of its own.
    fn bulge_of_one([_, c2, c3, inverse]: &One, [from, to]: [f64; 2]) -> f64 {
        let [s, width] = [from * inverse, (to - from) * inverse];
        ((c2 + 3.0 * c3 * s).abs() * 0.25 + 0.385 * c3.abs() * width) * width * width
    }

    fn rise_of_one([c1, c2, c3, inverse]: &One, t: f64) -> f64 {
        let s = inverse * t;
        ((c3 * s + c2) * s + c1) * s
    }

    fn rate_of_one([c1, c2, c3, inverse]: &One, t: f64) -> f64 {
        let s = inverse * t;
        ((3.0 * c3 * s + 2.0 * c2) * s + c1) * inverse
    }

    /// The roots of `3 c3 s^2 + 2 c2 s + c1`, computed without subtracting numbers of like size.
    fn turns_of_one([c1, c2, c3, inverse]: &One, [from, to]: [f64; 2]) -> [Option<f64>; 2] {
        let square = c2 * c2 - 3.0 * c1 * c3;
        // A double root is no turn: the drift only pauses there.
        if square <= 0.0 {
            return [None, None];
        }
        let q = -(c2 + square.sqrt().copysign(*c2));
        // A coefficient of 0 makes a root infinite, which lies outside.
        let inside = |s: f64| Some(s / inverse).filter(|t| *t > from && *t < to);
        let [a, b] = [q / (3.0 * c3), c1 / q];
        [inside(a.min(b)), inside(a.max(b))]
    }

    fn is_straight([_, c2, c3, _]: &One) -> bool {
        *c2 == 0.0 && *c3 == 0.0
    }

    fn are_straight(_: &DriftProcess) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::super::curve::{of_one, wide_arithmetic};
    use super::super::{VoltmeterModel, VoltmeterPreset};
    use super::*;

    const LENGTH: f64 = 4e5;

    /// `V` at `s`, and its slope in `s`. `V` is a cubic.
    fn signal(s: f64) -> [f64; 2] {
        [4.5 + 0.7 * s - 1.9 * s * s + 0.8 * s * s * s, 0.7 - 3.8 * s + 2.4 * s * s]
    }

    fn sensor(k5: f64) -> DriftProcess {
        let [k1, k2, ..] = VoltmeterPreset::Dvs346.k();
        DriftProcess::new(&VoltmeterModel::new([k1, k2, 0.0, 1e-5, k5, 0.0]))
    }

    /// The curve of [`signal`] over `[from, to]`, in units of `LENGTH`.
    fn piece(process: &DriftProcess, [from, to]: [f64; 2]) -> One {
        let knot = |s: f64| {
            let [log, slope] = signal(s);
            [libm::exp(log), slope / LENGTH]
        };
        of_one::<CubicDrift>(process, [knot(from), knot(to)], LENGTH * (to - from))
    }

    #[test]
    fn a_cubic_is_reproduced_wherever_it_is_cut() {
        let process = sensor(0.0);
        for cut in [[0.0, 1.0], [0.3, 0.4], [-2.0, 1.5], [0.9999, 1.0]] {
            let curve = piece(&process, cut);
            for i in 0..=20 {
                let s = cut[0] + (cut[1] - cut[0]) * f64::from(i) / 20.0;
                let t = (s - cut[0]) * LENGTH;
                let wanted = process.k1 * (signal(s)[0] - signal(cut[0])[0]) + process.k4 * t;
                let found = CubicDrift::rise_of_one(&curve, t);
                // V is at most about 20 and k1 is 5: a few ulp of 100.
                assert!((found - wanted).abs() < 5e-14, "{cut:?} {s}: {found} {wanted}");
                assert_eq!(wide_arithmetic::<CubicDrift>(&process, &curve, t)[0].to_bits(), found.to_bits());
            }
        }
    }

    #[test]
    fn the_leak_is_the_integral_of_the_brightness() {
        let process = sensor(1e-2);
        let quiet = sensor(0.0);
        // With finer steps, the leak over [0, 1] converges to its quadrature.
        let n = 2000;
        let weight = |i: i32| if i == 0 || i == n { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
        let brightness = |i: i32| libm::exp(signal(f64::from(i) / f64::from(n))[0]) - process.k2;
        let wanted = process.k5 * LENGTH / (3.0 * f64::from(n))
            * (0..=n).map(|i| weight(i) * brightness(i)).sum::<f64>();
        let error = |cuts: i32| {
            let part = |i: i32| {
                let cut = [i, i + 1].map(|i| f64::from(i) / f64::from(cuts));
                let end = LENGTH / f64::from(cuts);
                [&process, &quiet].map(|process| CubicDrift::rise_of_one(&piece(process, cut), end))
            };
            let found: f64 = (0..cuts).map(part).map(|[with, without]| with - without).sum();
            (found - wanted).abs() / wanted
        };
        let errors = [2, 4, 8, 16].map(error);
        println!("relative errors on halving: {errors:?}");
        // Simpson's rule is of order 4 in the step.
        assert!(errors.windows(2).all(|pair| pair[1] < pair[0] / 11.0) && errors[3] < 1e-6);
    }

    #[test]
    fn bounds_hold_and_turns_are_turns() {
        let process = sensor(1e-6);
        let curve = piece(&process, [-1.0, 2.0]);
        for [from, to] in [[0.0, 3.0], [0.2, 0.9], [1.4, 1.5]].map(|span| span.map(|s| s * LENGTH)) {
            let [a, b] = [from, to].map(|t| CubicDrift::rise_of_one(&curve, t));
            let stray = |i: i32| {
                let share = f64::from(i) / 1000.0;
                let t = from + (to - from) * share;
                (CubicDrift::rise_of_one(&curve, t) - a - (b - a) * share).abs()
            };
            let largest = (0..=1000).map(stray).fold(0.0, f64::max);
            let bound = CubicDrift::bulge_of_one(&curve, [from, to]);
            // Over a long span, the two parts of the bound may stray to opposite sides.
            let loose = if to - from < LENGTH { 4.0 } else { 10.0 };
            assert!(bound >= largest && bound < loose * largest, "{bound} {largest}");
        }
        let largest = (0..=1000).map(|i| 3e-3 * f64::from(i) * LENGTH).map(|t| {
            let h = 1.0;
            (CubicDrift::rate_of_one(&curve, t + h) - CubicDrift::rate_of_one(&curve, t - h)).abs()
                / (2.0 * h)
        });
        let curvature = wide_arithmetic::<CubicDrift>(&process, &curve, 3.0 * LENGTH)[1];
        assert!(curvature * (1.0 + 1e-5) >= largest.fold(0.0, f64::max));
        let turns = CubicDrift::turns_of_one(&curve, [0.0, 3.0 * LENGTH]).map(Option::unwrap);
        // The signal itself turns at s = 0.213 and 1.370, and the leak is weak.
        for (turn, s) in turns.into_iter().zip([0.213, 1.370]) {
            assert!((turn / LENGTH - 1.0 - s).abs() < 0.02, "{turn}");
            assert!(CubicDrift::rate_of_one(&curve, turn).abs() * LENGTH < 1e-13);
        }
    }
}
