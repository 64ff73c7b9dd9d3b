//! A blurred frame against the mean of the sharp frames of its exposure.

use gs2e_image::Image;
use gs2e_image::light::MeanScale;

/// Difference of a blurred frame from the mean of sharp frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposureMismatch {
    /// Share of the values whose difference is larger than its bound.
    pub share: f64,
    /// Largest difference, in steps of 8 bits.
    pub worst: f64,
    /// True if the sharp frames are all that the exposure averages.
    pub is_exact: bool,
}

/// Sums of one value of a picture over the frames of an exposure.
#[derive(Debug, Clone, Copy, Default)]
struct ValueSums {
    light: f64,
    /// Largest error of the light by rounding.
    error: f64,
    /// Change of the light from frame to frame, as a sum of sizes.
    change: f64,
    last: f64,
}

/// Adds the sharp frames of an exposure one after the other.
#[derive(Debug)]
pub struct ExposureMean {
    sums: Vec<ValueSums>,
    frames: u32,
    scale: MeanScale,
    light: Vec<f64>,
    slope: Vec<f64>,
}

impl ExposureMean {
    /// A mean of frames with `pixels` pixels, on this scale.
    #[must_use]
    pub fn new(pixels: usize, scale: MeanScale) -> Self {
        let table =
            |of: fn(MeanScale, f64) -> f64| (0..=255u8).map(|v| of(scale, f64::from(v) / 255.0)).collect();
        Self {
            sums: vec![ValueSums::default(); 3 * pixels],
            frames: 0,
            scale,
            light: table(MeanScale::decode),
            slope: table(MeanScale::decode_slope),
        }
    }

    /// Adds a frame.
    ///
    /// # Panics
    /// The frame has another number of pixels.
    pub fn add(&mut self, frame: &Image<[u8; 3]>) {
        let values = frame.pixels().as_flattened();
        assert_eq!(values.len(), self.sums.len(), "all frames of an exposure are of one size");
        for (sums, value) in self.sums.iter_mut().zip(values) {
            let light = self.light[usize::from(*value)];
            if self.frames > 0 {
                sums.change += (light - sums.last).abs();
            }
            sums.last = light;
            sums.light += light;
            sums.error += self.slope[usize::from(*value)] * 0.5 / 255.0;
        }
        self.frames += 1;
    }

    /// Compares a blurred frame with the mean. `subframes` pictures stood for each frame.
    ///
    /// Each value of a sharp frame is rounded by half a step, which its slope turns into light. The
    /// mean is rounded by half a step too. Pictures between the frames are unknown: they move the
    /// mean by at most half of the mean change from frame to frame, if a value is monotone between
    /// two frames.
    ///
    /// # Panics
    /// The frame has another number of pixels, or no frame was added.
    #[must_use]
    pub fn compare(&self, blurred: &Image<[u8; 3]>, subframes: u32) -> ExposureMismatch {
        let values = blurred.pixels().as_flattened();
        assert_eq!(values.len(), self.sums.len(), "a blurred frame is of the size of its frames");
        assert!(self.frames > 0, "an exposure has frames");
        let count = f64::from(self.frames);
        let is_exact = subframes <= 1;
        let (mut beyond, mut worst) = (0u64, 0.0f64);
        for (sums, value) in self.sums.iter().zip(values) {
            let between = if is_exact { 0.0 } else { sums.change };
            let (mean, error) = (sums.light / count, (sums.error + between) / count);
            // From light back to steps at both ends of the interval, because the curve is bent.
            let [low, high] =
                [mean - error, mean + error].map(|light| 255.0 * self.scale.encode(light.max(0.0)));
            let value = f64::from(*value);
            let away = (low - value).max(value - high).max(0.0);
            worst = worst.max((255.0 * self.scale.encode(mean) - value).abs());
            // Half a step of its own, and the second order of the slopes.
            beyond += u64::from(away > 0.5 + 0.05);
        }
        ExposureMismatch { share: beyond as f64 / values.len().max(1) as f64, worst, is_exact }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_image::light::PictureSum;
    use gs2e_image::{Size, png};

    const SIZE: Size = Size { width: 16, height: 16 };

    /// A ramp of greys that moves by `step` greys per frame.
    fn frame(j: u8, step: f32) -> Image<[f32; 3]> {
        let grey = |i: u8| (f32::from(i) + f32::from(j) * step + 0.37) / 300.0;
        Image::from_vec(SIZE, (0..=255).map(|i| [grey(i), grey(255 - i), 0.5 * grey(i)]).collect())
    }

    fn mismatch(scale: MeanScale, step: f32, blurred: &Image<[u8; 3]>) -> ExposureMismatch {
        let mut mean = ExposureMean::new(SIZE.pixels(), scale);
        (0..5).for_each(|j| mean.add(&png::to_bytes(&frame(j, step))));
        mean.compare(blurred, 1)
    }

    #[test]
    fn a_mean_of_its_frames_is_within_rounding_and_another_is_not() {
        let both = [MeanScale::Linear, MeanScale::Encoded];
        for (scale, step) in both.into_iter().flat_map(|scale| [0.0, 1.3, 9.0].map(|step| (scale, step))) {
            let mut sum = PictureSum::empty_sum(SIZE, scale);
            (0..5).for_each(|j| sum.add(&frame(j, step)));
            let blurred = png::to_bytes(&sum.mean());
            let found = mismatch(scale, step, &blurred);
            assert_eq!(found.share.to_bits(), 0, "{scale:?}, {step}: {found:?}");
            // A mean of display values, and a single frame.
            let brighter = Image::from_vec(
                SIZE,
                blurred.pixels().iter().map(|rgb| rgb.map(|v| v.saturating_add(4))).collect(),
            );
            let found = mismatch(scale, step, &brighter);
            assert!(found.share > 0.9, "{scale:?}, {step}: {found:?}");
        }
        let single = png::to_bytes(&frame(0, 9.0));
        assert!(both.iter().all(|scale| mismatch(*scale, 9.0, &single).share > 0.9));
    }
}
