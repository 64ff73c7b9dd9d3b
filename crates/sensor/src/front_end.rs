//! The front end of a sensor: from the colours of a frame to the brightness that the pixels see.
//!
//! ```text
//! L = 255 E sum_i w_i f(c_i / 255), clamped to min and max
//! ```
//!
//! where `c_i` are the display-encoded channels, 0..255. `f` is the identity (`decode: none`, as
//! the published simulators read their frames) or the sRGB curve (`decode: srgb`, brightness in
//! proportion to light). The weights `w_i` sum to 1, so a grey frame with equal channels needs
//! none. `E` is the exposure. The sensor sets a brightness below 0 to 0 and counts it, unless `min`
//! is above 0.
//!
//! The rate of change of a grey frame goes through the same map: it is multiplied by `E f'(L/255)`,
//! and is 0 where L is clamped. The rate of one weighted sum of colours does not determine the rate
//! of another sum, or in linear light; in those cases there is no rate.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::{Image, Size};
//! # use gs2e_num::units::Timestamp;
//! # use gs2e_sensor::frames::DenseFrame;
//! use gs2e_sensor::front_end::{FrontEnd, LuminanceWeights};
//!
//! // A sensor that sees red only, at half the exposure.
//! let luminance = LuminanceWeights::from_weights([1.0, 0.0, 0.0])?;
//! let front_end = FrontEnd { luminance, exposure: 0.5, ..FrontEnd::default() };
//! assert!(front_end.needs_colour() && !front_end.is_plain());
//!
//! let size = Size { width: 1, height: 1 };
//! let frame = DenseFrame { index: 0, t: Timestamp(0), luminance: Image::filled(size, 80.0), rate: None };
//! let seen = front_end.see(&frame, Some(&Image::filled(size, [200.0, 10.0, 130.0])));
//! assert!((seen.luminance.pixels()[0] - 100.0).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod frames;
mod weights;

pub use frames::{FrontEndFrames, distinct_front_ends};
pub use weights::{ColourWeights, LuminanceWeights, told_sum};

use super::{WHITE, is_default};
use crate::frames::DenseFrame;
use fearless_simd::{Level, Simd, SimdBase as _, dispatch, f64x8};
use gs2e_image::{Image, srgb};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of pixels per task.
const CHUNK: usize = 4096;

/// Map from colour to brightness.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrontEnd {
    /// Weights of the channels.
    pub luminance: LuminanceWeights,
    /// Decoding of a channel before it is weighted.
    pub decode: ChannelDecode,
    /// Factor on the brightness, above 0.
    pub exposure: f64,
    /// Bounds of the brightness.
    pub range: GreyRange,
    /// Light on the sensor at grey 255, lux. `None` for a sensor that does not depend on it: its
    /// constants are in grey.
    #[serde(default, skip_serializing_if = "is_default")]
    pub lux: Option<f64>,
}

/// Light at white, lux, unless a recipe states another: that of a room with good lighting on the
/// sensor behind an open lens.
pub const WHITE_LUX: f64 = 250.0;

impl Default for FrontEnd {
    /// The encoded luminance of BT.601, unchanged.
    fn default() -> Self {
        Self {
            luminance: LuminanceWeights::default(),
            decode: ChannelDecode::default(),
            exposure: 1.0,
            range: GreyRange::default(),
            lux: None,
        }
    }
}

/// Decoding of a channel before it is weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelDecode {
    /// None: brightness is display-encoded.
    #[default]
    None,
    /// To linear light, by the sRGB curve.
    Srgb,
}

/// Bounds of the brightness, in grey.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GreyRange {
    /// Lower bound, at least 0.
    pub min: f64,
    /// Upper bound, above `min`; none if absent.
    #[serde(default, skip_serializing_if = "is_default")]
    pub max: Option<f64>,
}

/// The reason why numbers are not a valid front end.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FrontEndError {
    /// A weight is negative, or the sum is not 1.
    #[error("the weights {0:?} sum to {sum}, wanted three weights of at least 0 with a sum of 1", sum = told_sum(.0))]
    Weights([f64; 3]),
    /// The exposure is not a finite number above 0.
    #[error("the exposure is {0}, wanted a finite number above 0")]
    Exposure(f64),
    /// The light of white is not a finite number above 0.
    #[error("white is {0} lux, wanted a finite number above 0")]
    Lux(f64),
    /// The bounds are not in order.
    #[error("the range is {min} to {max}, wanted 0 <= min < max")]
    Range {
        /// Lower bound.
        min: f64,
        /// Upper bound.
        max: f64,
    },
}

impl ChannelDecode {
    fn of(self, v: f64) -> f64 {
        match self {
            Self::None => v,
            Self::Srgb => srgb::decode(v),
        }
    }

    fn slope(self, v: f64) -> f64 {
        match self {
            Self::None => 1.0,
            Self::Srgb => srgb::decode_slope(v),
        }
    }

    #[inline(always)]
    fn of_eight<S: Simd>(self, v: f64x8<S>) -> f64x8<S> {
        match self {
            Self::None => v,
            Self::Srgb => srgb::decode_eight(v),
        }
    }
}

impl GreyRange {
    /// Clamps a brightness to the bounds.
    fn hold(self, grey: f64) -> f64 {
        // Without a lower bound, values below 0 pass: the sensor sets them to 0 and counts them.
        let least = if self.min > 0.0 { grey.max(self.min) } else { grey };
        self.max.map_or(least, |max| least.min(max))
    }

    /// Returns true if clamping changes `grey`.
    fn holds(self, grey: f64) -> bool {
        self.min > 0.0 && grey < self.min || self.max.is_some_and(|max| grey > max)
    }
}

impl fmt::Display for FrontEnd {
    /// The map as text, for example `0.299 R + 0.587 G + 0.114 B, display-encoded`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.luminance.weights();
        let of = match self.decode {
            ChannelDecode::None => "display-encoded",
            ChannelDecode::Srgb => "in linear light",
        };
        write!(f, "{r} R + {g} G + {b} B, {of}")?;
        // Equality without a float comparison, which the lints forbid.
        if !(1.0..=1.0).contains(&self.exposure) {
            write!(f, ", times {}", self.exposure)?;
        }
        match self.range {
            GreyRange { min, max: Some(max) } => write!(f, ", clamped to {min} to {max}")?,
            GreyRange { min, max: None } if min > 0.0 => write!(f, ", clamped to {min} or more")?,
            GreyRange { .. } => (),
        }
        self.lux.map_or(Ok(()), |lux| write!(f, ", white is {lux} lux on the sensor"))
    }
}

impl FrontEnd {
    /// Checks the numbers. Those of weights are valid by construction.
    ///
    /// # Errors
    /// A number is outside its range.
    pub fn validate(&self) -> Result<(), FrontEndError> {
        if !(self.exposure.is_finite() && self.exposure > 0.0) {
            return Err(FrontEndError::Exposure(self.exposure));
        }
        let GreyRange { min, max } = self.range;
        let ordered = max.is_none_or(|max| max.is_finite() && max > min);
        if !(min.is_finite() && min >= 0.0 && ordered) {
            return Err(FrontEndError::Range { min, max: max.unwrap_or(f64::INFINITY) });
        }
        match self.lux {
            Some(lux) if !(lux.is_finite() && lux > 0.0) => Err(FrontEndError::Lux(lux)),
            _ => Ok(()),
        }
    }

    /// Light on the sensor at grey 255, lux.
    #[must_use]
    pub fn white_lux(&self) -> f64 {
        self.lux.unwrap_or(WHITE_LUX)
    }

    /// Returns true if the luminance of a frame passes unchanged. The light of white changes no
    /// brightness.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        is_default(&Self { lux: None, ..*self })
    }

    /// Returns true if a recipe need not write it.
    #[must_use]
    pub fn is_default(&self) -> bool {
        is_default(self)
    }

    /// Returns true if the brightness needs the colours of a frame, because its luminance does not
    /// determine it.
    #[must_use]
    pub fn needs_colour(&self) -> bool {
        self.luminance != LuminanceWeights::Rec601 || self.decode != ChannelDecode::None
    }

    /// The frame as the pixels see it. `colour` holds the channels from which the luminance was
    /// made, on the same scale, unless the frame is grey.
    #[must_use]
    pub fn see(&self, frame: &DenseFrame, colour: Option<&Image<[f32; 3]>>) -> DenseFrame {
        let (luminance, rate) = match colour.filter(|_| self.needs_colour()) {
            // A weighted sum of rates would need the rates of the colours, which frames do not
            // have.
            Some(colour) => (self.of_colour(colour), None),
            None => (self.of_grey(&frame.luminance), self.rate_of_grey(frame)),
        };
        DenseFrame { index: frame.index, t: frame.t, luminance, rate }
    }

    fn of_colour(&self, colour: &Image<[f32; 3]>) -> Image<f32> {
        let mut seen = vec![0.0; colour.pixels().len()];
        let level = Level::new();
        let parts = seen.par_chunks_mut(CHUNK).zip(colour.pixels().par_chunks(CHUNK));
        parts.for_each(|(seen, colour)| dispatch!(level, simd => self.weigh(simd, colour, seen)));
        Image::from_vec(colour.size(), seen)
    }

    /// Eight pixels at a time.
    #[inline(always)]
    fn weigh<S: Simd>(&self, simd: S, colour: &[[f32; 3]], seen: &mut [f32]) {
        // One product per channel instead of three.
        let weights = self.luminance.weights().map(|w| w * self.exposure * WHITE);
        let hold = |seen: &mut [f32], sums: [f64; 8]| {
            for (seen, sum) in seen.iter_mut().zip(sums) {
                *seen = to_single(self.range.hold(sum));
            }
        };
        let ((colour, last), (seen, rest)) = (colour.as_chunks(), seen.as_chunks_mut::<8>());
        for (seen, colour) in seen.iter_mut().zip(colour) {
            hold(seen, self.weigh_eight(simd, colour, weights));
        }
        // The sums of the padding are never stored, because `rest` is as long as `last`.
        let mut padded = [[0.0; 3]; 8];
        padded[..last.len()].copy_from_slice(last);
        hold(rest, self.weigh_eight(simd, &padded, weights));
    }

    /// The brightness of eight pixels, before clamping. A function and not a closure, which may be compiled
    /// without the instruction set in use.
    #[inline(always)]
    fn weigh_eight<S: Simd>(&self, simd: S, colour: &[[f32; 3]; 8], weights: [f64; 3]) -> [f64; 8] {
        let mut sum = f64x8::splat(simd, 0.0);
        for (c, weight) in weights.into_iter().enumerate() {
            let of = f64x8::from_fn(simd, |i| f64::from(colour[i][c]));
            let part = self.decode.of_eight(of * (1.0 / WHITE)) * weight;
            // Not added to 0 first, which would turn -0 into 0.
            sum = if c == 0 { part } else { sum + part };
        }
        sum.into()
    }

    fn of_grey(&self, luminance: &Image<f32>) -> Image<f32> {
        let seen = |l: f32| to_single(self.range.hold(self.free(f64::from(l))));
        let pixels = luminance.pixels().par_iter();
        let pixels = match self.decode {
            ChannelDecode::None => pixels.map(|l| seen(*l)).collect(),
            // A power per pixel would take longer than many a sensor. Frames of 8 bits have 256 greys.
            ChannelDecode::Srgb => {
                let table: [f32; 256] = std::array::from_fn(|grey| seen(grey as f32));
                pixels.map(|l| tabulated(&table, *l).unwrap_or_else(|| seen(*l))).collect()
            }
        };
        Image::from_vec(luminance.size(), pixels)
    }

    /// The brightness of a grey, before clamping.
    fn free(&self, grey: f64) -> f64 {
        match self.decode {
            // Not scaled to 0..1 and back: an exposure of 1 must keep every bit.
            ChannelDecode::None => self.exposure * grey,
            decode => self.exposure * WHITE * decode.of(grey / WHITE),
        }
    }

    fn rate_of_grey(&self, frame: &DenseFrame) -> Option<Image<f32>> {
        let rate = frame.rate.as_ref()?;
        let seen = |(rate, grey): (&f32, &f32)| {
            let (grey, free) = (f64::from(*grey), self.free(f64::from(*grey)));
            // The factors 255 and 1/255 of the map cancel in its derivative.
            let slope =
                // A clamped brightness does not move, so its rate is 0.
                if self.range.holds(free) { 0.0 } else { self.exposure * self.decode.slope(grey / WHITE) };
            to_single(slope * f64::from(*rate))
        };
        let pairs = rate.pixels().par_iter().zip(frame.luminance.pixels());
        Some(Image::from_vec(rate.size(), pairs.map(seen).collect()))
    }
}

/// The value of a table of the whole numbers from 0 to 255. `None` for all other numbers, -0 among them.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the number is compared afterwards"
)]
fn tabulated(table: &[f32; 256], l: f32) -> Option<f32> {
    let grey = l as u8;
    (f32::from(grey).to_bits() == l.to_bits()).then(|| table[usize::from(grey)])
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the nearest")]
fn to_single(v: f64) -> f32 {
    v as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::Size;
    use gs2e_num::units::Timestamp;

    const SIZE: Size = Size { width: 5, height: 4 };

    fn grey(values: impl IntoIterator<Item = f32>, rate: Option<f32>) -> DenseFrame {
        let luminance = Image::from_vec(SIZE, values.into_iter().collect());
        DenseFrame { index: 3, t: Timestamp(7), luminance, rate: rate.map(|rate| Image::filled(SIZE, rate)) }
    }

    fn ramp() -> Vec<f32> {
        (0..20_u8).map(|i| 13.0 * f32::from(i)).collect()
    }

    fn decoded() -> FrontEnd {
        FrontEnd { decode: ChannelDecode::Srgb, ..FrontEnd::default() }
    }

    /// Brightness that is seen of a frame in one colour. 20 pixels are two eights and a rest.
    fn brightness_of(front_end: FrontEnd, rgb: [f32; 3]) -> f32 {
        let frame = front_end.see(&grey(ramp(), None), Some(&Image::filled(SIZE, rgb)));
        assert_eq!((frame.index, frame.t, frame.rate.is_none()), (3, Timestamp(7), true));
        let first = frame.luminance.pixels()[0];
        assert!(frame.luminance.pixels().iter().all(|l| l.to_bits() == first.to_bits()));
        first
    }

    #[test]
    fn colours_are_weighed() {
        let t = |weights: [f64; 3], rgb: [f32; 3], wanted: f32| {
            let front_end = FrontEnd {
                luminance: LuminanceWeights::from_weights(weights).unwrap(),
                ..FrontEnd::default()
            };
            let found = brightness_of(front_end, rgb);
            // Three products and two sums in 64 bits, then rounded to the 24 of a float below 512.
            assert!((found - wanted).abs() <= 512.0 * f32::EPSILON, "{weights:?} {rgb:?}: {found}");
        };
        let rec709 = LuminanceWeights::Rec709.weights();
        t(rec709, [255.0, 0.0, 0.0], 54.213);
        t(rec709, [0.0, 255.0, 0.0], 182.376);
        t(rec709, [0.0, 0.0, 255.0], 18.411);
        t([0.25, 0.5, 0.25], [200.0, 100.0, 50.0], 112.5);
        t([1.0, 0.0, 0.0], [300.0, 10.0, 10.0], 300.0);
        for v in [0.0, 1.0, 77.0, 128.0, 255.0] {
            // Weights that sum to 1 make nothing of grey but itself, to the last bit.
            let rec709 = FrontEnd { luminance: LuminanceWeights::Rec709, ..FrontEnd::default() };
            assert_eq!(brightness_of(rec709, [v; 3]).to_bits(), f32::to_bits(v));
        }
    }

    /// Light by the table in nothings/stb, `stb_image_resize.h`, to half a unit of its sixth digit.
    #[test]
    fn decoded_colours_are_weighed_as_light() {
        let t = |front_end: FrontEnd, rgb: [f32; 3], light: f32| {
            let found = brightness_of(front_end, rgb) / 255.0;
            assert!((found - light).abs() <= 0.5e-6 + f32::EPSILON, "{rgb:?}: {found}, wanted {light}");
        };
        let rec709 = FrontEnd { luminance: LuminanceWeights::Rec709, ..decoded() };
        for (v, light) in [(0.0, 0.0), (10.0, 0.003_035), (55.0, 0.038_204), (88.0, 0.097_587), (255.0, 1.0)]
        {
            t(decoded(), [v; 3], light);
            t(rec709, [v; 3], light);
            let frame = decoded().see(&grey([v; 20], None), None);
            assert!((frame.luminance.pixels()[19] / 255.0 - light).abs() <= 0.5e-6 + f32::EPSILON, "grey");
        }
        // 0.2126 of 0.097587, 0.7152 of 0.038204, 0.0722 of 0.003035.
        t(rec709, [88.0, 55.0, 10.0], 0.048_289_6);
        t(FrontEnd { exposure: 4.0, ..rec709 }, [55.0; 3], 4.0 * 0.038_204 + 1e-6);
    }

    /// Whole greys are looked up, all others are not: the bits are those of the formula, for both.
    #[test]
    fn tabulated_greys_have_the_same_bits() {
        let front_end = FrontEnd { exposure: 1.5, ..decoded() };
        let whole = (0..=255_u8).map(f32::from);
        let values: Vec<f32> = whole.flat_map(|v| [v, v + 0.5, -v, v + 200.0, v * 1e6]).collect();
        for v in values {
            let found = front_end.see(&grey([v; 20], None), None).luminance.pixels()[7];
            let wanted = to_single(1.5 * WHITE * srgb::decode(f64::from(v) / WHITE));
            assert_eq!(found.to_bits(), wanted.to_bits(), "{v}");
        }
    }

    #[test]
    fn exposure_and_range_are_those_of_grey() {
        let range = GreyRange { min: 20.0, max: Some(150.0) };
        let frame = FrontEnd { exposure: 2.0, range, ..FrontEnd::default() }.see(&grey(ramp(), None), None);
        for (found, before) in frame.luminance.pixels().iter().zip(ramp()) {
            let wanted = (2.0 * before).clamp(20.0, 150.0);
            assert_eq!(found.to_bits(), f32::to_bits(wanted));
        }
        // Without a lower end above 0 what is negative is left to the sensor, which counts it.
        let frame = FrontEnd { exposure: 2.0, ..FrontEnd::default() }.see(&grey([-1.0; 20], None), None);
        assert_eq!(frame.luminance.pixels(), [-2.0; 20]);
    }

    #[test]
    fn an_explicit_default_leaves_every_bit() {
        let values: Vec<f32> = (0..20_u8).map(|i| f32::from(i) * 17.3 - 0.001).collect();
        let frame = grey(values.clone(), Some(1.7));
        let plain = FrontEnd::default();
        assert!(plain.is_plain() && !plain.needs_colour());
        assert_eq!(
            plain,
            FrontEnd { luminance: LuminanceWeights::from_weights([0.299, 0.587, 0.114]).unwrap(), ..plain }
        );
        let same = plain.see(&frame, Some(&Image::filled(SIZE, [9.0; 3])));
        assert_eq!((same.luminance.pixels(), same.rate), (&values[..], frame.rate));
    }

    /// Central differences of a frame a little before and after, in steps that 32 bits hold well:
    /// `h = 2^-4` grey leaves a curvature of `h^2/6` times a third derivative of at most 1e-4, and
    /// `2^-18` of rounding of each over `2h`.
    #[test]
    fn the_rate_of_a_grey_goes_through_the_same_map() {
        let range = GreyRange { min: 5.0, max: Some(300.0) };
        for front_end in [
            FrontEnd { exposure: 1.5, range, ..decoded() },
            FrontEnd { exposure: 1.5, range, ..FrontEnd::default() },
        ] {
            let at = |by: f32| front_end.see(&grey(ramp().into_iter().map(|l| l + by), None), None).luminance;
            let rated = front_end.see(&grey(ramp(), Some(-8.0)), None).rate.unwrap();
            let (before, after) = (at(-0.0625), at(0.0625));
            let mut held = 0;
            for (i, rate) in rated.pixels().iter().enumerate() {
                let wanted = (after.pixels()[i] - before.pixels()[i]) / 0.125 * -8.0;
                assert!((rate - wanted).abs() <= 8.0 * 2e-4, "{front_end}: {i}: {rate}, wanted {wanted}");
                held += usize::from(*rate == 0.0);
            }
            assert!((1..19).contains(&held), "{held} are held");
        }
    }

    #[test]
    fn numbers_that_are_none_are_told() {
        let t = |weights: [f64; 3], wanted: &str| {
            assert_eq!(LuminanceWeights::from_weights(weights).unwrap_err().to_string(), wanted);
        };
        t(
            [0.3, 0.6, 0.2],
            "the weights [0.3, 0.6, 0.2] sum to 1.1, wanted three weights of at least 0 with a sum of 1",
        );
        t(
            [1.5, -0.5, 0.0],
            "the weights [1.5, -0.5, 0.0] sum to 1, wanted three weights of at least 0 with a sum of 1",
        );
        assert!(LuminanceWeights::from_weights([f64::NAN, 0.5, 0.5]).is_err());
        assert!(LuminanceWeights::from_weights([0.333_333_3, 0.333_333_3, 0.333_333_4]).is_ok());
        let plain = FrontEnd::default();
        for exposure in [0.0, -1.0, f64::INFINITY, f64::NAN] {
            let error = FrontEnd { exposure, ..plain }.validate().unwrap_err();
            assert!(matches!(error, FrontEndError::Exposure(_)), "{error}");
        }
        for (min, max) in [(-1.0, None), (5.0, Some(5.0)), (f64::NAN, None), (0.0, Some(f64::NAN))] {
            assert!(FrontEnd { range: GreyRange { min, max }, ..plain }.validate().is_err(), "{min} {max:?}");
        }
    }

    #[test]
    fn a_record_is_what_a_recipe_says() {
        let front_end = FrontEnd {
            luminance: LuminanceWeights::from_weights([0.25, 0.5, 0.25]).unwrap(),
            exposure: 2.0,
            range: GreyRange { min: 0.0, max: Some(255.0) },
            ..decoded()
        };
        let text = r#"{"luminance":{"weights":[0.25,0.5,0.25]},"decode":"srgb","exposure":2.0,"range":{"min":0.0,"max":255.0}}"#;
        assert_eq!(serde_json::to_string(&front_end).unwrap(), text);
        assert_eq!(serde_json::from_str::<FrontEnd>(text).unwrap(), front_end);
        let words = "0.25 R + 0.5 G + 0.25 B, in linear light, times 2, clamped to 0 to 255";
        assert_eq!(front_end.to_string(), words);
        assert!(serde_json::from_str::<LuminanceWeights>(r#"{"weights":[1,1,1]}"#).is_err());
    }
}
