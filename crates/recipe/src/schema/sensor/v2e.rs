//! The sensor of v2e as written.

use super::{
    ContrastSection, FrontEndSection, HotPixelsSection, LatencySection, ReadoutSection, RefractorySection,
    ThresholdSection,
};
use crate::field::Field;
use gs2e_sensor::v2e::FilterSteps;
use serde::Deserialize;

/// Every key may differ from the preset. `clean` has a threshold spread of 0.02 and no noise;
/// `noisy` has a spread of 0.05, a cutoff of 30 Hz, a leak of 0.1 Hz with jitter and cov 0.1, and
/// shot noise of 5 Hz.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct V2eSection {
    /// Named set of the keys below: `clean`, `noisy`, or `randomised`, which has ranges from which
    /// numbers are drawn. Default: `clean`.
    pub preset: Field<String>,
    /// Contrast thresholds, differences of the natural logarithm. Default: on 0.2, off 0.2, the
    /// preset's spread.
    pub threshold: Field<ThresholdSection>,
    /// Contrasts of one event, instead of `threshold`. Default: none.
    pub contrast: Field<ContrastSection>,
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
    /// Delay of the events. Default: none.
    pub latency: Field<LatencySection>,
    /// Limit of the rate of events. Default: none.
    pub readout: Field<ReadoutSection>,
}

/// Leak of the remembered level.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(crate) struct LeakSection {
    /// Number of leak events of a pixel per second. Unit: Hz. Default: the preset's.
    pub rate: Field<f64>,
    /// Standard deviation of the rate from frame to frame, as a share of it. Default: the preset's.
    pub jitter: Field<f64>,
    /// Standard deviation of the rate over the pixels. Unit: decades. Default: the preset's.
    pub cov: Field<f64>,
}
