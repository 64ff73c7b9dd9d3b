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

use super::course::BrightnessCourse;
use super::detector::{DetectorPixel, OwnEventKind};
use super::front_end::FrontEnd;
use super::latency::{PixelLatency, make_late};
use super::noise::poisson::{LinearRate, PoissonTrain};
use super::noise::{HotPixelNoise, PixelSite, RedrawRule, RefractoryPeriod, ThresholdMismatch};
use super::own_events::OwnEventArray;
use super::pairs::{EventCap, FrameLaw, PairPixels, PairWriter, PixelPair};
use super::readout::{ReadoutBus, read_out};
use super::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use super::{SensorError, SensorModel, SensorPixels, WHITE, check_extent};
use gs2e_event::EventLabel;
use gs2e_image::Size;
use gs2e_num::elementary;
use gs2e_num::seed::{DrawSpace, Seed};
use gs2e_num::units::Hertz;
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
    /// The dead time after an event.
    pub refractory: RefractoryPeriod,
    /// Pixels with an event process of their own.
    pub hot_pixels: HotPixelNoise,
    /// Maximum number of events of one pixel between two frames. More fail the step.
    pub max_events_per_pixel_frame: u32,
    /// True if further events are dropped and counted, and the step goes on.
    pub allow_cap: bool,
    /// The front end.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub front_end: FrontEnd,
    /// True if events are labelled as signal or noise.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub labels: bool,
    /// The bus behind the pixels, if its rate is limited.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub readout: Option<ReadoutBus>,
    /// The delays of the events, if they are late.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub latency: Option<PixelLatency>,
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
        self.keeps_references() && self.hot_pixels.is_absent()
    }

    /// Returns true if the reference of a pixel moves by its own thresholds only, with one event each.
    #[must_use]
    pub fn keeps_references(&self) -> bool {
        // Each of these options drops crossings or moves the reference.
        self.refractory.period_us == 0.0
            && (self.mismatch == RedrawRule::PerSensor || self.threshold.spread == 0.0)
            && !self.allow_cap
    }

    /// Predicts this sensor's behaviour with frames at this rate. Without noise, the table has no
    /// events.
    ///
    /// # Errors
    /// A parameter is outside its range, or a hot pixel makes more than 50 events per frame
    /// interval.
    pub fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        self.validate()?;
        let quantity = match self.intensity {
            IntensityScale::Log => "ln(L/255 + eps)",
            IntensityScale::Linear => "L/255",
        };
        SensorScreening::new(quantity, self.threshold.sides(), (rate, self.hot_pixels), |grey| {
            self.array_noise(grey)
        })
    }

    /// The noise at a constant grey: that of hot pixels, the mean over all pixels.
    fn array_noise(&self, grey: f64) -> ConstantLightNoise {
        let quiet = ConstantLightNoise { grey, leak_hz: 0.0, total_hz: 0.0, on_share: None };
        quiet.plus([self.hot_pixels.mean_hz(), 0.0])
    }

    fn validate(&self) -> Result<(), ScreenError> {
        self.threshold.validate()?;
        self.refractory.validate()?;
        self.hot_pixels.validate()?;
        self.latency.map_or(Ok(()), |latency| latency.validate(&self.front_end))?;
        // With 0, the logarithm of a black pixel would be infinite.
        if !(self.eps > 0.0 && self.eps.is_finite()) {
            let (name, wanted) = ("eps", "a finite number above 0");
            return Err(ScreenError::Parameter { name, found: self.eps, wanted });
        }
        if self.max_events_per_pixel_frame == 0 {
            let name = "max_events_per_pixel_frame";
            return Err(ScreenError::Parameter { name, found: 0.0, wanted: "at least 1" });
        }
        Ok(())
    }
}

impl EsimModel {
    /// The brightness of one pixel.
    fn seen(&self, luminance: f64) -> f64 {
        let mut one = [luminance];
        self.to_brightness(&mut one);
        one[0]
    }
}

impl SensorModel for EsimModel {
    fn law_version(&self) -> u32 {
        VERSION
    }

    fn front_end(&self) -> FrontEnd {
        self.front_end
    }

    fn labels(&self) -> bool {
        self.labels
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

    fn start(&self, size: Size, origin: [u16; 2], seed: Seed) -> Result<Box<dyn SensorPixels>, SensorError> {
        self.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
        check_extent(size, origin)?;
        let cap = EventCap { most: self.max_events_per_pixel_frame, leave_out: self.allow_cap };
        let pixels = Box::new(PairPixels::new(self.clone(), cap, size, origin, seed));
        let array = OwnEventArray { size, origin, seed, label: EventLabel::Noise };
        let (dead_ns, front_end) = (self.refractory.period_ns(), &self.front_end);
        let pixels = make_late(pixels, self.latency, (dead_ns, front_end), array);
        Ok(read_out(pixels, self.readout, size))
    }
}

/// State of one pixel.
#[derive(Debug)]
pub(super) struct EsimPixel {
    detector: DetectorPixel,
    /// Brightness at the first frame.
    first: f64,
    /// Present brightness.
    seen: f64,
    own: PoissonTrain,
    shot: PoissonTrain,
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

    fn begin(&self, site: PixelSite, _: f64, seen: f64) -> EsimPixel {
        let detector = DetectorPixel::new(self.threshold.at(site, 0), seen);
        EsimPixel {
            detector,
            first: seen,
            seen,
            own: self.hot_pixels.train(site),
            // The detector takes two sources, and ESIM has hot pixels only. This one never fires.
            shot: PoissonTrain::silent(),
        }
    }

    fn cross(&self, pixel: &mut EsimPixel, pair: &PixelPair, writer: &mut PairWriter<'_>) -> ControlFlow<()> {
        let PixelPair { site, frame, length, brightness: seen, .. } = *pair;
        if self.mismatch == RedrawRule::PerFrame {
            pixel.detector.thresholds = self.threshold.at(site, frame);
        }
        if pixel.own.is_silent() && pixel.detector.rests(pixel.seen, seen) {
            pixel.seen = seen;
            return ControlFlow::Continue(());
        }
        let course = BrightnessCourse::straight_line(pixel.seen, seen, length);
        pixel.seen = seen;
        let rates = LinearRate { ends: [self.hot_pixels.per_ns(site); 2], length };
        let source = |train, space| OwnEventKind { train, rates, site, space, on_share: 1.0, resets: false };
        let mut sources = [source(&mut pixel.own, DrawSpace::Hot), source(&mut pixel.shot, DrawSpace::Shot)];
        pixel.detector.cross(&course, &self.refractory, &mut sources, writer)
    }

    fn labels(&self) -> bool {
        self.labels
    }

    fn imbalance(&self, pixel: &EsimPixel, on: u32, off: u32) -> Option<f64> {
        let balance = super::detector::event_imbalance(&pixel.detector, pixel.seen - pixel.first, on, off);
        self.keeps_balance().then_some(balance)
    }
}
