//! Images in memory and the colour arithmetic that all of the program shares.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, luminance, to_byte};
//!
//! let size = Size { width: 2, height: 1 };
//! let image = Image::from_vec(size, vec![[0.0; 3], [1.0; 3]]);
//! let greys: Vec<u8> = image.pixels().iter().map(|rgb| to_byte(luminance(*rgb))).collect();
//! // Black is the darkest grey, and white the brightest one.
//! assert_eq!(greys, [0, 255]);
//! ```

pub mod jpeg;
pub mod light;
pub mod likeness;
pub mod npy;
pub mod photo;
pub mod png;
pub mod shrink;
mod size;
pub mod srgb;

pub use size::{MAX_PIXELS, MAX_SENSOR_PIXELS, MAX_SENSOR_SIDE, Size, TooLarge};

use gs2e_files::budget;
use std::collections::TryReserveError;

/// An image, rows from the top, row-major: pixel `(x, y)` is `data[y * width + x]`, its centre at
/// `(x + 0.5, y + 0.5)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Image<T> {
    size: Size,
    data: Vec<T>,
}

impl<T> Image<T> {
    /// Takes `data` as the pixels of an image of this size.
    ///
    /// # Panics
    /// If `data` does not hold exactly `size.pixels()` values.
    #[must_use]
    pub fn from_vec(size: Size, data: Vec<T>) -> Self {
        assert_eq!(data.len(), size.pixels(), "an image of {size} holds one value per pixel");
        Self { size, data }
    }

    /// Width and height.
    #[must_use]
    pub fn size(&self) -> Size {
        self.size
    }

    /// All pixels, row-major.
    #[must_use]
    pub fn pixels(&self) -> &[T] {
        &self.data
    }

    /// All pixels, row-major, for writing.
    #[must_use]
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Converts the image into its pixels.
    #[must_use]
    pub fn into_pixels(self) -> Vec<T> {
        self.data
    }
}

impl<T: Clone> Image<T> {
    /// An image with every pixel equal to `value`. Zeros take no memory until they are written.
    ///
    /// # Errors
    /// There is no memory for the image.
    pub fn try_filled(size: Size, value: T) -> Result<Self, TryReserveError> {
        Ok(Self { size, data: budget::try_filled(value, size.pixels())? })
    }

    /// An image with every pixel equal to `value`.
    #[must_use]
    pub fn filled(size: Size, value: T) -> Self {
        Self { size, data: vec![value; size.pixels()] }
    }
}

/// Content of an image file, on the grey scale 0..255.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyImage {
    /// Luminance of the encoded values.
    pub luminance: Image<f32>,
    /// Colours; `None` if the image is grey.
    pub colours: Option<Image<[f32; 3]>>,
}

/// Weights of red, green and blue in the luminance that sensors see (ITU-R BT.601, on encoded
/// values).
pub const LUMINANCE_WEIGHTS: [f32; 3] = [0.299, 0.587, 0.114];

/// Luminance of an encoded colour on the scale of its channels, unclamped.
#[must_use]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    LUMINANCE_WEIGHTS[0] * r + LUMINANCE_WEIGHTS[1] * g + LUMINANCE_WEIGHTS[2] * b
}

/// A channel on the scale 0..1 as the byte that image files hold: `floor(255 clip(v) + 0.5)`. NaN
/// gives 0.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clipped to 0..=255 before the cast"
)]
pub fn to_byte(v: f32) -> u8 {
    // A cast of NaN gives 0.
    (255.0 * v.clamp(0.0, 1.0) + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_round_half_up_and_clip() {
        let t = |v: f32, byte| assert_eq!(to_byte(v), byte, "{v}");
        t(0.0, 0);
        t(1.0, 255);
        t(1.63, 255);
        t(-0.2, 0);
        t(0.5, 128);
        t(f32::NAN, 0);
    }

    #[test]
    fn sensors_have_a_limit() {
        let t = |width, height, fits: bool| {
            assert_eq!(Size { width, height }.check_sensor().is_ok(), fits, "{width}x{height}");
        };
        t(4096, 4096, true);
        t(65_536, 256, true);
        t(4097, 4096, false);
        t(65_537, 1, false);
        let error = Size { width: 65_535, height: 65_535 }.check_sensor().unwrap_err().to_string();
        assert_eq!(
            error,
            "65535x65535 pixels, wanted at most 65536 columns and rows, and 16777216 pixels in all"
        );
        assert!(Image::try_filled(Size { width: u32::MAX, height: u32::MAX }, 1.0_f64).is_err());
    }

    #[test]
    fn luminance_of_white_is_one() {
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-6);
    }
}
