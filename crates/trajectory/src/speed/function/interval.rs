//! Interval arithmetic: bounds on a value from bounds on its operands, rounded outwards.
//!
//! Operations that IEEE 754 rounds correctly (`+ - * / sqrt`) are widened by one unit in the last
//! place on both sides; `libm`'s functions, with errors under one unit, by four. The bounds
//! therefore hold for the real value (of the expression in the doubles nearest its constants) and
//! for the value that `f64` evaluation gives.

use super::{BinaryOperator, UnaryFunction};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// All values from `low` to `high`, both finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ValueInterval {
    pub(super) low: f64,
    pub(super) high: f64,
}

/// Number of units in the last place by which `libm`'s results are widened.
const LIBM_ULPS: u32 = 4;
/// Largest argument of sine, cosine and tangent. Beyond it, an extremum cannot be located to 1e-6.
const MAX_ANGLE: f64 = 1e9;
/// Margin around extrema, relative to 1 + the argument. It covers the rounding of a multiple of pi.
const ANGLE_MARGIN: f64 = 1e-14;

impl ValueInterval {
    pub(super) fn single_value(value: f64) -> Self {
        Self { low: value, high: value }
    }

    /// The hull of `values`, widened by `ulps` on both sides; `None` if a bound is infinite or NaN.
    fn hull_of(values: &[f64], ulps: u32) -> Option<Self> {
        if !values.iter().all(|v| v.is_finite()) {
            return None;
        }
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let widened = Self {
            low: (0..ulps).fold(low, |x, _| x.next_down()),
            high: (0..ulps).fold(high, |x, _| x.next_up()),
        };
        (widened.low.is_finite() && widened.high.is_finite()).then_some(widened)
    }

    pub(super) fn negated(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }

    /// Bounds of `op`; `None` if the result may be undefined or has no finite bounds.
    pub(super) fn binary_bounds(op: BinaryOperator, a: Self, b: Self) -> Option<Self> {
        let corners =
            |f: fn(f64, f64) -> f64| [f(a.low, b.low), f(a.low, b.high), f(a.high, b.low), f(a.high, b.high)];
        match op {
            BinaryOperator::Add => Self::hull_of(&[a.low + b.low, a.high + b.high], 1),
            BinaryOperator::Subtract => Self::hull_of(&[a.low - b.high, a.high - b.low], 1),
            // Monotonic in each operand while the other stays, so the extremes are at corners.
            BinaryOperator::Multiply => Self::hull_of(&corners(|x, y| x * y), 1),
            BinaryOperator::Divide if b.low <= 0.0 && b.high >= 0.0 => None,
            BinaryOperator::Divide => Self::hull_of(&corners(|x, y| x / y), 1),
            // On a positive base, the power is monotonic in base and exponent, rising or falling.
            BinaryOperator::Power if a.low > 0.0 || (a.low >= 0.0 && b.low > 0.0) => {
                Self::hull_of(&corners(libm::pow), LIBM_ULPS)
            }
            BinaryOperator::Power => None,
            // Minimum and maximum are exact, so nothing is widened.
            BinaryOperator::Min => Some(Self { low: a.low.min(b.low), high: a.high.min(b.high) }),
            BinaryOperator::Max => Some(Self { low: a.low.max(b.low), high: a.high.max(b.high) }),
        }
    }

    /// Bounds of a power with a constant integer exponent. The base may have any sign.
    pub(super) fn whole_power(self, exponent: f64) -> Option<Self> {
        let ends = [libm::pow(self.low, exponent), libm::pow(self.high, exponent)];
        let holds_zero = self.low <= 0.0 && self.high >= 0.0;
        if holds_zero && exponent < 0.0 {
            return None;
        }
        let even = exponent % 2.0 == 0.0;
        // An even power of an interval around zero is smallest inside it, not at an end.
        match Self::hull_of(&ends, LIBM_ULPS)? {
            hull if even && holds_zero && exponent > 0.0 => Some(Self { low: 0.0, ..hull }),
            // Widening may reach below 0, which no even power does.
            hull if even => Some(Self { low: hull.low.max(0.0), ..hull }),
            hull => Some(hull),
        }
    }

    /// Bounds of a function; `None` if it may be undefined or has no finite bounds.
    pub(super) fn call_bounds(f: UnaryFunction, a: Self) -> Option<Self> {
        let ends = |f: fn(f64) -> f64, ulps| Self::hull_of(&[f(a.low), f(a.high)], ulps);
        match f {
            UnaryFunction::Sin => a.wave(libm::sin, FRAC_PI_2),
            UnaryFunction::Cos => a.wave(libm::cos, 0.0),
            UnaryFunction::Tan if a.holds(FRAC_PI_2, PI) => None,
            // Between two poles the tangent rises, so its ends bound it.
            UnaryFunction::Tan => ends(libm::tan, LIBM_ULPS),
            UnaryFunction::Exp => ends(libm::exp, LIBM_ULPS),
            UnaryFunction::Log if a.low <= 0.0 => None,
            UnaryFunction::Log => ends(libm::log, LIBM_ULPS),
            UnaryFunction::Sqrt if a.low < 0.0 => None,
            UnaryFunction::Sqrt => ends(f64::sqrt, 1).map(|r| Self { low: r.low.max(0.0), ..r }),
            UnaryFunction::Abs if a.low <= 0.0 && a.high >= 0.0 => {
                Some(Self { low: 0.0, high: a.high.max(-a.low) })
            }
            UnaryFunction::Abs => ends(f64::abs, 0),
        }
    }

    /// Bounds of a sine or cosine with maxima at `crest` plus whole turns.
    fn wave(self, f: fn(f64) -> f64, crest: f64) -> Option<Self> {
        let mut bounds = Self::hull_of(&[f(self.low), f(self.high)], LIBM_ULPS)?;
        if self.holds(crest, TAU) {
            bounds.high = 1.0;
        }
        if self.holds(crest + PI, TAU) {
            bounds.low = -1.0;
        }
        // Widening may leave the range of a sine, which is known exactly.
        Some(Self { low: bounds.low.max(-1.0), high: bounds.high.min(1.0) })
    }

    /// Returns true if `phase + k * period` may lie inside for some integer `k`.
    fn holds(self, phase: f64, period: f64) -> bool {
        let largest = self.low.abs().max(self.high.abs());
        if largest > MAX_ANGLE {
            return true;
        }
        let margin = ANGLE_MARGIN * (1.0 + largest);
        let next = ((self.low - margin - phase) / period).ceil() * period + phase;
        // The previous period is tested as well: the quotient may have rounded up past an integer.
        next <= self.high + margin || next - period >= self.low - margin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FUNCTIONS: [UnaryFunction; 7] = [
        UnaryFunction::Sin,
        UnaryFunction::Cos,
        UnaryFunction::Tan,
        UnaryFunction::Exp,
        UnaryFunction::Log,
        UnaryFunction::Sqrt,
        UnaryFunction::Abs,
    ];
    const BINARY: [BinaryOperator; 7] = [
        BinaryOperator::Add,
        BinaryOperator::Subtract,
        BinaryOperator::Multiply,
        BinaryOperator::Divide,
        BinaryOperator::Power,
        BinaryOperator::Min,
        BinaryOperator::Max,
    ];

    fn interval() -> impl Strategy<Value = ValueInterval> {
        let scale = prop_oneof![Just(1e-9), Just(0.1), Just(1.0), Just(30.0), Just(1e5)];
        (-1.0..1.0f64, 0.0..1.0f64, scale.clone(), scale)
            .prop_map(|(low, width, a, b)| ValueInterval { low: low * a, high: low * a + width * b })
    }

    /// The value lies within `bounds`, if there are any. Without bounds, nothing is claimed.
    fn check(bounds: Option<ValueInterval>, value: f64) -> Result<(), TestCaseError> {
        if let Some(b) = bounds {
            prop_assert!(b.low <= value && value <= b.high, "{value} outside {b:?}");
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn values_lie_within_their_bounds(a in interval(), b in interval(), x in 0.0..=1.0f64, y in 0.0..=1.0f64) {
            let inside = |i: ValueInterval, share: f64| (i.low + (i.high - i.low) * share).clamp(i.low, i.high);
            let (p, q) = (inside(a, x), inside(b, y));
            for f in FUNCTIONS {
                check(ValueInterval::call_bounds(f, a), f.value(p))?;
            }
            for op in BINARY {
                check(ValueInterval::binary_bounds(op, a, b), op.value(p, q))?;
            }
            for exponent in [-3.0, -2.0, 0.0, 1.0, 2.0, 3.0, 4.0] {
                check(a.whole_power(exponent), libm::pow(p, exponent))?;
            }
        }
    }

    #[test]
    fn waves_reach_their_extrema_inside_an_interval() {
        let t = |f, low: f64, high: f64, want: [f64; 2]| {
            let got = ValueInterval::call_bounds(f, ValueInterval { low, high }).unwrap();
            assert!(
                (got.low - want[0]).abs() < 1e-12 && (got.high - want[1]).abs() < 1e-12,
                "{low} {high} {got:?}"
            );
        };
        t(UnaryFunction::Sin, 0.0, 1.0, [0.0, 1.0f64.sin()]);
        t(UnaryFunction::Sin, 1.0, 2.0, [1.0f64.sin(), 1.0]);
        t(UnaryFunction::Sin, -2.0, -1.0, [-1.0, (-1.0f64).sin()]);
        t(UnaryFunction::Sin, 7.0, 14.0, [-1.0, 1.0]);
        t(UnaryFunction::Cos, -1.0, 1.0, [1.0f64.cos(), 1.0]);
        t(UnaryFunction::Cos, 3.0, 4.0, [-1.0, 4.0f64.cos()]);
        t(UnaryFunction::Cos, 1.0, 2.0, [2.0f64.cos(), 1.0f64.cos()]);
    }
}
