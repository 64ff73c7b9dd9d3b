//! The stochastic law of DVS-Voltmeter (Lin et al., ECCV 2022; GitHub Lynn0306/DVS-Voltmeter, MIT).
//!
//! The voltage `x` of a pixel that sees the grey `L(t)` moves as
//!
//! ```text
//! dx = dD + sigma(L) dW
//! D(t) = k1 ln(L + k2) + integral of (k4 + k5 L)
//! sigma(L) = k3 sqrt(L)/(L + k2) + k6
//! ```
//!
//! When it reaches `threshold_on`, an ON event happens; when it reaches `-threshold_off`, an OFF
//! event. It then returns to 0. The process has no refractory time and no bandwidth limit. Thresholds
//! may differ between pixels (`thresholds.rs`). Hot pixels, a noise floor and a dead time act on the
//! stream of the process (`own_events.rs`, `dead_time.rs`).
//!
//! The published program takes the drift at the midpoint of two frames (`gain: midpoint`) and draws
//! times as if there were one threshold (law `official`, `official.rs`). The law `exact` draws the
//! first passages of this process, whatever the frames (`exact.rs`, `tree.rs`, `leaf.rs`). As
//! published, both terms of sigma add as standard deviations.
//!
//! # Examples
//!
//! ```
//! # use gs2e_image::Size;
//! # use gs2e_num::seed::Seed;
//! # use gs2e_sensor::frames::array::{ArrayFrames, ArraySamples};
//! # use std::ops::ControlFlow::Continue;
//! use gs2e_sensor::voltmeter::VoltmeterModel;
//! use gs2e_sensor::{SensorModel, simulate_one};
//!
//! // Only k1 and k2: no noise, and no leak. The contrast is 1/k1.
//! let model = VoltmeterModel::new([5.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
//! assert_eq!(model.contrast(), (0.2, 0.2));
//! // From 20 to 140, the voltage rises by 5 ln(160/40) = 6.93, which is six thresholds of 1.
//! let samples = ArraySamples::Bytes(vec![20, 140]);
//! let mut frames = ArrayFrames::new(Size { width: 1, height: 1 }, samples, &[0, 1000])?;
//! let mut events = Vec::new();
//! let account = simulate_one(&mut frames, &model, Seed(1), &mut events, &mut |_| Continue(()))?;
//! assert_eq!((account.on, account.off, events.len()), (6, 0, 6));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod band;
mod bridge;
mod cell_list;
mod cubic;
mod curve;
mod drift;
mod exact;
mod leaf;
mod line;
mod noiseless;
mod official;
mod parameters;
pub mod presets;
mod screen;
mod signal;
mod thresholds;
mod tree;
pub mod units;
mod window;
mod writer;

pub use bridge::{Barriers, touch_time};
pub use leaf::{ClockLeaf, EmitEvents, LeafSpan};
pub(super) use parameters::FACTS;
pub use presets::VoltmeterPreset;
pub use units::ConstantUnits;

use super::cap::CappedPixels;
use super::dead_time::WithDeadTime;
use super::front_end::FrontEnd;
use super::latency::{PixelLatency, make_late};
use super::noise::{HotPixelNoise, NoiseFloor, RefractoryPeriod};
use super::own_events::{OwnEventArray, WithOwnEvents};
use super::pairs::{EventCap, PairPixels};
use super::readout::{ReadoutBus, read_out};
use super::{SensorError, SensorModel, SensorPixels, check_extent};
use gs2e_event::EventLabel;
use gs2e_image::Size;
use gs2e_num::seed::Seed;
use serde::{Deserialize, Serialize};

/// Parameters in the official unit system: microseconds, grey 0..255, and voltages in thresholds of
/// the preset. k1, k2 and the thresholds are above 0; k3 and k6 are at least 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VoltmeterModel {
    /// k1 to k6: pure number, grey, grey^.5/us^.5, 1/us, 1/(grey us), 1/us^.5.
    pub k: [f64; 6],
    /// Threshold of ON events.
    pub threshold_on: f64,
    /// Threshold of OFF events.
    pub threshold_off: f64,
    /// The sampler.
    pub law: SamplerKind,
    /// The map from brightness to drift.
    pub gain: DriftGain,
    /// Voltages at the first frame.
    pub initial: InitialVoltage,
    /// Interpolation of brightness between frames.
    pub between: BetweenFrames,
    /// Maximum number of events of one pixel between two frames. More fail the step.
    pub max_events_per_pixel_frame: u32,
    /// True if further events are dropped and counted, and the step goes on.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub allow_cap: bool,
    /// Standard deviation of the thresholds over the pixels.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub threshold_spread: f64,
    /// Pixels with an event process of their own.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub hot_pixels: HotPixelNoise,
    /// Random events of all pixels, in addition to the noise of the voltage. They need the light of
    /// white in `front_end`.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub floor: NoiseFloor,
    /// The dead time after an event. Its reference is `passing`.
    #[serde(default, skip_serializing_if = "super::is_default")]
    pub refractory: RefractoryPeriod,
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

/// The sampler of the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SamplerKind {
    /// First passages of the process, independent of the frame rate.
    Exact,
    /// The published program's sampler, whose noise depends on the frame rate; for comparisons.
    Official,
}

/// The map from brightness to drift.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriftGain {
    /// `k1 ln(L + k2)`.
    Log,
    /// The published program's midpoint form; for comparisons.
    Midpoint,
}

/// Voltages at the first frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialVoltage {
    /// All zero, as published; equal pixels then leak in step.
    Zero,
    /// As if every pixel had seen the first frame for a long time.
    Stationary,
}

/// Brightness between two frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BetweenFrames {
    /// A straight line.
    Linear,
    /// A cubic through four frames.
    Catmull,
    /// A cubic through two frames and their rendered rates of change.
    Hermite,
}

impl BetweenFrames {
    /// The name in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Catmull => "catmull",
            Self::Hermite => "hermite",
        }
    }
}

impl VoltmeterModel {
    /// Thresholds of 1, the law `exact`, log gain, voltages from zero, linear between frames, a cap
    /// of 1000.
    #[must_use]
    pub fn new(k: [f64; 6]) -> Self {
        Self {
            k,
            threshold_on: 1.0,
            threshold_off: 1.0,
            law: SamplerKind::Exact,
            gain: DriftGain::Log,
            initial: InitialVoltage::Zero,
            between: BetweenFrames::Linear,
            max_events_per_pixel_frame: 1000,
            allow_cap: false,
            threshold_spread: 0.0,
            hot_pixels: HotPixelNoise::default(),
            floor: NoiseFloor::default(),
            refractory: RefractoryPeriod::default(),
            front_end: FrontEnd::default(),
            labels: false,
            latency: None,
            readout: None,
        }
    }
}

impl VoltmeterModel {
    /// Pixels of the law `exact`, with the hot pixels and the cap around them.
    fn exact(&self, size: Size, origin: [u16; 2], seed: Seed) -> Box<dyn SensorPixels> {
        let cap = self.max_events_per_pixel_frame;
        let mut pixels: Box<dyn SensorPixels> = if self.allow_cap {
            // The sampler itself has no cap then. It would end the run at the cap instead of
            // dropping events.
            let free = Self { max_events_per_pixel_frame: u32::MAX, ..self.clone() };
            Box::new(CappedPixels::new(
                Box::new(exact::ExactSampler::new(&free, size, origin, seed)),
                cap,
                size,
            ))
        } else {
            Box::new(exact::ExactSampler::new(self, size, origin, seed))
        };
        // Outside the cap, which counts the events of the law only.
        if !self.hot_pixels.is_absent() {
            let array = self.own_events(size, origin, seed);
            pixels = Box::new(WithOwnEvents::with_hot(pixels, &self.hot_pixels, array));
        }
        pixels
    }

    /// The array of the own events of pixels.
    fn own_events(&self, size: Size, origin: [u16; 2], seed: Seed) -> OwnEventArray {
        // A stream without labels has the label `Signal` on every event.
        let label = if self.labels { EventLabel::Noise } else { EventLabel::Signal };
        OwnEventArray { size, origin, seed, label }
    }

    /// Adds the noise floor and the dead time to the pixels of either law.
    fn wrap(&self, mut pixels: Box<dyn SensorPixels>, array: OwnEventArray) -> Box<dyn SensorPixels> {
        if !self.floor.is_absent() {
            pixels = Box::new(WithOwnEvents::with_floor(pixels, &self.floor, &self.front_end, array));
        }
        // Outermost, because the dead time follows every event of a pixel, whatever its cause.
        if self.refractory.period_us > 0.0 {
            pixels = Box::new(WithDeadTime::new(pixels, &self.refractory, array.size));
        }
        pixels
    }
}

impl SensorModel for VoltmeterModel {
    fn law_version(&self) -> u32 {
        match self.law {
            SamplerKind::Exact => exact::VERSION,
            SamplerKind::Official => official::VERSION,
        }
    }

    fn front_end(&self) -> FrontEnd {
        self.front_end
    }

    fn labels(&self) -> bool {
        self.labels
    }

    /// `threshold / k1`: the contrast C of event cameras.
    fn contrast(&self) -> (f64, f64) {
        (self.threshold_on / self.k[0], self.threshold_off / self.k[0])
    }

    fn start(&self, size: Size, origin: [u16; 2], seed: Seed) -> Result<Box<dyn SensorPixels>, SensorError> {
        self.validate().map_err(|error| SensorError::Setup(error.to_string()))?;
        check_extent(size, origin)?;
        let pixels = match self.law {
            SamplerKind::Exact => self.exact(size, origin, seed),
            SamplerKind::Official => {
                let cap = EventCap { most: self.max_events_per_pixel_frame, leave_out: self.allow_cap };
                Box::new(PairPixels::new(official::OfficialSampler::new(self), cap, size, origin, seed))
            }
        };
        let array = self.own_events(size, origin, seed);
        let pixels = self.wrap(pixels, array);
        let (dead_ns, front_end) = (self.refractory.period_ns(), &self.front_end);
        let pixels = make_late(pixels, self.latency, (dead_ns, front_end), array);
        Ok(read_out(pixels, self.readout, size))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A key from before these options existed stays the same.
    #[test]
    fn options_that_are_not_used_are_in_no_record() {
        let described = |sensor: &VoltmeterModel| serde_json::to_string(sensor).unwrap();
        let plain = VoltmeterModel::new([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let wanted = r#"{"k":[1.0,2.0,3.0,4.0,5.0,6.0],"threshold_on":1.0,"threshold_off":1.0,"law":"exact","gain":"log","initial":"zero","between":"linear","max_events_per_pixel_frame":1000}"#;
        assert_eq!(described(&plain), wanted);
        assert_eq!(serde_json::from_str::<VoltmeterModel>(wanted).unwrap(), plain);
        let account = serde_json::to_string(&crate::SimulationAccount::default()).unwrap();
        assert!(!account.contains("capped"), "{account}");
        let imperfect = VoltmeterModel { threshold_spread: 0.1, allow_cap: true, labels: true, ..plain };
        assert!(described(&imperfect).ends_with(r#""allow_cap":true,"threshold_spread":0.1,"labels":true}"#));
    }
}
