//! The sensor of a recipe, one of a closed family, and the set of sensors that share one rendering.

use super::screening::{ScreenError, SensorScreening};
use super::voltmeter::{self, BetweenFrames};
use super::{SensorModel, esim, noise, v2e};
use crate::units::Hertz;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
    /// The model of the chosen sensor.
    #[must_use]
    pub fn as_model(&self) -> &dyn SensorModel {
        match self {
            Self::Voltmeter(sensor) => sensor,
            Self::Esim(sensor) => sensor,
            Self::V2e(sensor) => sensor,
        }
    }

    /// The name of the model in recipes.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Voltmeter(_) => "voltmeter",
            Self::Esim(_) => "esim",
            Self::V2e(_) => "v2e",
        }
    }

    /// The interpolation of brightness between frames.
    #[must_use]
    pub fn between(&self) -> BetweenFrames {
        match self {
            Self::Voltmeter(sensor) => sensor.between,
            Self::Esim(_) | Self::V2e(_) => BetweenFrames::Linear,
        }
    }

    /// Minimum time between two events of one pixel, in whole microseconds as files stamp them; 0
    /// without a refractory period.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "a thousand seconds at most")]
    pub fn dead_us(&self) -> i64 {
        match self {
            Self::Voltmeter(_) => 0,
            // Stamps are rounded down, so two of them may be closer than the period, but never by
            // less than its whole microseconds.
            Self::Esim(sensor) => sensor.refractory.period_us.floor() as i64,
            Self::V2e(sensor) => sensor.refractory.period_us.floor() as i64,
        }
    }

    /// The pixels that fire by themselves.
    #[must_use]
    pub fn hot_pixels(&self) -> noise::HotPixelNoise {
        match self {
            Self::Voltmeter(sensor) => sensor.hot_pixels,
            Self::Esim(sensor) => sensor.hot_pixels,
            Self::V2e(sensor) => sensor.hot_pixels,
        }
    }

    /// The sensor without its noise: only brightness makes events, on pixels with the same
    /// mismatch. Labels are removed as well; they change no event.
    #[must_use]
    pub fn without_noise(&self) -> Self {
        let (hot_pixels, labels) = (noise::HotPixelNoise::default(), false);
        match self {
            Self::Voltmeter(sensor) => {
                let [k1, k2, ..] = sensor.k;
                // `k3` and `k6` are the noise, `k4` and `k5` the leak, which makes events without
                // brightness.
                let k = [k1, k2, 0.0, 0.0, 0.0, 0.0];
                Self::Voltmeter(voltmeter::VoltmeterModel { k, hot_pixels, labels, ..sensor.clone() })
            }
            Self::Esim(sensor) => Self::Esim(esim::EsimModel { hot_pixels, labels, ..sensor.clone() }),
            Self::V2e(sensor) => {
                let leak = v2e::LeakNoise::default();
                Self::V2e(v2e::V2eModel { leak, shot: 0.0, hot_pixels, labels, ..sensor.clone() })
            }
        }
    }

    /// The sensor without labels.
    #[must_use]
    pub fn without_labels(&self) -> Self {
        let labels = false;
        match self {
            Self::Voltmeter(sensor) => {
                Self::Voltmeter(voltmeter::VoltmeterModel { labels, ..sensor.clone() })
            }
            Self::Esim(sensor) => Self::Esim(esim::EsimModel { labels, ..sensor.clone() }),
            Self::V2e(sensor) => Self::V2e(v2e::V2eModel { labels, ..sensor.clone() }),
        }
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
        let mut own = self.without_labels();
        let hot_pixels = match &mut own {
            Self::Voltmeter(sensor) => &mut sensor.hot_pixels,
            Self::Esim(sensor) => {
                if sensor.threshold.spread == 0.0 {
                    sensor.mismatch = noise::RedrawRule::default();
                }
                &mut sensor.hot_pixels
            }
            Self::V2e(sensor) => {
                if sensor.leak.rate == 0.0 {
                    sensor.leak = v2e::LeakNoise::default();
                }
                if sensor.cutoff == 0.0 {
                    sensor.filter = v2e::FilterSteps::default();
                }
                &mut sensor.hot_pixels
            }
        };
        if hot_pixels.is_absent() {
            *hot_pixels = noise::HotPixelNoise::default();
        }
        own
    }

    /// Predicts the sensor's own behaviour at this frame rate.
    ///
    /// # Errors
    /// The parameters make no usable stream.
    pub fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        match self {
            Self::Voltmeter(sensor) => sensor.screen(rate),
            Self::Esim(sensor) => sensor.screen(rate),
            Self::V2e(sensor) => sensor.screen(rate),
        }
    }
}

/// The sensors that share one rendering.
#[derive(Debug, Clone, PartialEq)]
pub enum SensorSet {
    /// One sensor, without a name.
    One(SensorChoice),
    /// Several sensors by name.
    Named(BTreeMap<String, SensorChoice>),
}

impl SensorSet {
    /// Each sensor with its name, if it has one, in the order of names.
    pub fn iter(&self) -> impl Iterator<Item = (Option<&str>, &SensorChoice)> {
        let (one, named) = match self {
            Self::One(sensor) => (Some((None, sensor)), None),
            Self::Named(sensors) => (None, Some(sensors.iter().map(|(name, s)| (Some(name.as_str()), s)))),
        };
        one.into_iter().chain(named.into_iter().flatten())
    }
}
