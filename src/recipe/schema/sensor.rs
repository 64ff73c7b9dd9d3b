//! Sensors as written, and the parts that they share.

use crate::recipe::field::Field;
use crate::sensor::esim::IntensityScale;
use crate::sensor::front_end::ChannelDecode;
use crate::sensor::noise::{RedrawRule, ReferenceRule};
use crate::sensor::v2e::FilterSteps;
use crate::sensor::voltmeter::{ConstantUnits, DriftGain, InitialVoltage, SamplerKind};
use serde::Deserialize;

/// Model of the sensor, with its parameters; [sensors.md](sensors.md) describes the models.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum SensorSection {
    /// The stochastic process of DVS-Voltmeter.
    Voltmeter(Field<Box<VoltmeterSection>>),
    /// The threshold model of ESIM.
    Esim(Field<Box<EsimSection>>),
    /// The pixel model of v2e.
    V2e(Field<Box<V2eSection>>),
    /// Name of another of `sensors`: the same sensor without its noise and its labels.
    #[serde(rename = "twin_of")]
    TwinOf(Field<String>),
}

impl SensorSection {
    /// Name of the sensor of which this one is the twin, if it is one.
    pub(in crate::recipe) fn twin_of(&self) -> Option<&Field<String>> {
        if let Self::TwinOf(name) = self { Some(name) } else { None }
    }

    /// The section of a voltmeter, if the sensor is one.
    pub(in crate::recipe) fn voltmeter(&self) -> Option<&VoltmeterSection> {
        if let Self::Voltmeter(raw) = self { Some(raw.given()?.0) } else { None }
    }
}

/// Brightness is `k1 ln(L + k2)`, `L` the grey from 0 to 255. A threshold divided by `k1` is a
/// contrast in `ln(L + k2)`.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct VoltmeterSection {
    /// Named set of `k1` to `k6`: `dvs346`, `dvs240` or `gs2e-si`. Default: `dvs346`.
    pub preset: Field<String>,
    /// The values `k1` to `k6` in `units`, instead of a preset. Range: `k1`, `k2` above 0; `k3`,
    /// `k6` at least 0; at most 1e12 in size. Default: the preset's.
    pub k: Field<[Field<f64>; 6]>,
    /// Units of `k`. Default: required with `k`, refused with a preset.
    pub units: Field<ConstantUnits>,
    /// Contrast thresholds, in units of the preset. Default: `{ on: 1, off: 1, spread: 0 }`.
    pub threshold: Field<ThresholdSection>,
    /// Sampler of the process. Default: `exact`.
    pub law: Field<SamplerKind>,
    /// Brightness that drives the drift. Default: `log`.
    pub gain: Field<DriftGain>,
    /// Voltages at the first frame. Default: `zero`.
    pub initial: Field<InitialVoltage>,
    /// Maximum number of events of one pixel between two frames; the step fails beyond it. Default:
    /// `1000`.
    pub max_events_per_pixel_frame: Field<u64>,
    /// True if events beyond that limit are dropped and counted, instead of failing the step.
    /// Default: `false`.
    pub allow_cap: Field<bool>,
    /// Conversion of colours to the brightness that the pixels see. Default: `{}`.
    pub front_end: Field<FrontEndSection>,
    /// Pixels that fire by themselves. Default: none.
    pub hot_pixels: Field<HotPixelsSection>,
    /// True if each event has a label, signal (1) or noise (0). Default: `false`.
    pub labels: Field<bool>,
}

/// Brightness is `ln(eps + L/255)`, or `L/255`; thresholds are differences of it.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct EsimSection {
    /// Contrast thresholds. Default: `{ on: 0.2, off: 0.2, spread: 0 }`.
    pub threshold: Field<ThresholdSection>,
    /// Time at which the thresholds of the pixels are drawn. Default: `per-sensor`.
    pub mismatch: Field<RedrawRule>,
    /// Scale of brightness. Default: `log`.
    pub intensity: Field<IntensityScale>,
    /// Offset added to `L/255` before the logarithm. Default: `0.001`.
    pub eps: Field<f64>,
    /// Dead time after an event. Default: `{ period_us: 0, reference: passing }`.
    pub refractory: Field<RefractorySection>,
    /// Pixels that fire by themselves. Default: none.
    pub hot_pixels: Field<HotPixelsSection>,
    /// Maximum number of events of one pixel between two frames; the step fails beyond it. Default:
    /// `1000`.
    pub max_events_per_pixel_frame: Field<u64>,
    /// True if events beyond that limit are dropped and counted, instead of failing the step.
    /// Default: `false`.
    pub allow_cap: Field<bool>,
    /// Conversion of colours to the brightness that the pixels see. Default: `{}`.
    pub front_end: Field<FrontEndSection>,
    /// True if each event has a label, signal (1) or noise (0). Default: `false`.
    pub labels: Field<bool>,
}

/// Every key may differ from the preset. `clean` has a threshold spread of 0.02 and no noise;
/// `noisy` has a spread of 0.05, a cutoff of 30 Hz, a leak of 0.1 Hz with jitter and cov 0.1, and
/// shot noise of 5 Hz.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct V2eSection {
    /// Named set of the keys below: `clean` or `noisy`. Default: `clean`.
    pub preset: Field<String>,
    /// Contrast thresholds, differences of the natural logarithm. Default: on 0.2, off 0.2, the
    /// preset's spread.
    pub threshold: Field<ThresholdSection>,
    /// Cutoff of the low-pass filter at white; 0 turns the filter off. Unit: Hz. Default: the
    /// preset's.
    pub cutoff: Field<f64>,
    /// Response of the filter between two frames. Default: `exact`.
    pub filter: Field<FilterSteps>,
    /// Leak events, which are ON. Default: the preset's.
    pub leak: Field<LeakSection>,
    /// Rate of shot noise in darkness, both polarities together. Unit: Hz. Default: the preset's.
    pub shot: Field<f64>,
    /// Dead time after an event. Default: `{ period_us: 0, reference: at-event }`.
    pub refractory: Field<RefractorySection>,
    /// Pixels that fire by themselves. Default: none.
    pub hot_pixels: Field<HotPixelsSection>,
    /// Maximum number of events of one pixel between two frames; the step fails beyond it. Default:
    /// `1000`.
    pub max_events_per_pixel_frame: Field<u64>,
    /// True if events beyond that limit are dropped and counted, instead of failing the step.
    /// Default: `false`.
    pub allow_cap: Field<bool>,
    /// Conversion of colours to the brightness that the pixels see. Default: `{}`.
    pub front_end: Field<FrontEndSection>,
    /// True if each event has a label, signal (1) or noise (0). Default: `false`.
    pub labels: Field<bool>,
}

/// Contrast thresholds. The unit is the sensor's.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct ThresholdSection {
    /// Threshold of ON events. Default: the sensor's.
    pub on: Field<f64>,
    /// Threshold of OFF events. Default: the sensor's.
    pub off: Field<f64>,
    /// Standard deviation over the pixels. Default: the sensor's.
    pub spread: Field<f64>,
}

/// Leak of the remembered level.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct LeakSection {
    /// Number of leak events of a pixel per second. Unit: Hz. Default: the preset's.
    pub rate: Field<f64>,
    /// Standard deviation of the rate from frame to frame, as a share of it. Default: the preset's.
    pub jitter: Field<f64>,
    /// Standard deviation of the rate over the pixels. Unit: decades. Default: the preset's.
    pub cov: Field<f64>,
}

/// Time after an event in which a pixel fires no other.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct RefractorySection {
    /// Length of the dead time. Unit: us. Default: `0`.
    pub period_us: Field<f64>,
    /// Level with which brightness is compared afterwards. Default: `passing` for `esim`,
    /// `at-event` for `v2e`.
    pub reference: Field<ReferenceRule>,
}

/// Hot pixels fire ON events at random times.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct HotPixelsSection {
    /// Share of all pixels that are hot. Required.
    pub share: Field<f64>,
    /// Number of events of a hot pixel per second. Unit: Hz. Required.
    pub rate: Field<f64>,
}

/// The defaults are the encoded luminance that the published simulators read.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct FrontEndSection {
    /// Weights of red, green and blue. Default: `rec601`.
    pub luminance: Field<LuminanceSection>,
    /// Decoding of the colours before they are weighted. Default: `none`.
    pub decode: Field<ChannelDecode>,
    /// Factor on the brightness. Default: `1`.
    pub exposure: Field<f64>,
    /// Range to which brightness is clamped. Default: `{}`.
    pub range: Field<RangeSection>,
}

/// Weights of the colours.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum LuminanceSection {
    /// 0.299, 0.587, 0.114 (ITU-R BT.601).
    Rec601,
    /// 0.2126, 0.7152, 0.0722 (ITU-R BT.709).
    Rec709,
    /// Three weights from 0 to 1 that sum to 1: `{ weights: [0.25, 0.5, 0.25] }`.
    Weights(Field<[Field<f64>; 3]>),
}

/// Limits of the brightness in greys; white is 255.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct RangeSection {
    /// Lowest brightness. Unit: grey. Default: `0`.
    pub min: Field<f64>,
    /// Highest brightness. Unit: grey. Default: no bound.
    pub max: Field<f64>,
}
