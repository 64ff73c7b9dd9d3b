//! The sensor of ESIM (Rebecq, Gehrig, Scaramuzza, CoRL 2018; uzh-rpg/rpg_esim,
//! `event_simulator.cpp`).
//!
//! A pixel sees `V = ln(eps + L/255)`, or `L/255`, as a straight line between two frames, and
//! stores a reference level. When `V` has risen by `C+` from that level, the pixel makes an ON
//! event; when it has fallen by `C-`, an OFF event. The level then becomes that of the crossing. An
//! event within the refractory period after another is dropped. There is no leak, no shot noise and
//! no bandwidth limit.
//!
//! Differences from that program:
//! - thresholds are drawn once per sensor, separately for ON and OFF, and are at least 0.01.
//!   `mismatch: per-frame` draws them for each pixel and frame, as the program does. There, a
//!   reference that a smaller threshold leaves behind the brightness makes no event until a larger
//!   threshold is drawn; here it makes one at once;
//! - changes of `V` below 1e-6 between two frames count too;
//! - the refractory period never applies to the first event, whatever the clock's origin;
//! - the reference after the period is a choice; the program has `passing`;
//! - hot pixels may be added.
//!
//! With thresholds drawn once and no hot pixels, the stream of a signal that is linear in `V` does
//! not depend on the frame rate. With `mismatch: per-frame` it does.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::Size;
//! # use gs2e_num::seed::Seed;
//! # use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//! # use std::ops::ControlFlow::Continue;
//! use gs2e_sensor::esim::EsimModel;
//! use gs2e_sensor::simulate_one;
//!
//! // The brightness of a pixel rises by 1.38, almost ln 4. It then falls to 0.18 above the start.
//! let samples = ArraySamples::Bytes(vec![50, 200, 60]);
//! let mut frames = ArrayFrames::new(Size { width: 1, height: 1 }, samples, &[0, 1000, 2000])?;
//! let mut events = Vec::new();
//! // Six steps of 0.2 lead up to the level 1.2, and five lead down to 0.2.
//! let model = EsimModel::trainable();
//! let account = simulate_one(&mut frames, &model, Seed(1), &mut events, &mut |_| Continue(()))?;
//! assert_eq!((account.on, account.off), (6, 5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod parameters;
mod presets;

pub(super) use parameters::FACTS;
pub use presets::TRAINABLE;

use super::chain::{FilteredPixels, PixelArray};
use super::course::BrightnessCourse;
use super::detector::{DetectorPixel, SpontaneousKind};
use super::noise::poisson::{LinearRate, PoissonTrain};
use super::noise::{PixelSite, RedrawRule, ThresholdMismatch};
use super::pairs::{FrameLaw, PairPixels, PairWriter, PixelPair};
use super::{SensorModel, SensorSettings, WHITE};
use gs2e_num::elementary;
use gs2e_num::seed::DrawSpace;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Version of the law. Raise it when a draw or a formula changes.
const VERSION: u32 = 1;

/// Parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EsimModel {
    /// `C+` and `C-` as differences of natural logarithms (of `L/255` if the intensity is linear),
    /// and their spread.
    pub threshold: ThresholdMismatch,
    /// Time at which thresholds are drawn.
    pub mismatch: RedrawRule,
    /// The quantity that pixels compare.
    pub intensity: IntensityScale,
    /// Added to `L/255` before the logarithm, above 0; 0.001 is usual.
    pub eps: f64,
    /// The settings that every model has.
    #[serde(flatten)]
    pub settings: SensorSettings,
}

/// The quantity that pixels compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IntensityScale {
    /// `ln(eps + L/255)`.
    #[default]
    Log,
    /// `L/255`.
    Linear,
}

impl Default for EsimModel {
    /// Thresholds of 0.2, the logarithm with an eps of 0.001, equal pixels, no refractory period, a
    /// cap of 1000.
    fn default() -> Self {
        Self::trainable()
    }
}

impl EsimModel {
    /// Returns true if the event balance of a pixel must equal the change of its brightness to less
    /// than a threshold.
    #[must_use]
    pub fn keeps_balance(&self) -> bool {
        // Hot pixels add events without moving the reference.
        self.keeps_references() && self.settings.hot_pixels.is_absent()
    }

    /// Returns true if the reference of a pixel moves by its own thresholds only, with one event each.
    #[must_use]
    pub fn keeps_references(&self) -> bool {
        // Each of these options drops crossings or moves the reference.
        self.settings.refractory.period_us == 0.0
            && (self.mismatch == RedrawRule::PerSensor || self.threshold.spread == 0.0)
            && !self.settings.allow_cap
    }

    /// The brightness of one pixel.
    fn brightness_of(&self, luminance: f64) -> f64 {
        let mut one = [luminance];
        self.to_brightness(&mut one);
        one[0]
    }
}

impl SensorModel for EsimModel {
    fn law_version(&self) -> u32 {
        VERSION
    }

    fn makes_noise(&self) -> bool {
        !self.keeps_balance()
    }

    /// The thresholds as contrast. If the intensity is linear, they are given at half of white.
    fn contrast(&self) -> (f64, f64) {
        let [on, off] = match self.intensity {
            IntensityScale::Log => self.threshold.sides(),
            // From half of white, a step by the threshold is a factor of 1 + 2 threshold.
            IntensityScale::Linear => self.threshold.sides().map(|threshold| libm::log1p(2.0 * threshold)),
        };
        (on, off)
    }

    fn law_pixels(&self, array: PixelArray) -> FilteredPixels {
        FilteredPixels::new(PairPixels::new(self.clone(), &self.settings, array))
    }
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct EsimPixel {
    detector: DetectorPixel,
    /// Brightness at the first frame.
    first: f64,
    /// Present brightness.
    brightness: f64,
    hot: PoissonTrain,
}

impl FrameLaw for EsimModel {
    type Pixel = EsimPixel;

    fn to_brightness(&self, luminance: &mut [f64]) {
        match self.intensity {
            IntensityScale::Log => {
                luminance.iter_mut().for_each(|l| *l = self.eps + *l / WHITE);
                elementary::ln_each(luminance);
            }
            IntensityScale::Linear => luminance.iter_mut().for_each(|l| *l /= WHITE),
        }
    }

    fn begin(&self, site: PixelSite, _: f64, brightness: f64) -> EsimPixel {
        let detector = DetectorPixel::new(self.threshold.at(site, 0), brightness);
        EsimPixel { detector, first: brightness, brightness, hot: self.settings.hot_pixels.train(site) }
    }

    fn cross(&self, pixel: &mut EsimPixel, pair: &PixelPair, writer: &mut PairWriter<'_>) -> ControlFlow<()> {
        let PixelPair { site, frame, length, brightness, .. } = *pair;
        if self.mismatch == RedrawRule::PerFrame {
            pixel.detector.thresholds = self.threshold.at(site, frame);
        }
        if pixel.hot.is_silent() && pixel.detector.rests(pixel.brightness, brightness) {
            pixel.brightness = brightness;
            return ControlFlow::Continue(());
        }
        let course = BrightnessCourse::straight_line(pixel.brightness, brightness, length);
        pixel.brightness = brightness;
        let SensorSettings { hot_pixels, refractory, .. } = &self.settings;
        let rates = LinearRate { ends: [hot_pixels.per_ns(site); 2], length };
        let train = &mut pixel.hot;
        let hot = SpontaneousKind { train, rates, site, space: DrawSpace::Hot, on_share: 1.0, resets: false };
        pixel.detector.cross(&course, refractory, &mut [hot], writer)
    }

    fn imbalance(&self, pixel: &EsimPixel, on: u32, off: u32) -> Option<f64> {
        let balance =
            super::detector::event_imbalance(&pixel.detector, pixel.brightness - pixel.first, on, off);
        self.keeps_balance().then_some(balance)
    }
}
