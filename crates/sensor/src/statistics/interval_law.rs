//! The law of the time between events of a pixel of constant brightness: the first exit of a
//! Brownian motion with drift from an interval, as a sum over mirror images.

use std::f64::consts::{PI, SQRT_2};

/// Drift and variance per unit time, and the distances of both barriers.
#[derive(Debug, Clone, Copy)]
pub struct BarrierExit {
    /// Drift.
    pub drift: f64,
    /// Variance.
    pub variance: f64,
    /// Distance of the upper barrier.
    pub up: f64,
    /// Distance of the lower one.
    pub down: f64,
}

impl BarrierExit {
    /// Probability of an exit by `t`.
    #[must_use]
    pub fn by(self, t: f64) -> f64 {
        // The lower barrier is the upper one of the mirrored motion.
        let mirrored = Self { drift: -self.drift, up: self.down, down: self.up, ..self };
        self.upward_by(t) + mirrored.upward_by(t)
    }

    /// Probability of an exit by `t` through the upper barrier.
    #[must_use]
    pub fn upward_by(self, t: f64) -> f64 {
        let Self { drift, variance, up, down } = self;
        let (m, root) = (drift.abs(), (variance * t).sqrt());
        let term = |k: i32| {
            let d = up + f64::from(2 * k) * (up + down);
            let lead = drift * up / variance;
            let tilt = m * d.abs() / variance;
            // Logarithms are added first: the factors alone overflow and underflow.
            let toward = libm::exp(lead - tilt + log_phi((m * t - d.abs()) / root));
            let away = libm::exp(lead + tilt + log_phi((-m * t - d.abs()) / root));
            d.signum() * (toward + away)
        };
        // Images beyond the 12th are farther away than the motion reaches in ten mean intervals.
        (-12..=12).map(term).sum()
    }
}

/// Logarithm of the normal distribution function.
fn log_phi(x: f64) -> f64 {
    if x > -10.0 {
        return libm::log(0.5 * libm::erfc(-x / SQRT_2));
    }
    // Asymptotic series: the next term is 15/x^6, 1.5e-5 at the border, where the function itself
    // is below e^-50.
    -0.5 * x * x - libm::log(-x * (2.0 * PI).sqrt()) + libm::log(1.0 - 1.0 / (x * x) + 3.0 / (x * x * x * x))
}
