//! What makes a pixel imperfect, in parts that several sensor models share. Each draw belongs to the pixel's place on
//! the sensor and to a number that counts frames or events, so crops and threads cannot change it.

pub mod hot_pixels;
pub mod mismatch;
pub(super) mod poisson;
pub mod refractory;

pub use hot_pixels::HotPixels;
pub use mismatch::{Redraw, Threshold};
pub use refractory::{Reference, Refractory};

use crate::seed::{Cell, Draws, Seed, Space};

/// A pixel's place on the sensor, and the seed of the sensor's noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub(super) seed: Seed,
    pub(super) x: u16,
    pub(super) y: u16,
}

impl Site {
    /// The pixel's draws for this purpose and number.
    pub(super) fn draws(self, space: Space, index: u64) -> Draws {
        self.seed.draws(Cell { x: self.x, y: self.y, level: 0, index }, space)
    }
}
