//! The mean of pictures: in linear light, as a camera with an open shutter records it, or of encoded
//! values, as some programs take it.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::light::{MeanScale, PictureSum};
//! use gs2e_image::{Image, Size, srgb};
//!
//! let size = Size { width: 1, height: 1 };
//! let mut sum = PictureSum::empty_sum(size, MeanScale::Linear);
//! sum.add(&Image::filled(size, [0.0; 3]));
//! sum.add(&Image::filled(size, [1.0; 3]));
//! // The mean of black and white has half of the light of white.
//! let [red, ..] = sum.mean().pixels()[0];
//! assert!((srgb::decode(red.into()) - 0.5).abs() < 1e-6);
//! ```

use super::{Image, Size, srgb};
use fearless_simd::{Level, Simd, SimdBase as _, dispatch, f64x8};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Number of pixels that are added at once; a multiple of eight.
const CHUNK: usize = 4096;

/// The values that a mean of pictures is taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanScale {
    /// Linear light, as a camera records it.
    #[default]
    Linear,
    /// Display-encoded values. E2NeRF and its relatives compare a blurred picture with such a mean.
    Encoded,
}

impl MeanScale {
    /// Returns true if this is the default.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        *self == Self::Linear
    }

    /// The value on this scale of a display-encoded value, 0..1.
    #[must_use]
    pub fn decode(self, encoded: f64) -> f64 {
        match self {
            Self::Linear => srgb::decode(encoded),
            Self::Encoded => encoded,
        }
    }

    /// The slope of [`MeanScale::decode`].
    #[must_use]
    pub fn decode_slope(self, encoded: f64) -> f64 {
        match self {
            Self::Linear => srgb::decode_slope(encoded),
            Self::Encoded => 1.0,
        }
    }

    /// The display-encoded value of a value on this scale.
    #[must_use]
    pub fn encode(self, value: f64) -> f64 {
        match self {
            Self::Linear => srgb::encode(value),
            Self::Encoded => value,
        }
    }
}

/// A sum of pictures in 64 bits, in their order: the same bits with any number of threads.
#[derive(Debug, Clone)]
pub struct PictureSum {
    size: Size,
    scale: MeanScale,
    /// Sums by pixel and channel.
    sums: Vec<f64>,
    pictures: u32,
}

impl PictureSum {
    /// An empty sum.
    #[must_use]
    pub fn empty_sum(size: Size, scale: MeanScale) -> Self {
        Self { size, scale, sums: vec![0.0; 3 * size.pixels()], pictures: 0 }
    }

    /// Adds a picture of display-encoded colours, clipped to 0..1.
    ///
    /// # Panics
    /// The picture has another size.
    pub fn add(&mut self, picture: &Image<[f32; 3]>) {
        assert_eq!(picture.size(), self.size, "all pictures of a mean are of one size");
        let level = Level::new();
        let values = picture.pixels().as_flattened();
        let parts = self.sums.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK));
        match self.scale {
            MeanScale::Linear => {
                parts.for_each(|(sums, values)| dispatch!(level, simd => add_eight(simd, sums, values)));
            }
            MeanScale::Encoded => parts.for_each(|(sums, values)| {
                sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += f64::from(v.clamp(0.0, 1.0)));
            }),
        }
        self.pictures += 1;
    }

    /// The mean, display-encoded, 0..1.
    ///
    /// # Panics
    /// There is no picture.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "the mean is rounded to 32 bits at the end")]
    pub fn mean(&self) -> Image<[f32; 3]> {
        assert!(self.pictures > 0, "there is a picture to take the mean of");
        let count = f64::from(self.pictures);
        let (pixels, _) = self.sums.as_chunks::<3>();
        let encode = |sums: &[f64; 3]| sums.map(|sum| self.scale.encode(sum / count) as f32);
        Image::from_vec(self.size, pixels.par_iter().map(encode).collect())
    }
}

/// Adds the linear light of display values, eight at a time.
#[inline(always)]
fn add_eight<S: Simd>(simd: S, sums: &mut [f64], values: &[f32]) {
    let light = |values: &[f32; 8]| -> [f64; 8] {
        let encoded = f64x8::from_fn(simd, |i| f64::from(values[i].clamp(0.0, 1.0)));
        srgb::decode_eight(encoded).into()
    };
    let ((sums, rest), (values, last)) = (sums.as_chunks_mut::<8>(), values.as_chunks::<8>());
    for (sums, values) in sums.iter_mut().zip(values) {
        for (sum, light) in sums.iter_mut().zip(light(values)) {
            *sum += light;
        }
    }
    // The rest, padded with black. The light of the padding is not added.
    let mut padded = [0.0; 8];
    padded[..last.len()].copy_from_slice(last);
    for (sum, light) in rest.iter_mut().zip(light(&padded)) {
        *sum += light;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::png;

    const SIZE: Size = Size { width: 7, height: 3 };

    fn mean(values: &[[f32; 3]]) -> Vec<[u8; 3]> {
        mean_on(MeanScale::Linear, values)
    }

    fn mean_on(scale: MeanScale, values: &[[f32; 3]]) -> Vec<[u8; 3]> {
        let mut light = PictureSum::empty_sum(SIZE, scale);
        values.iter().for_each(|rgb| light.add(&Image::filled(SIZE, *rgb)));
        png::to_bytes(&light.mean()).pixels().to_vec()
    }

    /// Light by the table in nothings/stb, `stb_image_resize.h`: 0.5 lies between 187 (0.496933)
    /// and 188 (0.502887), and 188 is nearer on the display's scale; a third is 156 (0.332452), a
    /// tenth is 89 (0.099899).
    #[test]
    fn black_and_white_in_turn_are_grey_by_light() {
        let t = |white: usize, all: usize, wanted: u8| {
            let pictures: Vec<[f32; 3]> = (0..all).map(|i| [f32::from(i < white); 3]).collect();
            assert_eq!(mean(&pictures), [[wanted; 3]; 21], "{white} of {all}");
        };
        t(1, 2, 188);
        t(1, 3, 156);
        t(1, 10, 89);
        t(0, 4, 0);
        t(5, 5, 255);
    }

    #[test]
    fn a_picture_that_stays_is_its_own_mean() {
        for v in 0..=255_u8 {
            let rgb = [f32::from(v) / 255.0, 1.0 - f32::from(v) / 255.0, 0.25];
            let wanted = png::to_bytes(&Image::filled(SIZE, rgb)).pixels().to_vec();
            assert_eq!(mean(&[rgb; 15]), wanted);
        }
    }

    /// A third of white is 85 of 255, and what leaves the range is clipped before.
    #[test]
    fn encoded_values_have_their_own_mean() {
        let pictures = [[1.0; 3], [0.0; 3], [0.0; 3]];
        assert_eq!(mean_on(MeanScale::Encoded, &pictures), [[85; 3]; 21]);
        let pictures = [[7.0, -3.0, 0.5], [0.0, 0.0, 0.5]];
        assert_eq!(mean_on(MeanScale::Encoded, &pictures), [[128, 0, 128]; 21]);
    }

    #[test]
    fn what_leaves_the_range_is_clipped_before() {
        assert_eq!(mean(&[[7.0, -3.0, 1.0], [0.0, 0.0, 0.0]]), [[188, 0, 188]; 21]);
    }
}
