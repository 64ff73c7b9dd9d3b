//! Imperfections of pixels that several sensor models share. Each draw belongs to the pixel's
//! position on the sensor and to the index of a frame or event, so crops and threads do not change
//! it.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::esim::EsimModel;
//! use gs2e_sensor::noise::{HotPixelNoise, ReferenceRule, RefractoryPeriod};
//! use gs2e_sensor::{SensorChoice, SensorSettings};
//!
//! let hot_pixels = HotPixelNoise { share: 0.01, rate: 100.0, spread: 0.0 };
//! let refractory = RefractoryPeriod { period_us: 50.0, reference: ReferenceRule::Passing };
//! let settings = SensorSettings { hot_pixels, refractory, ..SensorSettings::default() };
//! let sensor = SensorChoice::from(EsimModel { settings, ..EsimModel::default() });
//! assert!(sensor.has_noise());
//! // The dead time makes no event, so it is no noise.
//! let quiet = sensor.without_noise();
//! assert!(!quiet.has_noise() && quiet.hot_pixels().is_absent());
//! assert_eq!(quiet.dead_us(), 50);
//! ```

pub mod floor;
pub(super) mod grey_table;
pub mod hot_pixels;
pub mod mismatch;
pub mod photoreceptor;
pub(super) mod poisson;
pub mod refractory;

pub use floor::{FloorPoint, NoiseFloor};
pub use hot_pixels::HotPixelNoise;
pub use mismatch::{RedrawRule, ThresholdMismatch};
pub use photoreceptor::{PhotoreceptorNoise, ReceptorPoint};
pub use refractory::{ReferenceRule, RefractoryPeriod};

use gs2e_num::seed::{CellDraws, DrawSpace, Seed, SeedCell};

/// A pixel's position on the sensor, and the seed of the sensor's noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelSite {
    pub(super) seed: Seed,
    pub(super) x: u16,
    pub(super) y: u16,
}

impl PixelSite {
    /// The coordinates as one number, as [`gs2e_num::seed::eight::SeedCells`] takes them.
    pub(super) fn number(self) -> u64 {
        u64::from(self.y) << 16 | u64::from(self.x)
    }

    /// The pixel's draws for this purpose and index.
    pub(super) fn draws(self, space: DrawSpace, index: u64) -> CellDraws {
        self.seed.draws(SeedCell { x: self.x, y: self.y, level: 0, index }, space)
    }
}
