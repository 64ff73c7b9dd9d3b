//! Sensors as they are written, beside the voltmeter.

use crate::recipe::field::Field;
use crate::sensor::esim::Intensity;
use crate::sensor::front_end::Decode;
use crate::sensor::noise::{Redraw, Reference};
use crate::sensor::v2e::Filter;
use serde::Deserialize;

/// A sensor as in ESIM.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Esim {
    pub threshold: Field<Threshold>,
    pub mismatch: Field<Redraw>,
    pub intensity: Field<Intensity>,
    pub eps: Field<f64>,
    pub refractory: Field<Refractory>,
    pub hot_pixels: Field<HotPixels>,
    pub max_events_per_pixel_frame: Field<u64>,
    pub allow_cap: Field<bool>,
    pub front_end: Field<FrontEnd>,
    /// Whether each event is labelled as signal or noise.
    pub labels: Field<bool>,
}

/// A sensor as in v2e.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct V2e {
    /// What the other keys differ from; default clean.
    pub preset: Field<String>,
    pub threshold: Field<Threshold>,
    /// Hz.
    pub cutoff: Field<f64>,
    pub filter: Field<Filter>,
    pub leak: Field<Leak>,
    /// Hz.
    pub shot: Field<f64>,
    pub refractory: Field<Refractory>,
    pub hot_pixels: Field<HotPixels>,
    pub max_events_per_pixel_frame: Field<u64>,
    pub allow_cap: Field<bool>,
    pub front_end: Field<FrontEnd>,
    pub labels: Field<bool>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Threshold {
    pub on: Field<f64>,
    pub off: Field<f64>,
    /// Over the pixels.
    pub spread: Field<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Leak {
    /// Hz.
    pub rate: Field<f64>,
    pub jitter: Field<f64>,
    pub cov: Field<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Refractory {
    pub period_us: Field<f64>,
    pub reference: Field<Reference>,
}

/// Pixels that fire by themselves.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct HotPixels {
    pub share: Field<f64>,
    /// Hz.
    pub rate: Field<f64>,
}

/// From the colours of a frame to the brightness that the pixels see.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct FrontEnd {
    pub luminance: Field<Luminance>,
    pub decode: Field<Decode>,
    /// A factor.
    pub exposure: Field<f64>,
    pub range: Field<Range>,
}

/// Weights of the colours.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::recipe) enum Luminance {
    Rec601,
    Rec709,
    Weights(Field<[Field<f64>; 3]>),
}

/// Grey.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::recipe) struct Range {
    pub min: Field<f64>,
    /// Without bound where there is none.
    pub max: Field<f64>,
}
