//! Sensors as written, and the parts that they share.

mod esim;
mod v2e;
mod voltmeter;

pub(crate) use esim::EsimSection;
pub(crate) use v2e::{LeakSection, V2eSection};
pub(crate) use voltmeter::VoltmeterSection;

use crate::field::Field;
use gs2e_sensor::front_end::ChannelDecode;
use gs2e_sensor::noise::ReferenceRule;
use gs2e_sensor::readout::ArbiterOrder;
use serde::Deserialize;

/// Model of the sensor, with its parameters; [sensors.md](sensors.md) describes the models. A number
/// may be a law from which it is drawn for each trajectory: `{ uniform: [a, b] }`,
/// `{ log_uniform: [a, b] }`, or `{ normal: [mean, sd], within: [a, b] }`.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SensorSection {
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
    /// The contrast and the threshold as written; `None` for a twin, or a faulty section.
    pub(crate) fn contrast(&self) -> Option<(&Field<ContrastSection>, &Field<ThresholdSection>)> {
        match self {
            Self::Voltmeter(raw) => raw.given().map(|(raw, _)| (&raw.contrast, &raw.threshold)),
            Self::Esim(raw) => raw.given().map(|(raw, _)| (&raw.contrast, &raw.threshold)),
            Self::V2e(raw) => raw.given().map(|(raw, _)| (&raw.contrast, &raw.threshold)),
            Self::TwinOf(_) => None,
        }
    }

    /// Name of the sensor with noise, if this one is its twin.
    pub(crate) fn twin_of(&self) -> Option<&Field<String>> {
        if let Self::TwinOf(name) = self { Some(name) } else { None }
    }

    /// The section of a voltmeter, if the sensor is one.
    pub(crate) fn voltmeter(&self) -> Option<&VoltmeterSection> {
        if let Self::Voltmeter(raw) = self { Some(raw.given()?.0) } else { None }
    }
}

/// Contrasts of one event: changes of the natural logarithm of the brightness. One number is both, and a list
/// of two is ON and OFF: `contrast: 0.2`, `contrast: [0.2, 0.3]`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ContrastSection {
    /// Contrast of ON events. Default: the sensor's.
    pub on: Field<f64>,
    /// Contrast of OFF events. Default: the sensor's.
    pub off: Field<f64>,
}

/// Contrast thresholds. The unit is the sensor's.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ThresholdSection {
    /// Threshold of ON events. Default: the sensor's.
    pub on: Field<f64>,
    /// Threshold of OFF events. Default: the sensor's.
    pub off: Field<f64>,
    /// Standard deviation over the pixels. Default: the sensor's.
    pub spread: Field<f64>,
}

/// Time after an event in which a pixel fires no other.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RefractorySection {
    /// Length of the dead time. Unit: us. Default: `0`.
    pub period_us: Field<f64>,
    /// Level with which brightness is compared afterwards. Default: `passing` for `esim`,
    /// `at-event` for `v2e`.
    pub reference: Field<ReferenceRule>,
}

/// Hot pixels fire ON events at random times.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct HotPixelsSection {
    /// Share of all pixels that are hot. Required.
    pub share: Field<f64>,
    /// Number of events of a hot pixel per second; the median if the rates differ. Unit: Hz. Required.
    pub rate: Field<f64>,
    /// Standard deviation of the rates over the hot pixels, which are log-normal. Unit: decades.
    /// Default: `0`.
    pub spread: Field<f64>,
}

/// Rates of noise events at one light.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct FloorPointSection {
    /// Light on the sensor; rises from point to point. Unit: lux. Required.
    pub lux: Field<f64>,
    /// Number of ON events of a pixel per second. Unit: Hz. Default: `0`.
    pub on: Field<f64>,
    /// Number of OFF events of a pixel per second. Unit: Hz. Default: `0`.
    pub off: Field<f64>,
}

/// Noise of the photoreceptor: a voltage of limited bandwidth, added to the signal. An excursion that makes
/// an ON event makes an OFF event on its way back.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct PhotoreceptorNoiseSection {
    /// Standard deviation of the logarithm of a pixel's amplitude, over the pixels. Default: `0`.
    pub spread: Field<f64>,
    /// Amplitude and bandwidth against light; `[]` for none. Default: the preset's.
    pub points: Field<Vec<Field<ReceptorPointSection>>>,
}

/// Noise of the photoreceptor at one light. Logarithms are linear in between; the nearest point holds
/// outside.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ReceptorPointSection {
    /// Light on the sensor; rises from point to point. Unit: lux. Required.
    pub lux: Field<f64>,
    /// Standard deviation of the voltage of the median pixel, as a contrast. Required.
    pub deviation: Field<f64>,
    /// Bandwidth: the frequency at which the spectrum has fallen to a half. Unit: Hz. Required.
    pub cutoff_hz: Field<f64>,
}

/// Bandwidth of the pixels: a low-pass filter of the logarithm of the brightness. Events follow it, so dark
/// pixels are late, and fast changes make fewer events.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct BandwidthSection {
    /// Number of equal stages in a row. Default: `1`.
    pub order: Field<u64>,
    /// Cutoff against light; `[]` for no filter. Default: the preset's.
    pub points: Field<Vec<Field<BandwidthPointSection>>>,
}

/// Bandwidth at one light. Logarithms are linear in between; the nearest point holds outside.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct BandwidthPointSection {
    /// Light on the sensor; rises from point to point. Unit: lux. Required.
    pub lux: Field<f64>,
    /// Cutoff of a stage: the frequency at which half of the power passes. Unit: Hz. Required.
    pub cutoff_hz: Field<f64>,
}

/// Delay of events after the crossing of their thresholds. Events of a pixel keep their order.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct LatencySection {
    /// Mean delay in bright light. Unit: us. Required.
    pub us: Field<f64>,
    /// Standard deviation of the delay. Unit: us. Default: `0`.
    pub jitter_us: Field<f64>,
    /// Addition to the mean delay at 1000 lux, inversely proportional to the light: the time constant of
    /// the photoreceptor. Unit: us. Default: `0`.
    pub tau_us: Field<f64>,
    /// Largest delay. Unit: us. Default: `10000`.
    pub max_us: Field<f64>,
}

/// Bus between the pixels and the stream. Waiting events are late, and further events of their pixels
/// are lost.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct ReadoutSection {
    /// Largest number of events per second. Unit: million events per second. Required.
    pub rate_mev_s: Field<f64>,
    /// Order in which waiting events are read: `rows`, `columns`, or `none` for the order of the
    /// events. Default: `rows`.
    pub arbiter: Field<ArbiterOrder>,
    /// Largest number of waiting events; further ones are lost. Default: no bound.
    pub queue: Field<u64>,
}

/// The defaults are the encoded luminance that the published simulators read.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct FrontEndSection {
    /// Weights of red, green and blue. Default: `rec601`.
    pub luminance: Field<LuminanceSection>,
    /// Decoding of the colours before they are weighted. Default: `none`.
    pub decode: Field<ChannelDecode>,
    /// Factor on the brightness. Default: `1`.
    pub exposure: Field<f64>,
    /// Range to which brightness is clamped. Default: `{}`.
    pub range: Field<RangeSection>,
    /// Light on the sensor at grey 255. Only the presets `davis346`, `evk4` and `dvxplorer`, a `floor` and
    /// a latency with `tau_us` depend on it; other sensors refuse it. Unit: lux. Default: 250, or none for
    /// other sensors.
    pub lux: Field<f64>,
}

/// Weights of the colours.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum LuminanceSection {
    /// 0.299, 0.587, 0.114 (ITU-R BT.601).
    Rec601,
    /// 0.2126, 0.7152, 0.0722 (ITU-R BT.709).
    Rec709,
    /// Three weights from 0 to 1 that sum to 1: `{ weights: [0.25, 0.5, 0.25] }`.
    Weights(Field<[Field<f64>; 3]>),
}

/// Limits of the brightness in greys; white is 255.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct RangeSection {
    /// Lowest brightness. Unit: grey. Default: `0`.
    pub min: Field<f64>,
    /// Highest brightness. Unit: grey. Default: no bound.
    pub max: Field<f64>,
}
