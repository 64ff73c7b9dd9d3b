//! Image sizes and their limits.

use std::fmt;

/// Maximum number of pixels of an image that is read: 2^28, above every camera.
pub const MAX_PIXELS: usize = 1 << 28;

/// Maximum number of columns, and of rows, of a sensor: events count them in 16 bits.
pub const MAX_SENSOR_SIDE: u32 = 1 << 16;

/// Maximum number of pixels of a sensor and of its frames: 2^24, twice the largest event cameras in
/// each direction.
pub const MAX_SENSOR_PIXELS: usize = 1 << 24;

/// Width and height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Size {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Size {
    /// Number of pixels.
    #[must_use]
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Compares the size of a sensor with [`MAX_SENSOR_SIDE`] and [`MAX_SENSOR_PIXELS`], because
    /// memory grows with its pixels.
    ///
    /// # Errors
    /// The size exceeds a limit.
    pub fn check_sensor(self) -> Result<(), TooLarge> {
        let fits = self.width.max(self.height) <= MAX_SENSOR_SIDE && self.pixels() <= MAX_SENSOR_PIXELS;
        if fits {
            Ok(())
        } else {
            Err(TooLarge { size: self, sides: MAX_SENSOR_SIDE, pixels: MAX_SENSOR_PIXELS })
        }
    }
}

/// A size above its limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{size} pixels, wanted at most {sides} columns and rows, and {pixels} pixels in all")]
pub struct TooLarge {
    /// The size that was found.
    pub size: Size,
    /// Maximum number of columns and of rows.
    pub sides: u32,
    /// Maximum number of pixels.
    pub pixels: usize,
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}
