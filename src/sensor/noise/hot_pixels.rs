//! Hot pixels: a few pixels that fire independently of brightness.
//!
//! Their events are ON, as those of a strong leak are, and form an independent Poisson process. (In
//! v2e, hot pixels are the tail of the spread of leak rates. Here their share and rate are given.)

use super::PixelSite;
use super::poisson::PoissonTrain;
use crate::seed::DrawSpace;
use crate::sensor::screening::{ScreenError, at_least_zero};
use serde::{Deserialize, Serialize};

/// Share and rate of hot pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct HotPixelNoise {
    /// Share of the pixels, 0 to 1. Each pixel is hot with this probability.
    pub share: f64,
    /// Events per second of a hot pixel.
    pub rate: f64,
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
    pub(in crate::sensor) fn validate(&self) -> Result<(), ScreenError> {
        if !(0.0..=1.0).contains(&self.share) {
            let (name, wanted) = ("hot_pixels.share", "a number from 0 to 1");
            return Err(ScreenError::Parameter { name, found: self.share, wanted });
        }
        at_least_zero("hot_pixels.rate", self.rate)
    }

    /// Events per ns of a hot pixel.
    pub(in crate::sensor) fn per_ns(&self) -> f64 {
        self.rate * 1e-9
    }

    /// The process of the pixel at `site`; without events if the pixel is not hot.
    pub(in crate::sensor) fn train(&self, site: PixelSite) -> PoissonTrain {
        // Draw 0 decides; the events have indices from 1, so both use the same purpose.
        if self.is_absent() || site.draws(DrawSpace::Hot, 0).uniform() >= self.share {
            return PoissonTrain::silent();
        }
        PoissonTrain::new(site, DrawSpace::Hot)
    }
}

#[cfg(test)]
mod tests {
    use super::super::poisson::LinearRate;
    use super::*;
    use crate::seed::Seed;

    #[test]
    fn the_share_of_pixels_that_fire_is_as_stated() {
        let hot = HotPixelNoise { share: 0.02, rate: 1000.0 };
        let rates = LinearRate { ends: [hot.per_ns(); 2], length: 1e9 };
        let fires = |i: u16| {
            let site = PixelSite { seed: Seed(1), x: i % 250, y: i / 250 };
            hot.train(site).advance(&rates, 0.0).is_some()
        };
        let count = (0..50_000).filter(|i| fires(*i)).count() as f64;
        let z = (count - 1000.0) / (1000.0f64 * 0.98).sqrt();
        println!("{count} of 50000 are hot, z {z:.2} (limit 4.5)");
        assert!(z.abs() < 4.5);
        assert!(HotPixelNoise { share: 0.0, rate: 5.0 }.is_absent() && HotPixelNoise::default().is_absent());
    }
}
