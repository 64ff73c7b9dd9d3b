//! The answers of ESIM to what is asked of any sensor.

use super::{EsimModel, IntensityScale, presets};
use crate::SensorChoice;
use crate::noise::{RedrawRule, ThresholdMismatch};
use crate::parameters::{SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{ConstantLightNoise, ScreenError, SensorScreening};
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
        self.settings
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

    fn without_noise(&self) -> SensorChoice {
        // Hot pixels are its only noise.
        self.clone().into()
    }

    fn without_idle(&self) -> SensorChoice {
        let redrawn = if self.threshold.spread == 0.0 { RedrawRule::default() } else { self.mismatch };
        Self { mismatch: redrawn, ..self.clone() }.into()
    }

    fn validate(&self) -> Result<(), ScreenError> {
        self.threshold.validate()?;
        // With 0, the logarithm of a black pixel would be infinite.
        if !(self.eps > 0.0 && self.eps.is_finite()) {
            let (name, wanted) = ("eps", "a finite number above 0");
            return Err(ScreenError::Parameter { name, found: self.eps, wanted });
        }
        self.settings.validate()
    }

    /// Without noise, the table has no events.
    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        let quantity = match self.intensity {
            IntensityScale::Log => "ln(L/255 + eps)",
            IntensityScale::Linear => "L/255",
        };
        SensorScreening::new(quantity, self.threshold.sides(), rate, self)
    }

    fn brightness(&self, grey: f64) -> f64 {
        self.brightness_of(grey)
    }

    fn contrast_spread(&self) -> f64 {
        self.threshold.spread
    }

    fn array_noise(&self, grey: f64) -> ConstantLightNoise {
        let quiet = ConstantLightNoise { grey, leak_hz: 0.0, total_hz: 0.0, on_share: None };
        quiet.plus([self.settings.hot_pixels.mean_hz(), 0.0])
    }

    fn released(&self) -> Value {
        json!(self)
    }
}
