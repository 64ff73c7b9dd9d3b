//! Questions that the rest of the program asks of any sensor. Each model answers in a file of its
//! own, next to its law.

use super::front_end::FrontEnd;
use super::latency::PixelLatency;
use super::noise::{HotPixelNoise, RefractoryPeriod};
use super::readout::ReadoutBus;
use super::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use super::voltmeter::BetweenFrames;
use super::{SensorChoice, SimulationAccount};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Name and publication of a sensor model.
#[derive(Debug, PartialEq, Eq)]
pub struct SensorFacts {
    /// Name in recipes and in `scene.json`.
    pub name: &'static str,
    /// Name in texts.
    pub title: &'static str,
    /// The publication.
    pub publication: &'static str,
    /// Ranges of the preset `randomised` as YAML, if the model has it.
    pub ranges: Option<&'static str>,
}

/// Settings that every model has.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorSettings {
    /// The dead time after an event. For a voltmeter its reference is `passing`.
    pub refractory: RefractoryPeriod,
    /// Pixels with an event process of their own.
    pub hot_pixels: HotPixelNoise,
    /// Maximum number of events of one pixel between two frames. More fail the step.
    pub max_events_per_pixel_frame: u32,
    /// True if further events are dropped and counted, and the step goes on.
    pub allow_cap: bool,
    /// The front end.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub front_end: FrontEnd,
    /// True if events are labelled as signal or noise.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub labels: bool,
    /// The bus behind the pixels, if its rate is limited.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub readout: Option<ReadoutBus>,
    /// The delays of the events, if they are late.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub latency: Option<PixelLatency>,
}

impl Default for SensorSettings {
    /// A cap of 1000, and nothing else.
    fn default() -> Self {
        Self {
            refractory: RefractoryPeriod::default(),
            hot_pixels: HotPixelNoise::default(),
            max_events_per_pixel_frame: 1000,
            allow_cap: false,
            front_end: FrontEnd::default(),
            labels: false,
            readout: None,
            latency: None,
        }
    }
}

impl SensorSettings {
    /// The delays of the events, if they are late.
    pub(crate) fn delays(&self) -> Option<PixelLatency> {
        self.latency.filter(|latency| !latency.is_absent())
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// A number is outside its range, or a setting lacks one that it needs.
    pub(crate) fn validate(&self) -> Result<(), ScreenError> {
        self.refractory.validate()?;
        self.hot_pixels.validate()?;
        self.latency.map_or(Ok(()), |latency| latency.validate(&self.front_end))?;
        if self.max_events_per_pixel_frame == 0 {
            let name = "max_events_per_pixel_frame";
            return Err(ScreenError::Parameter { name, found: 0.0, wanted: "at least 1" });
        }
        Ok(())
    }
}

/// Cells of the pixels' clock over a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuietCells {
    /// Cells that were not looked into because no threshold was within reach.
    pub quiet: u64,
    /// All cells.
    pub all: u64,
    /// Negative logarithm of the largest probability that a threshold is touched in a cell that is
    /// not looked into.
    pub missed_ln: f64,
}

/// The parameters of a sensor.
pub trait SensorParameters {
    /// Name and publication of the model.
    fn facts(&self) -> &'static SensorFacts;

    /// The settings that every model has.
    fn settings(&self) -> SensorSettings;

    /// The interpolation of brightness between frames.
    fn between(&self) -> BetweenFrames {
        BetweenFrames::Linear
    }

    /// The sensor with these contrast thresholds: changes of `ln` of the brightness that make one ON and
    /// one OFF event, the inverse of [`super::SensorModel::contrast`]. The spread over the pixels keeps
    /// its value.
    fn with_contrast(&self, on: f64, off: f64) -> SensorChoice;

    /// The sensor without its noise: only brightness makes events, on pixels with the same
    /// mismatch. Labels are removed as well; they change no event.
    fn without_noise(&self) -> SensorChoice;

    /// The sensor with the default value of each parameter that has no effect because another
    /// parameter turns it off.
    fn without_idle(&self) -> SensorChoice;

    /// Checks that every parameter is within its range.
    ///
    /// # Errors
    /// A parameter is outside its range; the first one is named.
    fn validate(&self) -> Result<(), ScreenError>;

    /// Predicts the sensor's own behaviour with frames at this rate.
    ///
    /// # Errors
    /// A parameter is outside its range, or noise alone would make more than 50 events per pixel and
    /// frame interval at grey 0, 1, 16, 64, 128 or 255, or of a hot pixel.
    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError>;

    /// The quantity that thresholds are compared with, at a grey.
    fn brightness(&self, grey: f64) -> f64;

    /// Standard deviation of the contrast over the pixels.
    fn contrast_spread(&self) -> f64;

    /// Time constant of the pixels at a grey, seconds; 0 without a filter.
    fn settling_seconds(&self, _grey: f64) -> f64 {
        0.0
    }

    /// The mean noise of all pixels at a constant grey: with the spread of their parameters and with hot
    /// pixels.
    fn array_noise(&self, grey: f64) -> ConstantLightNoise;

    /// The parameters in `scene.json`.
    fn released(&self) -> Value;

    /// The parameters in a recipe's full form, except for those that a preset gives.
    fn written(&self) -> Value {
        self.released()
    }

    /// Returns true if the frames may be chosen for an error of brightness: the events then follow
    /// from the brightness alone, whatever the frames.
    fn takes_tolerance(&self) -> bool {
        false
    }

    /// The cells that the sensor did not look into over a clip of this length; `None` for sensors
    /// without a clock of cells.
    fn quiet_cells(&self, _: &SimulationAccount, _: Size, _span_us: i64) -> Option<QuietCells> {
        None
    }
}

#[cfg(test)]
mod tests {
    use crate::{esim::EsimModel, v2e, voltmeter::VoltmeterPreset};

    /// Stored products hold sensors as text, so the order of the fields is part of their bytes.
    #[test]
    fn records_keep_the_order_of_their_fields() {
        let common =
            r#""hot_pixels":{"share":0.0,"rate":0.0},"max_events_per_pixel_frame":1000,"allow_cap":false"#;
        let esim = format!(
            r#"{{"threshold":{{"on":0.2,"off":0.2,"spread":0.0}},"mismatch":"per-sensor","intensity":"log","eps":0.001,"refractory":{{"period_us":0.0,"reference":"passing"}},{common}}}"#
        );
        assert_eq!(serde_json::to_string(&EsimModel::default()).unwrap(), esim);
        assert_eq!(serde_json::from_str::<EsimModel>(&esim).unwrap(), EsimModel::default());
        let v2e = format!(
            r#"{{"threshold":{{"on":0.2,"off":0.2,"spread":0.02}},"cutoff":0.0,"filter":"exact","leak":{{"rate":0.0,"jitter":0.0,"cov":0.0}},"shot":0.0,"refractory":{{"period_us":0.0,"reference":"at-event"}},{common}}}"#
        );
        let clean = v2e::V2eModel::from(v2e::V2ePreset::Clean);
        assert_eq!(serde_json::to_string(&clean).unwrap(), v2e);
        assert_eq!(serde_json::from_str::<v2e::V2eModel>(&v2e).unwrap(), clean);
        let mut evk4 = VoltmeterPreset::Evk4.model();
        evk4.settings.hot_pixels.share = 0.5;
        evk4.settings.labels = true;
        let text = serde_json::to_string(&evk4).unwrap();
        let keys =
            ["max_events", "threshold_spread", "hot_pixels", "floor", "refractory", "front_end", "labels"];
        assert!(
            keys.map(|key| text.find(&format!("\"{key}"))).is_sorted() && !text.contains("allow_cap"),
            "{text}"
        );
        assert_eq!(serde_json::from_str::<crate::voltmeter::VoltmeterModel>(&text).unwrap(), evk4);
    }
}
