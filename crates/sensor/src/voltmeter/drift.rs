//! The drift-diffusion process `D = k1 ln(L + k2) + integral of (k4 + k5 L)` with noise `sigma(L)`,
//! in nanoseconds.

use super::bridge::Barriers;
use super::{DriftGain, VoltmeterModel};
use crate::statistics::RenewalProcess;
use fearless_simd::{Simd, SimdBase as _, SimdFloat as _, f64x8};

/// Microseconds in a nanosecond.
const US: f64 = 1e-3;

/// The process with time in nanoseconds and brightness in grey 0..255.
#[derive(Debug, Clone, Copy)]
pub(super) struct DriftProcess {
    pub(super) k1: f64,
    pub(super) k2: f64,
    k3: f64,
    pub(super) k4: f64,
    pub(super) k5: f64,
    k6: f64,
    pub(super) gain: DriftGain,
    /// True if the photoreceptor has noise.
    receptor: bool,
}

impl DriftProcess {
    pub(super) fn new(sensor: &VoltmeterModel) -> Self {
        let [k1, k2, k3, k4, k5, k6] = sensor.k;
        // Noise grows with the square root of time, so its coefficients convert by the root of the
        // unit.
        let root = US.sqrt();
        Self {
            k1,
            k2,
            k3: k3 * root,
            k4: k4 * US,
            k5: k5 * US,
            k6: k6 * root,
            gain: sensor.gain,
            receptor: !sensor.photoreceptor_noise.is_absent(),
        }
    }

    /// Returns true if there is no noise at any brightness.
    pub(super) fn is_noiseless(&self) -> bool {
        !(self.is_brownian() || self.receptor)
    }

    /// Returns true if the voltage is a Brownian motion at any brightness.
    pub(super) fn is_brownian(&self) -> bool {
        self.k3 != 0.0 || self.k6 != 0.0
    }

    /// Standard deviation of the noise per square root of a nanosecond, where `L + k2` is `level`.
    #[inline(always)]
    pub(super) fn sigma<S: Simd>(&self, level: f64x8<S>) -> f64x8<S> {
        // `level` is a sum with `k2`. Rounding may put a black pixel below 0, and the root would be
        // NaN.
        let luminance = (level - self.k2).max(0.0);
        luminance.sqrt() * self.k3 / (luminance + self.k2) + self.k6
    }

    /// [`DriftProcess::sigma`] of one grey.
    pub(super) fn sigma_of_one(&self, luminance: f64) -> f64 {
        self.k3 * luminance.sqrt() / (luminance + self.k2) + self.k6
    }

    /// Drift per nanosecond between two greys that are `length` ns apart, by the midpoint form.
    pub(super) fn midpoint_drift(&self, greys: [f64; 2], length: f64) -> f64 {
        let [from, to] = greys.map(|grey| grey + self.k2);
        let middle = 0.5 * (from + to);
        let signal = self.k1 * (to - from) / middle * (1.0 / length);
        signal + self.k4 + self.k5 * (middle - self.k2)
    }

    /// The process at a pixel of constant grey, per nanosecond.
    pub(super) fn at_rest(&self, luminance: f64, barriers: Barriers) -> RenewalProcess {
        let sigma = self.sigma_of_one(luminance);
        let Barriers { up, down } = barriers;
        RenewalProcess { drift: self.k4 + self.k5 * luminance, variance: sigma * sigma, up, down }
    }
}
