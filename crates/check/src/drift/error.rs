//! Errors of the drift: rounded frames, unequal thresholds, and a leak of unknown light.

use super::DriftLaw;
use gs2e_image::srgb;
use gs2e_sensor::front_end::{ChannelDecode, FrontEnd};

/// Pictures of 8 bits per channel, as a sensor sees them: each channel is known to half of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRounding {
    /// The front end through which the pictures were seen.
    pub front_end: FrontEnd,
    /// Root mean square error of the brightness between the frames of the simulation, in
    /// thresholds, if these frames are not the pictures.
    pub between: f64,
}

impl FrameRounding {
    /// Largest error of a luminance, in greys. Every channel is rounded by at most half of a step,
    /// and the weights sum to 1. The curve of linear light is convex, and its slope a concave
    /// function of its value: for a given luminance, a grey pixel has the largest error.
    #[must_use]
    pub fn error(&self, luminance: f64) -> f64 {
        let FrontEnd { decode, exposure, .. } = self.front_end;
        match decode {
            ChannelDecode::None => 0.5 * exposure,
            ChannelDecode::Srgb => {
                let encoded = srgb::encode((luminance / (255.0 * exposure)).clamp(0.0, 1.0));
                // The slope at the far end of the step bounds that within it.
                0.5 * exposure * srgb::decode_slope(encoded + 0.5 / 255.0)
            }
        }
    }
}

impl DriftLaw {
    /// Largest error of the drift by the rounding of a frame with this luminance, in units of the
    /// voltage; 0 for frames that are not rounded.
    #[must_use]
    pub(crate) fn rounding_error(&self, luminance: f32) -> f64 {
        self.rounding_error_at(luminance, self.brightness(luminance))
    }

    /// [`Self::rounding_error`] of a luminance with this brightness.
    #[must_use]
    pub(crate) fn rounding_error_at(&self, luminance: f32, brightness: f64) -> f64 {
        let Some(rounding) = self.rounding else { return 0.0 };
        let luminance = f64::from(luminance).max(0.0);
        let error = rounding.error(luminance);
        let below = brightness - self.brightness_of((luminance - error).max(0.0));
        // Brightness is concave, so that its change is larger below, if black does not end it.
        if luminance >= error {
            return self.k[0] * below;
        }
        self.k[0] * below.max(self.brightness_of(luminance + error) - brightness)
    }

    /// Standard deviation of the drift by what lies between rounded frames; 0 if events were made
    /// from these frames.
    #[must_use]
    pub(crate) fn between_error(&self) -> f64 {
        self.rounding.map_or(0.0, |rounding| rounding.between * self.least_threshold())
    }

    /// Bound of the difference between the drift of `on` and `off` events by the stated thresholds
    /// and by those of the pixel: three standard deviations, and the same of the threshold that
    /// bounds the remaining voltage.
    #[must_use]
    pub(crate) fn spread_error(&self, [on, off]: [u32; 2]) -> f64 {
        // Without spread, the multiplication keeps it at exactly 0.
        3.0 * self.spread * (1.0 + length([f64::from(on), f64::from(off)]))
    }

    /// Largest probability that the remaining voltage of a pixel exceeds its bound by more than
    /// [`DriftLaw::spread_error`].
    ///
    /// After `n` events, the voltage and its bound are off by `n + 1` times the error of the threshold. If
    /// that is above three standard deviations, the voltage has to lie near the bound too: it is uniform,
    /// so the probability is the mean of what the error exceeds, in thresholds.
    #[must_use]
    pub(crate) fn beyond_spread_error(&self, [on, off]: [u32; 2]) -> f64 {
        // Probability of a normal deviate above 3, and the mean of its excess: `Q(3)` and `phi(3) - 3 Q(3)`.
        const ABOVE: f64 = 0.001_35;
        const EXCESS: f64 = 0.000_382;
        let events = length([f64::from(on), f64::from(off)]);
        ABOVE.min((1.0 + events) * EXCESS * self.spread / self.least_threshold())
    }

    /// Standard deviation of the leak if the luminance is known only at the ends of `intervals`
    /// intervals of `dt_us`. In each interval, the mean luminance has a random error of an eighth
    /// of the grey scale, typical for pictures with contrast.
    #[must_use]
    pub(crate) fn leak_error(&self, dt_us: f64, intervals: usize) -> f64 {
        // 32 of 255 greys. Errors of intervals are independent, so their sum grows with the root.
        let by_luminance = 32.0 * self.k[4].abs() * dt_us * (intervals as f64).sqrt();
        by_luminance + self.leak_spread * self.k[3].abs() * dt_us * intervals as f64
    }
}

/// The length of a vector of event counts, which are too small for an overflow.
pub(crate) fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}
