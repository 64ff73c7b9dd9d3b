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
//! event. It then returns to 0. The process has no refractory time. A low-pass filter of `ln(L + k2)` may
//! stand in front of it (`low_pass.rs`). Thresholds may differ between pixels (`thresholds.rs`). Hot pixels,
//! a noise floor and a dead time act on the stream of the process (`spontaneous.rs`, `dead_time.rs`).
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
mod low_pass;
mod noiseless;
mod official;
mod parameters;
pub mod presets;
mod receptor;
mod screen;
mod signal;
mod thresholds;
mod touch;
mod tree;
pub mod units;
mod window;
mod writer;

pub use bridge::{Barriers, touch_time};
pub use leaf::{ClockLeaf, EmitEvents, LeafSpan};
pub(super) use parameters::FACTS;
pub use presets::VoltmeterPreset;
pub use units::ConstantUnits;

use super::bandwidth::PixelBandwidth;
use super::cap::FirstEvents;
use super::chain::{FilteredPixels, PixelArray};
use super::dead_time::DeadTime;
use super::noise::{NoiseFloor, PhotoreceptorNoise};
use super::pairs::PairPixels;
use super::spontaneous::SpontaneousEvents;
use super::{SensorModel, SensorSettings};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

/// Parameters in the official unit system: microseconds, grey 0..255, and voltages in thresholds of
/// the preset. k1, k2 and the thresholds are above 0; k3 and k6 are at least 0.
#[derive(Debug, Clone, PartialEq, Deserialize)]
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
    /// Standard deviation of the thresholds over the pixels.
    #[serde(default)]
    pub threshold_spread: f64,
    /// Random events of all pixels, in addition to the noise of the voltage. They need the light of
    /// white in the front end.
    #[serde(default)]
    pub floor: NoiseFloor,
    /// Noise of limited bandwidth that is added to the signal. It needs the law `exact`.
    #[serde(default)]
    pub photoreceptor_noise: PhotoreceptorNoise,
    /// A low-pass filter in front of the thresholds. It needs the law `exact`.
    #[serde(default)]
    pub bandwidth: PixelBandwidth,
    /// The settings that every model has.
    #[serde(flatten)]
    pub settings: SensorSettings,
}

/// The sampler of the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SamplerKind {
    /// First passages of the process, independent of the frame rate.
    Exact,
    /// The published program's sampler, whose noise depends on the frame rate. Ablation.
    Official,
}

/// The map from brightness to drift.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriftGain {
    /// `k1 ln(L + k2)`.
    Log,
    /// The published program's midpoint form. Ablation.
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
            threshold_spread: 0.0,
            floor: NoiseFloor::default(),
            photoreceptor_noise: PhotoreceptorNoise::default(),
            bandwidth: PixelBandwidth::default(),
            settings: SensorSettings::default(),
        }
    }

    /// The sensor without a limit on the events of one pixel between two frames.
    #[must_use]
    pub fn without_cap(mut self) -> Self {
        self.settings.max_events_per_pixel_frame = u32::MAX;
        self
    }
}

impl Serialize for VoltmeterModel {
    /// Options that are not in use are left out, so that records from before they existed stay the same.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let SensorSettings { refractory, hot_pixels, max_events_per_pixel_frame, .. } = &self.settings;
        let SensorSettings { allow_cap, front_end, labels, readout, latency, .. } = &self.settings;
        let mut out = serializer.serialize_map(None)?;
        out.serialize_entry("k", &self.k)?;
        out.serialize_entry("threshold_on", &self.threshold_on)?;
        out.serialize_entry("threshold_off", &self.threshold_off)?;
        out.serialize_entry("law", &self.law)?;
        out.serialize_entry("gain", &self.gain)?;
        out.serialize_entry("initial", &self.initial)?;
        out.serialize_entry("between", &self.between)?;
        out.serialize_entry("max_events_per_pixel_frame", max_events_per_pixel_frame)?;
        add_in_use(&mut out, "allow_cap", allow_cap)?;
        add_in_use(&mut out, "threshold_spread", &self.threshold_spread)?;
        add_in_use(&mut out, "hot_pixels", hot_pixels)?;
        add_in_use(&mut out, "floor", &self.floor)?;
        add_in_use(&mut out, "photoreceptor_noise", &self.photoreceptor_noise)?;
        if !self.photoreceptor_noise.is_absent() {
            // Part of the keys of steps, so that streams of an earlier version are made again.
            out.serialize_entry("receptor_version", &exact::RECEPTOR_VERSION)?;
        }
        add_in_use(&mut out, "bandwidth", &self.bandwidth)?;
        add_in_use(&mut out, "refractory", refractory)?;
        add_in_use(&mut out, "front_end", front_end)?;
        add_in_use(&mut out, "labels", labels)?;
        add_in_use(&mut out, "readout", readout)?;
        add_in_use(&mut out, "latency", latency)?;
        out.end()
    }
}

/// Adds an option to a record, unless it has its default.
fn add_in_use<M: SerializeMap, T: Serialize + Default + PartialEq>(
    out: &mut M,
    name: &str,
    value: &T,
) -> Result<(), M::Error> {
    if super::is_default(value) { Ok(()) } else { out.serialize_entry(name, value) }
}

impl VoltmeterModel {
    /// Pixels of the law `exact`, with the cap and the hot pixels behind them.
    fn exact(&self, array: PixelArray) -> FilteredPixels {
        let SensorSettings { allow_cap, max_events_per_pixel_frame: most, hot_pixels, .. } = self.settings;
        // The sampler has no cap of its own if it must drop events: it would end the run at the cap.
        let own_cap = if allow_cap { u32::MAX } else { most };
        let pixels = if self.bandwidth.is_absent() {
            FilteredPixels::new(exact::ExactSampler::new(self, own_cap, array))
        } else {
            FilteredPixels::new(low_pass::LowPassPixels::new(self, own_cap, array))
        };
        let first = allow_cap.then(|| FirstEvents::new(most, array));
        // Behind the cap, which counts the events of the law only.
        pixels.behind(first).behind(SpontaneousEvents::of_hot(&hot_pixels, array))
    }
}

impl SensorModel for VoltmeterModel {
    fn law_version(&self) -> u32 {
        match self.law {
            SamplerKind::Exact if self.photoreceptor_noise.is_absent() => exact::VERSION,
            SamplerKind::Exact => exact::RECEPTOR_VERSION,
            SamplerKind::Official => official::VERSION,
        }
    }

    /// `threshold / k1`: the contrast C of event cameras.
    fn contrast(&self) -> (f64, f64) {
        (self.threshold_on / self.k[0], self.threshold_off / self.k[0])
    }

    fn law_pixels(&self, array: PixelArray) -> FilteredPixels {
        let settings = &self.settings;
        let pixels = match self.law {
            SamplerKind::Exact => self.exact(array),
            SamplerKind::Official => {
                FilteredPixels::new(PairPixels::new(official::OfficialSampler::new(self), settings, array))
            }
        };
        let floor = SpontaneousEvents::of_floor(&self.floor, settings.front_end.white_lux(), array);
        // Last, because the dead time follows every event of a pixel, whatever its cause.
        pixels.behind(floor).behind(DeadTime::new(&settings.refractory, array))
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
        let settings = SensorSettings { allow_cap: true, labels: true, ..plain.settings };
        let imperfect = VoltmeterModel { threshold_spread: 0.1, settings, ..plain };
        assert!(described(&imperfect).ends_with(r#""allow_cap":true,"threshold_spread":0.1,"labels":true}"#));
    }
}
