//! ESIM as written.

use super::{
    ContrastSection, FrontEndSection, HotPixelsSection, LatencySection, ReadoutSection, RefractorySection,
    ThresholdSection,
};
use crate::field::Field;
use gs2e_sensor::esim::IntensityScale;
use gs2e_sensor::noise::RedrawRule;
use serde::Deserialize;

/// Brightness is `ln(eps + L/255)`, or `L/255`; thresholds are differences of it.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct EsimSection {
    /// Named set of the keys below: `trainable`, without noise and dead time, for methods that learn from
    /// events; or `randomised`, which has ranges from which numbers are drawn. Default: none.
    pub preset: Field<String>,
    /// Contrast thresholds. Default: `{ on: 0.2, off: 0.2, spread: 0 }`.
    pub threshold: Field<ThresholdSection>,
    /// Contrasts of one event, instead of `threshold`. Default: none.
    pub contrast: Field<ContrastSection>,
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
    /// Delay of the events. Default: none.
    pub latency: Field<LatencySection>,
    /// Limit of the rate of events. Default: none.
    pub readout: Field<ReadoutSection>,
}
