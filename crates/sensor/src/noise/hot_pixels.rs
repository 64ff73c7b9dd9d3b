//! Hot pixels: a few pixels that fire independently of brightness.
//!
//! Their events are ON, as those of a strong leak are, and form an independent Poisson process. (In
//! v2e, hot pixels are the tail of the spread of leak rates. Here their share and rate are given.)
//!
//! The rates of hot pixels may differ. They are then log-normal around the median `rate`, with the
//! standard deviation `spread` in decades, as the leak rates of v2e are.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::Size;
//! use gs2e_num::seed::Seed;
//! use gs2e_sensor::noise::HotPixelNoise;
//!
//! // One pixel in a hundred makes 200 events per second: 2 per pixel on average.
//! let noise = HotPixelNoise { share: 0.01, rate: 200.0, spread: 0.0 };
//! assert!((noise.mean_hz() - 2.0).abs() < 1e-12);
//! // Each pixel is hot or silent.
//! let rates = noise.rates_hz(Seed(1), Size { width: 40, height: 30 });
//! assert_eq!(rates.len(), 1200);
//! assert!(rates.iter().all(|rate| *rate == 0.0 || (rate - 200.0).abs() < 1e-9));
//! ```

use super::PixelSite;
use super::poisson::PoissonTrain;
use crate::screening::{ScreenError, at_least_zero};
use gs2e_image::Size;
use gs2e_num::seed::{DrawSpace, Seed};
use serde::{Deserialize, Serialize};
use std::f64::consts::LN_10;

/// Share and rate of hot pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct HotPixelNoise {
    /// Share of the pixels, 0 to 1. Each pixel is hot with this probability.
    pub share: f64,
    /// Events per second of a hot pixel; the median if the rates differ.
    pub rate: f64,
    /// Standard deviation of the rates over the hot pixels, decades.
    #[serde(default, skip_serializing_if = "crate::is_default")]
    pub spread: f64,
}

impl HotPixelNoise {
    /// Returns true if there are no hot pixels.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        self.share == 0.0 || self.rate == 0.0
    }

    /// Checks share and rate.
    ///
    /// # Errors
    /// The share or the rate is outside its range.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        if !(0.0..=1.0).contains(&self.share) {
            let (name, wanted) = ("hot_pixels.share", "a number from 0 to 1");
            return Err(ScreenError::Parameter { name, found: self.share, wanted });
        }
        at_least_zero("hot_pixels.rate", self.rate)?;
        at_least_zero("hot_pixels.spread", self.spread)
    }

    /// Events per ns of the pixel at `site`, if it is hot.
    pub(crate) fn per_ns(&self, site: PixelSite) -> f64 {
        let median = self.rate * 1e-9;
        if self.spread == 0.0 {
            return median;
        }
        // The first two draws of index 0 belong to `train`.
        let mut draws = site.draws(DrawSpace::Hot, 0);
        draws.uniform();
        draws.uniform();
        median * libm::exp10(self.spread * draws.normal())
    }

    /// Events per second of a pixel, the mean over all pixels.
    #[must_use]
    pub fn mean_hz(&self) -> f64 {
        // The mean of a log-normal factor is `exp` of half the variance of its logarithm.
        let deviation = self.spread * LN_10;
        self.share * self.rate * libm::exp(0.5 * deviation * deviation)
    }

    /// The process of the pixel at `site`; without events if the pixel is not hot.
    pub(crate) fn train(&self, site: PixelSite) -> PoissonTrain {
        if self.is_hot(site) { PoissonTrain::new(site, DrawSpace::Hot) } else { PoissonTrain::silent() }
    }

    fn is_hot(&self, site: PixelSite) -> bool {
        // Draw 0 decides; the events have indices from 1, so both use the same purpose.
        !self.is_absent() && site.draws(DrawSpace::Hot, 0).uniform() < self.share
    }

    /// Rate of each pixel of a sensor with this seed, row after row, Hz: 0 for a pixel that is not hot. Empty
    /// if none is.
    #[must_use]
    pub fn rates_hz(&self, seed: Seed, size: Size) -> Vec<f64> {
        if self.is_absent() {
            return Vec::new();
        }
        let side = |n: u32| u16::try_from(n).unwrap_or(u16::MAX);
        let rows = 0..side(size.height);
        let sites = rows.flat_map(|y| (0..side(size.width)).map(move |x| PixelSite { seed, x, y }));
        sites.map(|site| if self.is_hot(site) { 1e9 * self.per_ns(site) } else { 0.0 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::poisson::LinearRate;
    use super::*;

    #[test]
    fn the_share_of_pixels_that_fire_is_as_stated() {
        let hot = HotPixelNoise { share: 0.02, rate: 1000.0, ..HotPixelNoise::default() };
        let fires = |i: u16| {
            let site = PixelSite { seed: Seed(1), x: i % 250, y: i / 250 };
            let rates = LinearRate { ends: [hot.per_ns(site); 2], length: 1e9 };
            hot.train(site).advance(&rates, 0.0).is_some()
        };
        let count = (0..50_000).filter(|i| fires(*i)).count() as f64;
        let z = (count - 1000.0) / (1000.0f64 * 0.98).sqrt();
        println!("{count} of 50000 are hot, z {z:.2} (limit 4.5)");
        assert!(z.abs() < 4.5);
        let unequal = HotPixelNoise { spread: 0.5, ..hot };
        let decades: Vec<f64> = (0..20_000u16)
            .map(|i| unequal.per_ns(PixelSite { seed: Seed(1), x: i % 250, y: i / 250 }) * 1e6)
            .map(libm::log10)
            .collect();
        let cdf = |decades: f64| 0.5 * libm::erfc(-decades / (0.5 * std::f64::consts::SQRT_2));
        let distance = gs2e_num::seed::ks::scaled_distance(decades, cdf);
        println!("KS of the logarithms of the rates {distance:.2} (alpha 1e-4: 2.23)");
        assert!(distance < 2.23 && (unequal.mean_hz() / hot.mean_hz() - 1.940).abs() < 1e-3);
        assert!(
            HotPixelNoise { rate: 5.0, ..HotPixelNoise::default() }.is_absent()
                && HotPixelNoise::default().is_absent()
        );
    }
}
