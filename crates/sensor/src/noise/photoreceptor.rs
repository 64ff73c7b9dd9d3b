//! Noise of the photoreceptor: a voltage of limited bandwidth that is added to the signal of a pixel.
//!
//! It is an Ornstein-Uhlenbeck process, `du = -theta u dt + deviation sqrt(2 theta) dW` with `theta = 2 pi
//! cutoff`: white noise behind a low-pass of first order, which is what the noise of the photoreceptor
//! becomes behind its bandwidth (`--photoreceptor_noise` of v2e; Graça and Delbruck, arXiv 2505.07386).
//! Unlike a Brownian motion, it returns: an excursion that makes an ON event makes an OFF event on its way
//! back. A table gives deviation and cutoff by light, and the amplitude of each pixel has a log-normal
//! factor.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::noise::{PhotoreceptorNoise, ReceptorPoint};
//!
//! let point = |lux, deviation, cutoff_hz| ReceptorPoint { lux, deviation, cutoff_hz };
//! let points = vec![point(1.0, 0.04, 10.0), point(100.0, 0.02, 1000.0)];
//! let noise = PhotoreceptorNoise { spread: 0.35, points };
//! // Halfway between 1 and 100 lux on a logarithmic axis is 10 lux.
//! let middle = noise.at(10.0);
//! assert!((middle.cutoff_hz - 100.0).abs() < 1e-9);
//! // Outside the table, the nearest point holds.
//! assert_eq!(noise.at(1e4).deviation, 0.02);
//! ```

use super::PixelSite;
use super::grey_table::between_lights;
use crate::WHITE;
use crate::screening::{ScreenError, at_least_zero};
use gs2e_num::seed::DrawSpace;
use serde::{Deserialize, Serialize};

/// Noise of the photoreceptor against light.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PhotoreceptorNoise {
    /// Standard deviation of the logarithm of a pixel's amplitude over the pixels.
    #[serde(default)]
    pub spread: f64,
    /// Points at rising lights. Between two, logarithms are linear in the logarithm of the light.
    pub points: Vec<ReceptorPoint>,
}

/// Noise of the photoreceptor at one light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReceptorPoint {
    /// Light on the sensor, lux.
    pub lux: f64,
    /// Standard deviation at the median pixel, as a contrast.
    pub deviation: f64,
    /// Bandwidth: the frequency at which the spectrum has fallen to a half.
    pub cutoff_hz: f64,
}

/// Largest bandwidth. Cells of the clock must be short beside the time in which the noise returns.
pub const MAX_CUTOFF_HZ: f64 = 20_000.0;
/// Largest spread: one pixel in 10,000 then has 40 times the median amplitude.
pub const MAX_SPREAD: f64 = 1.0;

impl PhotoreceptorNoise {
    /// Returns true if there is no such noise at any light.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        self.points.iter().all(|point| point.deviation == 0.0)
    }

    /// The noise at a light, lux.
    #[must_use]
    pub fn at(&self, lux: f64) -> ReceptorPoint {
        let values = |point: &ReceptorPoint| [point.deviation, point.cutoff_hz];
        let [deviation, cutoff_hz] = between_lights(&self.points, lux, |point| point.lux, values);
        ReceptorPoint { lux, deviation, cutoff_hz }
    }

    /// [`PhotoreceptorNoise::at`] a grey, where white is `white_lux`.
    #[must_use]
    pub fn at_grey(&self, grey: f64, white_lux: f64) -> ReceptorPoint {
        self.at(white_lux * grey / WHITE)
    }

    /// Returns true if the noise depends on the light.
    #[must_use]
    pub fn follows_light(&self) -> bool {
        self.points.len() > 1
    }

    /// The factor of the amplitude of the pixel at `site`.
    pub(crate) fn amplitude(&self, site: PixelSite) -> f64 {
        /// Behind the two draws of the thresholds.
        const DRAW: u32 = 2;
        let PixelSite { seed, x, y } = site;
        let cell = gs2e_num::seed::SeedCell { x, y, level: 0, index: 0 };
        libm::exp(self.spread * seed.normal(cell, DrawSpace::Mismatch, DRAW))
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number is outside its range, or the lights do not rise.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        at_least_zero("photoreceptor_noise.spread", self.spread)?;
        if self.spread > MAX_SPREAD {
            let wanted = "at most 1";
            return Err(ScreenError::Parameter {
                name: "photoreceptor_noise.spread",
                found: self.spread,
                wanted,
            });
        }
        for ReceptorPoint { lux, deviation, cutoff_hz } in &self.points {
            at_least_zero("photoreceptor_noise.deviation", *deviation)?;
            let above_zero = "a finite number above 0";
            for (name, found, most, wanted) in [
                ("photoreceptor_noise.lux", *lux, f64::MAX, above_zero),
                ("photoreceptor_noise.cutoff_hz", *cutoff_hz, MAX_CUTOFF_HZ, "above 0 and at most 20000"),
            ] {
                if !(found > 0.0 && found <= most) {
                    return Err(ScreenError::Parameter { name, found, wanted });
                }
            }
        }
        if self.points.is_sorted_by(|before, after| before.lux < after.lux) {
            return Ok(());
        }
        Err(ScreenError::Combination("the lights of `photoreceptor_noise` must rise from point to point"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(points: &[[f64; 3]]) -> PhotoreceptorNoise {
        let point = |&[lux, deviation, cutoff_hz]: &[f64; 3]| ReceptorPoint { lux, deviation, cutoff_hz };
        PhotoreceptorNoise { spread: 0.0, points: points.iter().map(point).collect() }
    }

    #[test]
    fn numbers_outside_their_ranges_are_named() {
        let t = |noise: PhotoreceptorNoise, message: &str| {
            assert_eq!(noise.validate().unwrap_err().to_string(), message);
        };
        t(
            noise(&[[1.0, -0.1, 5.0]]),
            "photoreceptor_noise.deviation is -0.1, not a finite number of at least 0",
        );
        t(noise(&[[0.0, 0.1, 5.0]]), "photoreceptor_noise.lux is 0, not a finite number above 0");
        t(noise(&[[1.0, 0.1, 3e4]]), "photoreceptor_noise.cutoff_hz is 30000, not above 0 and at most 20000");
        t(
            noise(&[[2.0, 0.1, 5.0], [1.0, 0.1, 5.0]]),
            "the lights of `photoreceptor_noise` must rise from point to point",
        );
        t(
            PhotoreceptorNoise { spread: 1.5, points: Vec::new() },
            "photoreceptor_noise.spread is 1.5, not at most 1",
        );
        assert!(noise(&[]).is_absent() && noise(&[]).validate().is_ok());
    }

    #[test]
    fn amplitudes_are_log_normal_with_a_median_of_one() {
        let noise = PhotoreceptorNoise { spread: 0.35, points: Vec::new() };
        let site = |i: u16| PixelSite { seed: gs2e_num::seed::Seed(5), x: i % 200, y: i / 200 };
        let logs: Vec<f64> = (0..20_000).map(|i| libm::log(noise.amplitude(site(i)))).collect();
        let cdf = |t: f64| 0.5 * libm::erfc(-t / (0.35 * std::f64::consts::SQRT_2));
        let distance = gs2e_num::seed::ks::scaled_distance(logs, cdf);
        println!("KS {distance:.2} (alpha 1e-4: 2.23)");
        assert!(distance < 2.23);
    }
}
