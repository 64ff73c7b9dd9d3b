//! Values with their derivative in time: forward-mode differentiation by dual numbers.
//!
//! Every operation carries the exact derivative of what it does, so that a rendering in these numbers is a rendering
//! and its derivative, with no formula for the derivative written down.

use crate::scene::sh::Scalar;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its rate. Comparisons see the value alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dual {
    pub(super) value: f64,
    pub(super) rate: f64,
}

impl Dual {
    pub(super) fn constant(value: f64) -> Self {
        Self { value, rate: 0.0 }
    }

    pub(super) fn squared(self) -> Self {
        self * self
    }

    /// The root of a positive value.
    pub(super) fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, rate: self.rate / (2.0 * value) }
    }

    pub(super) fn exp(self) -> Self {
        let value = libm::exp(self.value);
        Self { value, rate: self.rate * value }
    }

    /// Within bounds; at one of them it stands still.
    pub(super) fn clamp(self, low: f64, high: f64) -> Self {
        let value = self.value.clamp(low, high);
        let inside = low < self.value && self.value < high;
        Self { value, rate: if inside { self.rate } else { 0.0 } }
    }
}

impl Add for Dual {
    type Output = Self;

    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, rate: self.rate + o.rate }
    }
}

impl Sub for Dual {
    type Output = Self;

    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, rate: self.rate - o.rate }
    }
}

impl Mul for Dual {
    type Output = Self;

    fn mul(self, o: Self) -> Self {
        Self { value: self.value * o.value, rate: self.rate * o.value + self.value * o.rate }
    }
}

impl Div for Dual {
    type Output = Self;

    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Self { value, rate: (self.rate - value * o.rate) / o.value }
    }
}

impl Neg for Dual {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, rate: -self.rate }
    }
}

impl PartialEq for Dual {
    fn eq(&self, o: &Self) -> bool {
        self.value == o.value
    }
}

impl PartialOrd for Dual {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&o.value)
    }
}

impl Scalar for Dual {
    fn nearest(x: f64) -> Self {
        Self::constant(x)
    }
}

/// The scalar product.
pub(super) fn dot(a: [Dual; 3], b: [Dual; 3]) -> Dual {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
pub(super) fn cross(a: [Dual; 3], b: [Dual; 3]) -> [Dual; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_derivatives() {
        let t = |f: fn(Dual) -> Dual, x: f64| {
            let h = 1e-6;
            let at = |x: f64| f(Dual { value: x, rate: 1.0 });
            let difference = (at(x + h).value - at(x - h).value) / (2.0 * h);
            // h^2/6 of a third derivative up to 100, and roundings of 1e-16 over h.
            assert!((at(x).rate - difference).abs() < 1e-9 * difference.abs().max(1.0), "{x}: {:?}", at(x));
        };
        t(|x| x * x * x - x, 1.3);
        t(|x| Dual::constant(1.0) / (x + Dual::constant(2.0)), 0.4);
        t(|x| (x.squared() + Dual::constant(1.0)).sqrt(), -0.7);
        t(|x| (-x.squared()).exp(), 0.9);
        t(|x| x.clamp(0.0, 1.0) * x, 0.5);
        t(|x| x.clamp(0.0, 1.0) * x, 1.5);
    }
}
