//! Imperfections of pixels that several sensor models share. Each draw belongs to the pixel's
//! position on the sensor and to the index of a frame or event, so crops and threads do not change
//! it.

pub mod hot_pixels;
pub mod mismatch;
pub(super) mod poisson;
pub mod refractory;

pub use hot_pixels::HotPixels;
pub use mismatch::{Redraw, Threshold};
pub use refractory::{Reference, Refractory};

use crate::seed::{Cell, Draws, Seed, Space};

/// A pixel's position on the sensor, and the seed of the sensor's noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub(super) seed: Seed,
    pub(super) x: u16,
    pub(super) y: u16,
}

impl Site {
    /// The pixel's draws for this purpose and index.
    pub(super) fn draws(self, space: Space, index: u64) -> Draws {
        self.seed.draws(Cell { x: self.x, y: self.y, level: 0, index }, space)
    }
}
