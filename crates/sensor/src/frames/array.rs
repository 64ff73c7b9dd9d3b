//! Frames from an array in memory.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::Size;
//! use gs2e_num::units::Timestamp;
//! use gs2e_sensor::frames::FrameSequence;
//! use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples, FullScale};
//!
//! // Two frames of one pixel, where white is 1. The first stamp may have any value.
//! let samples = ArraySamples::Floats(vec![0.0, 0.5], FullScale::One);
//! let mut frames = ArrayFrames::new(Size { width: 1, height: 1 }, samples, &[5_000_000, 5_000_417])?;
//! frames.next()?;
//! let second = frames.next()?.ok_or("there is one frame only")?;
//! assert_eq!(second.t, Timestamp(417_000));
//! assert_eq!(second.luminance.pixels(), [127.5]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod scale;

pub use scale::FullScale;

use super::stamps::{StampError, relative_stamps};
use super::{DenseFrame, FrameError, FrameSequence, require_finite};
use gs2e_image::{Image, Size};
use gs2e_num::units::Timestamp;

/// The samples of an array, frame after frame, each row-major from the top.
#[derive(Debug, Clone, PartialEq)]
pub enum ArraySamples {
    /// Grey 0..255, unchanged.
    Bytes(Vec<u8>),
    /// Luminance on the given scale.
    Floats(Vec<f32>, FullScale),
}

impl ArraySamples {
    fn len(&self) -> usize {
        match self {
            Self::Bytes(values) => values.len(),
            Self::Floats(values, _) => values.len(),
        }
    }

    /// Number of greys per unit of the samples.
    fn scale(&self) -> f32 {
        if let Self::Floats(_, full_scale) = self { full_scale.grey() } else { 1.0 }
    }

    /// A sample on the grey scale 0..255.
    fn grey(&self, i: usize) -> f32 {
        match self {
            Self::Bytes(values) => f32::from(values[i]),
            Self::Floats(values, _) => self.scale() * values[i],
        }
    }
}

/// The reason why an array and its stamps are not a sequence of frames.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArrayError {
    /// The number of samples does not match the shape.
    #[error("{found} samples do not match {frames} frames of {size}, which need {}", *frames as u128 * size.pixels() as u128)]
    Samples {
        /// Number of samples in the array.
        found: usize,
        /// Number of frames, equal to the number of stamps.
        frames: usize,
        /// Size of a frame.
        size: Size,
    },
    /// The stamps are not valid.
    #[error(transparent)]
    Stamps(#[from] StampError),
}

/// An array `[N, H, W]` with its stamps, as frames.
#[derive(Debug, Clone)]
pub struct ArrayFrames {
    size: Size,
    samples: ArraySamples,
    /// Change per second on the scale of the samples: one value per sample, or none.
    rates: Vec<f32>,
    /// Stamps, ns since the first.
    stamps: Vec<i64>,
    next: usize,
}

impl ArrayFrames {
    /// Takes the samples of frames of this size, one frame per stamp. The first stamp may have any
    /// value.
    ///
    /// # Errors
    /// The samples do not fill the frames, or the stamps do not strictly increase.
    pub fn new(size: Size, samples: ArraySamples, stamps_us: &[i64]) -> Result<Self, ArrayError> {
        let (found, frames) = (samples.len(), stamps_us.len());
        if size.pixels().checked_mul(frames) != Some(found) {
            return Err(ArrayError::Samples { found, frames, size });
        }
        Ok(Self { size, samples, rates: Vec::new(), stamps: relative_stamps(stamps_us)?, next: 0 })
    }

    /// Adds the luminance's change per second at every sample, on the scale of the samples.
    ///
    /// # Errors
    /// The number of values differs from that of samples.
    pub fn with_rates(self, rates: Vec<f32>) -> Result<Self, ArrayError> {
        let found = rates.len();
        if found != self.samples.len() {
            return Err(ArrayError::Samples { found, frames: self.stamps.len(), size: self.size });
        }
        Ok(Self { rates, ..self })
    }

    /// The values of frame `index` on the grey scale, all of them finite.
    fn image(&self, index: usize, what: &str, grey: impl Fn(usize) -> f32) -> Result<Image<f32>, FrameError> {
        let n = self.size.pixels();
        let values = (index * n..(index + 1) * n).map(grey).collect();
        require_finite(index, what, Image::from_vec(self.size, values))
    }
}

impl FrameSequence for ArrayFrames {
    fn size(&self) -> Size {
        self.size
    }

    fn len(&self) -> usize {
        self.stamps.len()
    }

    fn next(&mut self) -> Result<Option<DenseFrame>, FrameError> {
        let index = self.next;
        let Some(&t) = self.stamps.get(index) else { return Ok(None) };
        let scale = self.samples.scale();
        let luminance = self.image(index, "pixel", |i| self.samples.grey(i))?;
        let rate = (!self.rates.is_empty())
            .then(|| self.image(index, "the rate of pixel", |i| scale * self.rates[i]))
            .transpose()?;
        self.next += 1;
        Ok(Some(DenseFrame { index, t: Timestamp(t), luminance, rate }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 2, height: 1 };

    #[test]
    fn frames_come_on_the_grey_scale_with_stamps_from_zero() {
        let samples = ArraySamples::Floats(vec![0.0, 1.0, 0.5, 2.0], FullScale::One);
        let mut frames = ArrayFrames::new(SIZE, samples, &[1_000_000, 1_000_417]).unwrap();
        assert_eq!((frames.len(), frames.size()), (2, SIZE));
        let first = frames.next().unwrap().unwrap();
        assert_eq!((first.index, first.t, first.luminance.pixels()), (0, Timestamp(0), &[0.0, 255.0][..]));
        let second = frames.next().unwrap().unwrap();
        assert_eq!((second.t, second.luminance.pixels()), (Timestamp(417_000), &[127.5, 510.0][..]));
        assert!(frames.next().unwrap().is_none());
    }

    #[test]
    fn bytes_are_grey_as_they_stand() {
        let mut frames = ArrayFrames::new(SIZE, ArraySamples::Bytes(vec![7, 255]), &[-5]).unwrap();
        assert_eq!(frames.next().unwrap().unwrap().luminance.pixels(), [7.0, 255.0]);
    }

    #[test]
    fn what_is_no_sequence_is_refused_with_its_place() {
        let t = |stamps: &[i64], samples: usize, message: &str| {
            let error = ArrayFrames::new(SIZE, ArraySamples::Bytes(vec![0; samples]), stamps).unwrap_err();
            assert_eq!(error.to_string(), message);
        };
        t(&[0, 5], 3, "3 samples do not match 2 frames of 2x1, which need 4");
        t(&[0, 5, 5], 6, "stamp 2 is 5 us, not later than the previous one, 5 us");
        t(&[i64::MIN, 0], 4, "stamp 1 is 0 us, too far from the first, -9223372036854775808 us");
    }

    #[test]
    fn rates_come_on_the_scale_of_the_samples() {
        let of =
            |samples| ArrayFrames::new(SIZE, samples, &[0]).unwrap().with_rates(vec![2.0, -0.5]).unwrap();
        let rate = |mut frames: ArrayFrames| frames.next().unwrap().unwrap().rate.unwrap().into_pixels();
        assert_eq!(rate(of(ArraySamples::Floats(vec![0.0, 1.0], FullScale::One))), [510.0, -127.5]);
        assert_eq!(rate(of(ArraySamples::Bytes(vec![0, 255]))), [2.0, -0.5]);
        let frames = ArrayFrames::new(SIZE, ArraySamples::Bytes(vec![0, 1]), &[0]).unwrap();
        let message = "1 samples do not match 1 frames of 2x1, which need 2";
        assert_eq!(frames.with_rates(vec![1.0]).unwrap_err().to_string(), message);
    }

    #[test]
    fn a_sample_that_is_no_number_is_named() {
        let samples = ArraySamples::Floats(vec![0.0, 0.0, 0.0, f32::NAN], FullScale::One);
        let mut frames = ArrayFrames::new(SIZE, samples, &[0, 1]).unwrap();
        frames.next().unwrap();
        assert_eq!(frames.next().unwrap_err().to_string(), "frame 1: pixel (1, 0) is NaN");
    }
}
