//! The sensor of a recipe, one of a closed family.

use super::latency::PixelLatency;
use super::noise::{self, HotPixelNoise};
use super::readout::ReadoutBus;
use super::screening::{ScreenError, SensorScreening};
use super::voltmeter::{self, BetweenFrames};
use super::{SensorFacts, SensorModel, SensorSettings, esim, v2e};
use gs2e_num::units::Hertz;
use serde::{Deserialize, Serialize};

/// A sensor, as chosen by a recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorChoice {
    /// The stochastic model of DVS-Voltmeter.
    Voltmeter(voltmeter::VoltmeterModel),
    /// Thresholds on the logarithm, as in ESIM.
    Esim(esim::EsimModel),
    /// A low-pass filter, leak and shot noise, as in v2e.
    V2e(v2e::V2eModel),
}

impl SensorChoice {
    /// The models of the family.
    pub const FAMILY: [&'static SensorFacts; 3] = [&voltmeter::FACTS, &esim::FACTS, &v2e::FACTS];

    /// The model of the chosen sensor: the only match over the family. Other files ask the model.
    #[must_use]
    pub fn as_model(&self) -> &dyn SensorModel {
        match self {
            Self::Voltmeter(sensor) => sensor,
            Self::Esim(sensor) => sensor,
            Self::V2e(sensor) => sensor,
        }
    }

    /// The parameters of DVS-Voltmeter, if the sensor is one.
    #[must_use]
    pub fn as_voltmeter(&self) -> Option<&voltmeter::VoltmeterModel> {
        if let Self::Voltmeter(sensor) = self { Some(sensor) } else { None }
    }

    /// The name of the model in recipes.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.as_model().facts().name
    }

    /// The interpolation of brightness between frames.
    #[must_use]
    pub fn between(&self) -> BetweenFrames {
        self.as_model().between()
    }

    /// Minimum time between two events of one pixel, in whole microseconds as files stamp them; 0
    /// without a refractory period.
    #[must_use]
    pub fn dead_us(&self) -> i64 {
        self.as_model().dead_us()
    }

    /// The bus behind the pixels, if its rate is limited.
    #[must_use]
    pub fn readout(&self) -> Option<ReadoutBus> {
        self.as_model().settings().readout
    }

    /// The delays of the events, if they are late.
    #[must_use]
    pub fn latency(&self) -> Option<PixelLatency> {
        self.as_model().settings().latency.filter(|latency| !latency.is_absent())
    }

    /// The sensor with events at the times of their crossings.
    #[must_use]
    pub fn without_latency(&self) -> Self {
        let settings = self.as_model().settings();
        self.as_model().with_settings(SensorSettings { latency: None, ..settings })
    }

    /// The sensor with a label on each event, signal or noise.
    #[must_use]
    pub fn with_labels(&self) -> Self {
        let settings = self.as_model().settings();
        self.as_model().with_settings(SensorSettings { labels: true, ..settings })
    }

    /// The sensor without pixels that fire by themselves.
    #[must_use]
    pub fn without_hot_pixels(&self) -> Self {
        let settings = self.as_model().settings();
        self.as_model().with_settings(SensorSettings { hot_pixels: HotPixelNoise::default(), ..settings })
    }

    /// The pixels that fire by themselves.
    #[must_use]
    pub fn hot_pixels(&self) -> noise::HotPixelNoise {
        self.as_model().settings().hot_pixels
    }

    /// The sensor without its noise: only brightness makes events, on pixels with the same
    /// mismatch. Labels are removed as well; they change no event. Events are as late, without jitter.
    #[must_use]
    pub fn without_noise(&self) -> Self {
        let quiet = self.as_model().without_noise();
        let settings = quiet.as_model().settings();
        let hot_pixels = HotPixelNoise::default();
        let latency = settings.latency.map(PixelLatency::without_jitter);
        quiet.as_model().with_settings(SensorSettings { hot_pixels, labels: false, latency, ..settings })
    }

    /// Returns true if something other than brightness makes events.
    #[must_use]
    pub fn has_noise(&self) -> bool {
        self.effective() != self.without_noise().effective()
    }

    /// The sensor without labels, and with the default value of each parameter that has no effect
    /// because another parameter turns it off. Sensors with equal forms make equal events.
    #[must_use]
    pub fn effective(&self) -> Self {
        let own = self.as_model().without_idle();
        let mut settings = own.as_model().settings();
        settings.labels = false;
        settings.latency = settings.latency.filter(|latency| !latency.is_absent());
        if settings.hot_pixels.is_absent() {
            settings.hot_pixels = HotPixelNoise::default();
        }
        own.as_model().with_settings(settings)
    }

    /// Predicts the sensor's own behaviour at this frame rate.
    ///
    /// # Errors
    /// The parameters make no usable stream.
    pub fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        self.as_model().screen(rate)
    }
}
