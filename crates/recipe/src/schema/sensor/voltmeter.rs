//! DVS-Voltmeter as written.

use super::{
    BandwidthSection, ContrastSection, FloorPointSection, FrontEndSection, HotPixelsSection, LatencySection,
    PhotoreceptorNoiseSection, ReadoutSection, RefractorySection, ThresholdSection,
};
use crate::field::Field;
use gs2e_sensor::voltmeter::{ConstantUnits, DriftGain, InitialVoltage, SamplerKind};
use serde::Deserialize;

/// Brightness is `k1 ln(L + k2)`, `L` the grey from 0 to 255. A threshold divided by `k1` is a
/// contrast in `ln(L + k2)`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct VoltmeterSection {
    /// Named set of parameters: `davis346`, `evk4`, `dvxplorer`, `dvs346-paper` (or `dvs346`), `dvs240`
    /// or `gs2e-si`. Default: `davis346`.
    pub preset: Field<String>,
    /// The values `k1` to `k6` in `units`, instead of a preset. Range: `k1`, `k2` above 0; `k3`,
    /// `k6` at least 0; at most 1e12 in size. Default: the preset's.
    pub k: Field<[Field<f64>; 6]>,
    /// Units of `k`. Default: required with `k`, refused with a preset.
    pub units: Field<ConstantUnits>,
    /// Contrast thresholds; divided by `k1`, they are contrasts. They need a `preset` or `k`. Default:
    /// the preset's, or `{ on: 1, off: 1, spread: 0 }`.
    pub threshold: Field<ThresholdSection>,
    /// Contrasts of one event, instead of `threshold`. Default: none.
    pub contrast: Field<ContrastSection>,
    /// Sampler of the process. Default: `exact`.
    pub law: Field<SamplerKind>,
    /// Brightness that drives the drift. Default: `log`.
    pub gain: Field<DriftGain>,
    /// Voltages at the first frame. Default: the preset's, which is `stationary` for `evk4`; or `zero`.
    pub initial: Field<InitialVoltage>,
    /// Maximum number of events of one pixel between two frames; the step fails beyond it. Default:
    /// `1000`.
    pub max_events_per_pixel_frame: Field<u64>,
    /// True if events beyond that limit are dropped and counted, instead of failing the step.
    /// Default: `false`.
    pub allow_cap: Field<bool>,
    /// Conversion of colours to the brightness that the pixels see. Default: `{}`.
    pub front_end: Field<FrontEndSection>,
    /// Pixels that fire by themselves. Default: the preset's, or none.
    pub hot_pixels: Field<HotPixelsSection>,
    /// Rates of random events of all pixels against light; `[]` for none. Default: the preset's.
    pub floor: Field<Vec<Field<FloorPointSection>>>,
    /// Noise of the photoreceptor; it requires `law: exact`. Default: the preset's, or none.
    pub photoreceptor_noise: Field<PhotoreceptorNoiseSection>,
    /// Bandwidth of the pixels, a low-pass filter in front of the thresholds; it requires `law: exact`.
    /// Default: the preset's, or none.
    pub bandwidth: Field<BandwidthSection>,
    /// Dead time after an event; `reference` is `passing`. Default: the preset's.
    pub refractory: Field<RefractorySection>,
    /// True if each event has a label, signal (1) or noise (0). Default: `false`.
    pub labels: Field<bool>,
    /// Delay of the events. Default: none.
    pub latency: Field<LatencySection>,
    /// Limit of the rate of events. Default: none.
    pub readout: Field<ReadoutSection>,
}
