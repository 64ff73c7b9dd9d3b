//! Dual numbers: values with their derivative in time, for forward-mode differentiation.
//!
//! Every operation computes the exact derivative of its result next to the value. The value's bits
//! are those of the same operation on plain numbers. Code written over [`RealNumber`] is therefore
//! both a computation and its derivative, without a second formula.
//!
//! Everything is inlined into loops over many Gaussians, which are compiled for each instruction
//! set.

use gs2e_scene::sh::Scalar;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number, or a number with its rate.
pub(super) trait RealNumber: Scalar + Div<Output = Self> + Neg<Output = Self> + PartialOrd {
    /// The type of the plain number.
    type Plain: Copy;

    /// A number with its rate. A plain number drops the rate.
    fn with_rate(value: Self::Plain, rate: Self::Plain) -> Self;

    /// The plain number.
    fn value(self) -> Self::Plain;

    /// The rate; 0 for a plain number.
    fn rate(self) -> Self::Plain;

    /// The square root of a positive value.
    fn sqrt(self) -> Self;

    /// A constant.
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self::nearest(value)
    }

    /// The square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }

    /// The larger of two; of equal values, the second.
    fn at_least(self, least: Self) -> Self;
}

macro_rules! plain {
    ($($t:ty)+) => {$(
        impl RealNumber for $t {
            type Plain = Self;

            #[inline(always)]
            fn with_rate(value: Self, _: Self) -> Self {
                value
            }

            #[inline(always)]
            fn value(self) -> Self {
                self
            }

            #[inline(always)]
            fn rate(self) -> Self {
                0.0
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }

            #[inline(always)]
            fn at_least(self, least: Self) -> Self {
                // The same selection as for dual numbers, not `max`: with and without rates, the
                // values have the same bits.
                if self > least { self } else { least }
            }
        }
    )+};
}
plain!(f32 f64);

/// A value and its rate. Comparisons use the value only.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DualNumber<T> {
    pub(super) value: T,
    pub(super) rate: T,
}

impl<T: RealNumber<Plain = T>> RealNumber for DualNumber<T> {
    type Plain = T;

    #[inline(always)]
    fn with_rate(value: T, rate: T) -> Self {
        Self { value, rate }
    }

    #[inline(always)]
    fn value(self) -> T {
        self.value
    }

    #[inline(always)]
    fn rate(self) -> T {
        self.rate
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, rate: self.rate / (value + value) }
    }

    #[inline(always)]
    fn at_least(self, least: Self) -> Self {
        let more = self.value > least.value;
        // Value and rate are selected separately: a selection between pairs prevents vectorisation.
        Self {
            value: if more { self.value } else { least.value },
            rate: if more { self.rate } else { least.rate },
        }
    }
}

impl DualNumber<f64> {
    /// The exponential function.
    #[inline(always)]
    pub(super) fn exponential(self) -> Self {
        let value = libm::exp(self.value);
        Self { value, rate: self.rate * value }
    }

    /// The value clamped to bounds. At a bound, its rate is 0.
    #[inline(always)]
    pub(super) fn clamp(self, low: f64, high: f64) -> Self {
        let value = self.value.clamp(low, high);
        let inside = low < self.value && self.value < high;
        Self { value, rate: if inside { self.rate } else { 0.0 } }
    }
}

impl<T: RealNumber<Plain = T>> Add for DualNumber<T> {
    type Output = Self;

    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, rate: self.rate + o.rate }
    }
}

impl<T: RealNumber<Plain = T>> Sub for DualNumber<T> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, rate: self.rate - o.rate }
    }
}

impl<T: RealNumber<Plain = T>> Mul for DualNumber<T> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self { value: self.value * o.value, rate: self.rate * o.value + self.value * o.rate }
    }
}

impl<T: RealNumber<Plain = T>> Div for DualNumber<T> {
    type Output = Self;

    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        // Written with the quotient, because the square of the divisor could overflow.
        Self { value, rate: (self.rate - value * o.rate) / o.value }
    }
}

impl<T: RealNumber<Plain = T>> Neg for DualNumber<T> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, rate: -self.rate }
    }
}

impl<T: PartialEq> PartialEq for DualNumber<T> {
    #[inline(always)]
    fn eq(&self, o: &Self) -> bool {
        self.value == o.value
    }
}

impl<T: PartialOrd> PartialOrd for DualNumber<T> {
    #[inline(always)]
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&o.value)
    }
}

impl<T: RealNumber<Plain = T>> Scalar for DualNumber<T> {
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        Self { value: T::nearest(x), rate: T::nearest(0.0) }
    }
}

/// The scalar product of two vectors.
#[inline(always)]
pub(super) fn dot_product<S: RealNumber>(a: [S; 3], b: [S; 3]) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product of two vectors.
#[inline(always)]
pub(super) fn cross_product<S: RealNumber>(a: [S; 3], b: [S; 3]) -> [S; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    type D = DualNumber<f64>;

    #[test]
    fn rates_are_derivatives() {
        let t = |f: fn(D) -> D, x: f64| {
            let h = 1e-6;
            let at = |x: f64| f(D { value: x, rate: 1.0 });
            let difference = (at(x + h).value - at(x - h).value) / (2.0 * h);
            // h^2/6 of a third derivative up to 100, and rounding of 1e-16 over h.
            assert!((at(x).rate - difference).abs() < 1e-9 * difference.abs().max(1.0), "{x}: {:?}", at(x));
        };
        t(|x| x * x * x - x, 1.3);
        t(|x| D::constant(1.0) / (x + D::constant(2.0)), 0.4);
        t(|x| (x.squared() + D::constant(1.0)).sqrt(), -0.7);
        t(|x| (-x.squared()).exponential(), 0.9);
        t(|x| x.clamp(0.0, 1.0) * x, 0.5);
        t(|x| x.clamp(0.0, 1.0) * x, 1.5);
        t(|x| x.at_least(D::constant(1.0)) * x, 0.5);
        t(|x| x.at_least(D::constant(1.0)) * x, 1.5);
    }
}
