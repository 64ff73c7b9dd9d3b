//! Renderings in changed light.
//!
//! Where a value and its result are above the linear piece of the sRGB curve, which is a power law, the map
//! `encode(f decode(c))` is affine: `g (c + 0.055) - 0.055` with `g = f^(1/2.4)`. So a pixel needs a power
//! only in the dark.

use super::LightAt;
use gs2e_image as image;
use gs2e_image::{Image, LUMINANCE_WEIGHTS, srgb};
use rayon::prelude::*;

/// Number of pixels per task.
const CHUNK: usize = 4096;
/// A display value in changed light, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LitValue {
    pub(super) value: f64,
    /// By the value before.
    pub(super) by_value: f64,
    /// By the factor.
    pub(super) by_factor: f64,
}

/// The map of display values at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct LitMap {
    factor: f64,
    root: f64,
}

impl LitMap {
    pub(super) fn new(factor: f64) -> Self {
        Self { factor, root: libm::pow(factor, 1.0 / srgb::GAMMA) }
    }

    /// The value alone.
    fn of(self, value: f64) -> f64 {
        let affine = self.root * (value + srgb::OFFSET) - srgb::OFFSET;
        if value > srgb::STRAIGHT && affine > srgb::STRAIGHT {
            affine
        } else {
            srgb::encode(self.factor * srgb::decode(value))
        }
    }

    pub(super) fn with_slopes(self, value: f64) -> LitValue {
        let Self { factor, root } = self;
        let affine = root * (value + srgb::OFFSET) - srgb::OFFSET;
        if value > srgb::STRAIGHT && affine > srgb::STRAIGHT {
            // Never a division by 0: a factor of 0 makes `affine` negative.
            let by_factor = root * (value + srgb::OFFSET) / (srgb::GAMMA * factor);
            return LitValue { value: affine, by_value: root, by_factor };
        }
        let light = srgb::decode(value);
        let lit = srgb::encode(factor * light);
        // The slope of the encoding, as the inverse of that of the decoding at the result.
        let slope = 1.0 / srgb::decode_slope(lit);
        LitValue {
            value: lit,
            by_value: slope * factor * srgb::decode_slope(value),
            by_factor: slope * light,
        }
    }
}

impl LightAt {
    /// The colours of a rendering in this light, display-encoded.
    #[must_use]
    pub fn lit(self, colours: &Image<[f32; 3]>) -> Image<[f32; 3]> {
        let mut lit = colours.clone();
        self.light_colours(&mut lit);
        lit
    }

    /// Lights the colours of a rendering, display-encoded.
    pub fn light_colours(self, colours: &mut Image<[f32; 3]>) {
        let map = LitMap::new(self.factor);
        let chunks = colours.pixels_mut().par_chunks_mut(CHUNK);
        chunks.for_each(|chunk| {
            chunk.as_flattened_mut().iter_mut().for_each(|value| *value = single(map.of(f64::from(*value))));
        });
    }

    /// Lights a row of a rendering, display-encoded.
    pub fn light_row(self, row: &mut [[f32; 3]]) {
        let map = LitMap::new(self.factor);
        row.as_flattened_mut().iter_mut().for_each(|value| *value = single(map.of(f64::from(*value))));
    }

    /// The luminance of colours on the scale 0..255 in this light.
    #[must_use]
    pub fn grey_in(self, mut colours: Image<[f32; 3]>) -> Image<f32> {
        let white = f32::from(u8::MAX);
        colours.pixels_mut().as_flattened_mut().iter_mut().for_each(|value| *value /= white);
        self.light_colours(&mut colours);
        let grey = colours.pixels().iter().map(|colour| white * image::luminance(*colour)).collect();
        Image::from_vec(colours.size(), grey)
    }

    /// The luminance of the colours `unlit` of a rendering in this light, and its rate of change if that of
    /// the rendering is given.
    ///
    /// The rate is exact where the three channels have the same slope: where all of them, before and after,
    /// are on the power law, or all on the linear piece. Elsewhere, which is in dark saturated colours, the
    /// rendered rate is shared out evenly among the channels.
    pub fn light_luminance(
        self,
        unlit: &Image<[f32; 3]>,
        luminance: &mut Image<f32>,
        rate: Option<&mut Image<f32>>,
    ) {
        let map = LitMap::new(self.factor);
        let pixels = luminance.pixels_mut().par_iter_mut().zip(unlit.pixels());
        match rate {
            None => pixels.for_each(|(luminance, colour)| {
                *luminance = single(weighted(colour.map(|value| map.of(f64::from(value)))));
            }),
            Some(rate) => pixels.zip(rate.pixels_mut()).for_each(|((luminance, colour), rate)| {
                let lit = colour.map(|value| map.with_slopes(f64::from(value)));
                *luminance = single(weighted(lit.map(|lit| lit.value)));
                let moved = weighted(lit.map(|lit| lit.by_value)) * f64::from(*rate);
                *rate = single(moved + weighted(lit.map(|lit| lit.by_factor)) * self.rate);
            }),
        }
    }
}

fn weighted(values: [f64; 3]) -> f64 {
    let [r, g, b] = LUMINANCE_WEIGHTS.map(f64::from);
    r * values[0] + g * values[1] + b * values[2]
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
fn single(value: f64) -> f32 {
    value as f32
}
