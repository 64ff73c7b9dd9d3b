//! The sensor of v2e (Hu, Liu, Delbruck, CVPRW 2021; SensorsINI/v2e, `emulator.py`,
//! `emulator_utils.py`).
//!
//! A pixel maps the grey `L` by `f(L) = L ln(20)/20` up to 20 and `ln L` above. The result passes a
//! first-order low-pass filter with rate `2 pi cutoff (L + 20)/275`, so it is slower in the dark.
//! The pixel stores a reference level of the filter's output: a rise by its `C+` makes an ON event,
//! a fall by its `C-` an OFF event. Leak lowers the reference by `rate rho (1 - jitter z) C+` per
//! second, which makes ON events; `rho = 10^(cov z0)` belongs to the pixel, and `z` is normal for
//! each pixel and frame. Shot noise is ON with rate `q C+nominal/C+` and OFF with `q C-nominal/C-`,
//! where `q = rate/2 (1 - 0.75 (L + 20)/275)`; it sets the reference to the present output. Within
//! the refractory period after an event there is no other event.
//!
//! Differences from that program:
//! - events lie where the pixel's own brightness crosses its threshold, not on a grid with as many
//!   instants as the busiest pixel of the frame has events;
//! - `filter: exact` (the default) is the exact response of the filter to an input that is linear
//!   between two frames, with the rate of their mean. `filter: euler` is the program's step
//!   `min(1, 2 pi cutoff dt (L + 20)/275)` towards the later frame, linear in between, without the
//!   delay of one frame that some of its versions have;
//! - shot noise is a Poisson process with exponential gaps, not one trial per step. For greys above
//!   white, its rate stays that of white;
//! - thresholds of ON and OFF are drawn separately; `f` is not rounded and has 64 bits;
//! - at the end of the refractory period, a crossed threshold makes an event immediately
//!   (`reference: at-event`), not at the next instant of the grid;
//! - hot pixels are a setting (share and rate), in addition to the tail of `rho`;
//! - the photoreceptor noise and the surround of later versions are not implemented.
//!
//! Without the filter, crossings of a signal that is linear in `f`, shot noise of constant light
//! and leak without jitter do not depend on the frame rate. With the filter, they depend on it
//! through the change of its rate between two frames (more with `euler`), and the jitter of the
//! leak is drawn per frame.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::v2e::{LeakNoise, V2eModel, V2ePreset};
//!
//! let model = V2eModel::from(V2ePreset::Clean);
//! assert!(model.keeps_balance());
//! // Leak alone makes ON events at its own rate.
//! let leak = LeakNoise { rate: 0.5, ..LeakNoise::default() };
//! let noise = V2eModel { leak, ..model.clone() }.noise(128.0);
//! assert_eq!((noise.total_hz, noise.on_share), (0.5, Some(1.0)));
//! // Shot noise at white is a quarter of that in the dark, of either polarity alike.
//! let noise = V2eModel { shot: 8.0, ..model }.noise(255.0);
//! assert_eq!((noise.total_hz, noise.on_share), (2.0, Some(0.5)));
//! ```

mod parameters;
mod presets;

pub(super) use parameters::FACTS;
pub use presets::V2ePreset;

use super::chain::{FilteredPixels, PixelArray};
use super::course::{BrightnessCourse, FilteredCourse};
use super::detector::{DetectorPixel, SpontaneousKind, event_imbalance};
use super::noise::poisson::{LinearRate, PoissonTrain};
use super::noise::{PixelSite, ThresholdMismatch};
use super::pairs::{FrameLaw, PairPixels, PairWriter, PixelPair};
use super::screening::ConstantLightNoise;
use super::{SensorModel, SensorSettings, WHITE};
use fearless_simd::{Level, Select as _, Simd, SimdBase as _, dispatch};
use gs2e_num::elementary::{ln_eight, load_eight, store_eight};
use gs2e_num::seed::DrawSpace;
use serde::{Deserialize, Serialize};
use std::f64::consts::{LN_10, TAU};
use std::ops::ControlFlow;

/// Version of the law. Raise it when a draw or a formula changes.
const VERSION: u32 = 1;

/// Parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct V2eModel {
    /// `C+` and `C-` as differences of natural logarithms, and their spread.
    pub threshold: ThresholdMismatch,
    /// Cutoff of the low-pass filter at white, Hz; 0 means no filter.
    pub cutoff: f64,
    /// The filter's step from frame to frame.
    pub filter: FilterSteps,
    /// Leak of the reference level.
    pub leak: LeakNoise,
    /// Shot noise of both polarities together in the dark, Hz.
    pub shot: f64,
    /// The settings that every model has.
    #[serde(flatten)]
    pub settings: SensorSettings,
}

/// The filter's step from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterSteps {
    /// The exact response to an input that is linear between frames.
    #[default]
    Exact,
    /// The published program's step towards the later frame. Ablation.
    Euler,
}

/// Leak of the reference level, which makes ON events.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LeakNoise {
    /// ON events per second.
    pub rate: f64,
    /// Standard deviation of the rate from frame to frame, as a share.
    pub jitter: f64,
    /// Standard deviation of the rate's decimal logarithm over the pixels.
    pub cov: f64,
}

/// Largest grey that is mapped linearly.
const LINEAR: f64 = 20.0;
/// Relative reduction of shot noise at full intensity.
const SHOT_FALL: f64 = 0.75;
/// Nanoseconds in a second.
const NS: f64 = 1e9;

/// The mapping of a grey to brightness.
#[must_use]
pub fn lin_log(luminance: f64) -> f64 {
    if luminance <= LINEAR { luminance * (libm::log(LINEAR) / LINEAR) } else { libm::log(luminance) }
}

/// [`lin_log`] of many greys, to the same bits.
#[inline(always)]
fn lin_log_each<S: Simd>(simd: S, greys: &mut [f64]) {
    let (whole, rest) = greys.split_at_mut(greys.len() / 8 * 8);
    for start in (0..whole.len()).step_by(8) {
        let grey = load_eight(simd, whole, start);
        let dark = grey.simd_le(LINEAR);
        // The logarithm needs a positive number in each lane.
        let bright = ln_eight(grey.max(LINEAR));
        store_eight(dark.select(grey * (libm::log(LINEAR) / LINEAR), bright), whole, start);
    }
    for grey in rest {
        *grey = lin_log(*grey);
    }
}

/// Intensity on which rates depend; never 0.
fn rate_intensity(luminance: f64) -> f64 {
    (luminance + LINEAR) / (WHITE + LINEAR)
}

impl V2eModel {
    /// Returns true if the event balance of a pixel must equal the change of its brightness to less
    /// than a threshold.
    #[must_use]
    pub fn keeps_balance(&self) -> bool {
        let quiet = self.leak.rate == 0.0 && self.shot == 0.0 && self.settings.hot_pixels.is_absent();
        quiet && self.settings.refractory.period_us == 0.0 && !self.settings.allow_cap
    }

    /// Noise of a pixel with nominal thresholds at this constant grey. A leak event needs an
    /// undisturbed interval since the last shot. With shots at rate `s`, a leak of period `T`
    /// therefore has the rate `s/(e^(sT) - 1)`.
    #[must_use]
    pub fn noise(&self, grey: f64) -> ConstantLightNoise {
        self.noise_of(grey, [1.0; 2], 1.0)
    }

    /// Noise of a pixel whose rates of ON and OFF shots and of leak are these multiples of the
    /// nominal ones.
    fn noise_of(&self, grey: f64, shares: [f64; 2], leakiness: f64) -> ConstantLightNoise {
        let [on, off] = shares.map(|share| 0.5 * share * self.shots_per_second(grey));
        let (shots, leak) = (on + off, leakiness * self.leak.rate);
        // By `expm1`, because shots far rarer than the leak must leave its rate as it is.
        let leaks = if shots == 0.0 || leak == 0.0 { leak } else { shots / libm::expm1(shots / leak) };
        let total = shots + leaks;
        let share = (leaks + on) / total;
        ConstantLightNoise { grey, leak_hz: leak, total_hz: total, on_share: (total > 0.0).then_some(share) }
    }

    /// Time constant of the low-pass filter at this constant luminance, seconds; infinite without a
    /// filter.
    #[must_use]
    pub fn filter_seconds(&self, luminance: f64) -> f64 {
        1.0 / (TAU * self.cutoff * rate_intensity(luminance))
    }

    /// Shot noise of a pixel with nominal thresholds.
    fn shots_per_second(&self, luminance: f64) -> f64 {
        Self::shots_at(self.shot, luminance)
    }

    /// Shot events per second at this luminance, of a pixel with `dark_hz` of them in the dark.
    #[must_use]
    pub fn shots_at(dark_hz: f64, luminance: f64) -> f64 {
        // The published rate would turn negative for greys far above white.
        dark_hz * (1.0 - SHOT_FALL * rate_intensity(luminance.min(WHITE)))
    }

    /// The brightness of a pixel between two frames, without leak.
    fn course(&self, pixel: &V2ePixel, input: f64, pair: &PixelPair) -> BrightnessCourse {
        let PixelPair { length, luminance: [before, after], .. } = *pair;
        if self.cutoff == 0.0 {
            return BrightnessCourse::straight_line(pixel.filtered, input, length);
        }
        let rate = |luminance| TAU * self.cutoff / NS * rate_intensity(luminance);
        match self.filter {
            FilterSteps::Exact => {
                let rate = rate(0.5 * (before + after));
                let filter = FilteredCourse { output: pixel.filtered, input: [pixel.input, input], rate };
                BrightnessCourse::filter_output(&filter, length)
            }
            FilterSteps::Euler => {
                // A longer step would go beyond the input.
                let step = (rate(after) * length).min(1.0);
                BrightnessCourse::straight_line(
                    pixel.filtered,
                    pixel.filtered + step * (input - pixel.filtered),
                    length,
                )
            }
        }
    }

    /// The fall of a pixel's reference level between two frames.
    fn leaked(&self, pixel: &V2ePixel, pair: &PixelPair) -> f64 {
        let LeakNoise { rate, jitter, .. } = self.leak;
        if rate == 0.0 {
            return 0.0;
        }
        rate * pixel.leakiness * (1.0 - jitter * pair.deviate) * pixel.detector.thresholds[0] * pair.seconds
    }

    /// Shot noise of both polarities at this luminance, events per ns.
    fn shot_rate(&self, [on, off]: [f64; 2], luminance: f64) -> f64 {
        if self.shot == 0.0 { 0.0 } else { 0.5 * (on + off) * self.shots_per_second(luminance) / NS }
    }
}

impl SensorModel for V2eModel {
    fn law_version(&self) -> u32 {
        VERSION
    }

    fn makes_noise(&self) -> bool {
        !self.keeps_balance()
    }

    /// The thresholds as contrast, above grey 20.
    fn contrast(&self) -> (f64, f64) {
        (self.threshold.on, self.threshold.off)
    }

    fn law_pixels(&self, array: PixelArray) -> FilteredPixels {
        FilteredPixels::new(PairPixels::new(self.clone(), &self.settings, array))
    }
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct V2ePixel {
    detector: DetectorPixel,
    /// Output of the filter at the first frame.
    first: f64,
    /// Present output of the filter.
    filtered: f64,
    /// Input of the filter at the previous frame.
    input: f64,
    /// The pixel's leak, relative to the nominal leak.
    leakiness: f64,
    /// Shot noise of both polarities at the previous frame, events per ns.
    shots: f64,
    /// Shot noise of ON and OFF, relative to that of nominal thresholds.
    shot_shares: [f64; 2],
    shot: PoissonTrain,
    hot: PoissonTrain,
}

impl FrameLaw for V2eModel {
    type Pixel = V2ePixel;

    fn to_brightness(&self, luminance: &mut [f64]) {
        dispatch!(Level::new(), simd => lin_log_each(simd, luminance));
    }

    fn deviates(&self) -> Option<DrawSpace> {
        (self.leak.rate != 0.0 && self.leak.jitter != 0.0).then_some(DrawSpace::Leak)
    }

    fn begin(&self, site: PixelSite, luminance: f64, filtered: f64) -> V2ePixel {
        let detector = DetectorPixel::new(self.threshold.at(site, 0), filtered);
        // Shot noise is stronger in a pixel with a lower threshold, in proportion.
        let [on, off] = detector.thresholds;
        let shot_shares = [self.threshold.on / on, self.threshold.off / off];
        let leakiness = if self.leak.cov == 0.0 {
            1.0
        } else {
            libm::exp(LN_10 * self.leak.cov * site.draws(DrawSpace::Initial, 0).normal())
        };
        V2ePixel {
            detector,
            first: filtered,
            filtered,
            input: filtered,
            leakiness,
            shots: self.shot_rate(shot_shares, luminance),
            shot_shares,
            shot: if self.shot == 0.0 {
                PoissonTrain::silent()
            } else {
                PoissonTrain::new(site, DrawSpace::Shot)
            },
            hot: self.settings.hot_pixels.train(site),
        }
    }

    fn cross(&self, pixel: &mut V2ePixel, pair: &PixelPair, writer: &mut PairWriter<'_>) -> ControlFlow<()> {
        let PixelPair { site, length, luminance, brightness: input, .. } = *pair;
        // Without filter and leak the output is the input, so a pixel at rest needs no course.
        let is_quiet = self.cutoff == 0.0 && self.leak.rate == 0.0;
        if is_quiet
            && pixel.shot.is_silent()
            && pixel.hot.is_silent()
            && pixel.detector.rests(pixel.filtered, input)
        {
            (pixel.filtered, pixel.input) = (input, input);
            return ControlFlow::Continue(());
        }
        let (plain, leaked) = (self.course(pixel, input, pair), self.leaked(pixel, pair));
        let [on, off] = pixel.shot_shares;
        let shots = [pixel.shots, self.shot_rate([on, off], luminance[1])];
        pixel.shots = shots[1];
        let hot = if pixel.hot.is_silent() { [0.0; 2] } else { [self.settings.hot_pixels.per_ns(site); 2] };
        let mut sources = [
            SpontaneousKind {
                train: &mut pixel.shot,
                rates: LinearRate { ends: shots, length },
                site,
                space: DrawSpace::Shot,
                on_share: on / (on + off),
                resets: true,
            },
            SpontaneousKind {
                train: &mut pixel.hot,
                rates: LinearRate { ends: hot, length },
                site,
                space: DrawSpace::Hot,
                on_share: 1.0,
                resets: false,
            },
        ];
        let course = plain.tilted(leaked);
        let flow = pixel.detector.cross(&course, &self.settings.refractory, &mut sources, writer);
        // Tilting the brightness has the same effect as moving the level.
        pixel.detector.reference -= leaked;
        // The output without leak, because the next course adds the leak of its own interval.
        (pixel.filtered, pixel.input) = (plain.at(length), input);
        flow
    }

    fn imbalance(&self, pixel: &V2ePixel, on: u32, off: u32) -> Option<f64> {
        self.keeps_balance().then(|| event_imbalance(&pixel.detector, pixel.filtered - pixel.first, on, off))
    }
}
