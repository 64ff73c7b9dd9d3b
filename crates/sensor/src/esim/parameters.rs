//! The answers of ESIM to what is asked of any sensor.

use super::{EsimModel, IntensityScale, presets};
use crate::SensorChoice;
use crate::noise::{RedrawRule, ThresholdMismatch};
use crate::parameters::{SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use crate::voltmeter::BetweenFrames;
use gs2e_num::units::Hertz;
use serde_json::{Value, json};

pub(crate) static FACTS: SensorFacts = SensorFacts {
    name: "esim",
    title: "ESIM",
    publication: "Rebecq et al., CoRL 2018",
    ranges: Some(presets::RANGES),
};

impl From<EsimModel> for SensorChoice {
    fn from(model: EsimModel) -> Self {
        Self::Esim(model)
    }
}

impl SensorParameters for EsimModel {
    fn facts(&self) -> &'static SensorFacts {
        &FACTS
    }

    fn settings(&self) -> SensorSettings {
        let Self { front_end, hot_pixels, allow_cap, labels, latency, readout, .. } = *self;
        SensorSettings { front_end, hot_pixels, allow_cap, labels, latency, readout }
    }

    fn with_settings(&self, settings: SensorSettings) -> SensorChoice {
        let SensorSettings { front_end, hot_pixels, allow_cap, labels, latency, readout } = settings;
        Self { front_end, hot_pixels, allow_cap, labels, latency, readout, ..self.clone() }.into()
    }

    fn with_between(&self, _: BetweenFrames) -> SensorChoice {
        self.clone().into()
    }

    fn with_contrast(&self, on: f64, off: f64) -> SensorChoice {
        // On the linear scale the contrast is that of a step from half of white.
        let threshold = |contrast: f64| match self.intensity {
            IntensityScale::Log => contrast,
            IntensityScale::Linear => libm::expm1(contrast) / 2.0,
        };
        let threshold = ThresholdMismatch { on: threshold(on), off: threshold(off), ..self.threshold };
        Self { threshold, ..self.clone() }.into()
    }

    fn dead_us(&self) -> i64 {
        self.refractory.whole_us()
    }

    fn without_noise(&self) -> SensorChoice {
        // Hot pixels are its only noise.
        self.clone().into()
    }

    fn without_idle(&self) -> SensorChoice {
        let redrawn = if self.threshold.spread == 0.0 { RedrawRule::default() } else { self.mismatch };
        Self { mismatch: redrawn, ..self.clone() }.into()
    }

    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        Self::screen(self, rate)
    }

    fn brightness(&self, grey: f64) -> f64 {
        self.seen(grey)
    }

    fn contrast_spread(&self) -> f64 {
        self.threshold.spread
    }

    fn noise_at(&self, grey: f64) -> ConstantLightNoise {
        self.array_noise(grey)
    }

    fn released(&self) -> Value {
        json!(self)
    }
}
