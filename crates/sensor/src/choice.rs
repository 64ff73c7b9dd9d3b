//! The sensor of a recipe, one of a closed family.

use super::bandwidth::PixelBandwidth;
use super::latency::PixelLatency;
use super::noise::HotPixelNoise;
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

    /// The model of the chosen sensor. Other files ask it, and match over the family nowhere.
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

    /// The sensor with another interpolation between frames; unchanged if the model has no choice.
    #[must_use]
    pub fn with_between(&self, between: BetweenFrames) -> Self {
        match self {
            Self::Voltmeter(sensor) => voltmeter::VoltmeterModel { between, ..sensor.clone() }.into(),
            other => other.clone(),
        }
    }

    /// The settings that every model has.
    #[must_use]
    pub fn settings(&self) -> SensorSettings {
        self.as_model().settings()
    }

    /// The sensor with other settings of this kind.
    #[must_use]
    pub fn with_settings(mut self, settings: SensorSettings) -> Self {
        match &mut self {
            Self::Voltmeter(sensor) => sensor.settings = settings,
            Self::Esim(sensor) => sensor.settings = settings,
            Self::V2e(sensor) => sensor.settings = settings,
        }
        self
    }

    /// Minimum time between two events of one pixel, in whole microseconds as files stamp them; 0
    /// without a refractory period.
    #[must_use]
    pub fn dead_us(&self) -> i64 {
        self.settings().refractory.whole_us()
    }

    /// The bus behind the pixels, if its rate is limited.
    #[must_use]
    pub fn readout(&self) -> Option<ReadoutBus> {
        self.settings().readout
    }

    /// The delays of the events, if they are late.
    #[must_use]
    pub fn latency(&self) -> Option<PixelLatency> {
        self.settings().delays()
    }

    /// The sensor with events at the times of their crossings.
    #[must_use]
    pub fn without_latency(&self) -> Self {
        self.clone().with_settings(SensorSettings { latency: None, ..self.settings() })
    }

    /// The sensor with pixels that follow their brightness at once; unchanged if the model has no such
    /// setting.
    #[must_use]
    pub fn without_bandwidth(&self) -> Self {
        match self {
            Self::Voltmeter(sensor) => {
                voltmeter::VoltmeterModel { bandwidth: PixelBandwidth::default(), ..sensor.clone() }.into()
            }
            other => other.clone(),
        }
    }

    /// The sensor with a label on each event, signal or noise.
    #[must_use]
    pub fn with_labels(&self) -> Self {
        self.clone().with_settings(SensorSettings { labels: true, ..self.settings() })
    }

    /// The sensor without pixels that fire by themselves.
    #[must_use]
    pub fn without_hot_pixels(&self) -> Self {
        let hot_pixels = HotPixelNoise::default();
        self.clone().with_settings(SensorSettings { hot_pixels, ..self.settings() })
    }

    /// The pixels that fire by themselves.
    #[must_use]
    pub fn hot_pixels(&self) -> HotPixelNoise {
        self.settings().hot_pixels
    }

    /// The sensor without its noise: only brightness makes events, on pixels with the same
    /// mismatch. Labels are removed as well; they change no event. Events are as late, without jitter.
    #[must_use]
    pub fn without_noise(&self) -> Self {
        let quiet = self.as_model().without_noise();
        let hot_pixels = HotPixelNoise::default();
        let latency = self.settings().latency.map(PixelLatency::without_jitter);
        quiet.with_settings(SensorSettings { hot_pixels, labels: false, latency, ..self.settings() })
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
        let mut settings = own.settings();
        settings.labels = false;
        settings.latency = settings.delays();
        if settings.hot_pixels.is_absent() {
            settings.hot_pixels = HotPixelNoise::default();
        }
        own.with_settings(settings)
    }

    /// Predicts the sensor's own behaviour at this frame rate.
    ///
    /// # Errors
    /// The parameters make no usable stream.
    pub fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        self.as_model().screen(rate)
    }
}
