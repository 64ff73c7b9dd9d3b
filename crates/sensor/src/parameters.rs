//! Questions that the rest of the program asks of any sensor. Each model answers in a file of its
//! own, next to its law.

use super::front_end::FrontEnd;
use super::latency::PixelLatency;
use super::noise::HotPixelNoise;
use super::readout::ReadoutBus;
use super::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use super::voltmeter::BetweenFrames;
use super::{SensorChoice, SimulationAccount};
use gs2e_image::Size;
use gs2e_num::units::Hertz;
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
#[derive(Debug, Clone, PartialEq)]
pub struct SensorSettings {
    /// The front end.
    pub front_end: FrontEnd,
    /// Pixels that fire by themselves.
    pub hot_pixels: HotPixelNoise,
    /// True if events beyond the cap are dropped and counted.
    pub allow_cap: bool,
    /// True if events are labelled as signal or noise.
    pub labels: bool,
    /// The delays of the events, if they are late.
    pub latency: Option<PixelLatency>,
    /// The bus behind the pixels, if its rate is limited.
    pub readout: Option<ReadoutBus>,
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

    /// The sensor with other settings of this kind.
    fn with_settings(&self, settings: SensorSettings) -> SensorChoice;

    /// The interpolation of brightness between frames.
    fn between(&self) -> BetweenFrames {
        BetweenFrames::Linear
    }

    /// The sensor with another interpolation between frames; unchanged if the model has no choice.
    fn with_between(&self, between: BetweenFrames) -> SensorChoice;

    /// The sensor with these contrast thresholds: changes of `ln` of the brightness that make one ON and
    /// one OFF event, the inverse of [`super::SensorModel::contrast`]. The spread over the pixels keeps
    /// its value.
    fn with_contrast(&self, on: f64, off: f64) -> SensorChoice;

    /// Minimum time between two events of one pixel, in whole microseconds as files stamp them; 0
    /// without a refractory period.
    fn dead_us(&self) -> i64 {
        0
    }

    /// The sensor without its noise: only brightness makes events, on pixels with the same
    /// mismatch. Labels are removed as well; they change no event.
    fn without_noise(&self) -> SensorChoice;

    /// The sensor with the default value of each parameter that has no effect because another
    /// parameter turns it off.
    fn without_idle(&self) -> SensorChoice;

    /// Predicts the sensor's own behaviour at this frame rate.
    ///
    /// # Errors
    /// The parameters make no usable stream.
    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError>;

    /// The quantity that thresholds are compared with, at a grey.
    fn brightness(&self, grey: f64) -> f64;

    /// Standard deviation of the contrast over the pixels.
    fn contrast_spread(&self) -> f64;

    /// Time constant of the pixels at a grey, seconds; 0 without a filter.
    fn settling_seconds(&self, _grey: f64) -> f64 {
        0.0
    }

    /// The mean noise of all pixels at a constant grey.
    fn noise_at(&self, grey: f64) -> ConstantLightNoise;

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
