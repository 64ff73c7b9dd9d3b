//! Imperfections of pixels that several sensor models share. Each draw belongs to the pixel's
//! position on the sensor and to the index of a frame or event, so crops and threads do not change
//! it.

pub mod floor;
pub mod hot_pixels;
pub mod mismatch;
pub(super) mod poisson;
pub mod refractory;

pub use floor::{FloorPoint, NoiseFloor};
pub use hot_pixels::HotPixelNoise;
pub use mismatch::{RedrawRule, ThresholdMismatch};
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
