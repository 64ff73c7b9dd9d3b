//! The answers of v2e to what is asked of any sensor.

use super::{FilterSteps, LeakNoise, V2eModel, presets};
use crate::SensorChoice;
use crate::noise::ThresholdMismatch;
use crate::parameters::{SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{ConstantLightNoise, ScreenError, SensorScreening};
use crate::voltmeter::BetweenFrames;
use gs2e_num::units::Hertz;
use serde_json::{Value, json};

pub(crate) static FACTS: SensorFacts = SensorFacts {
    name: "v2e",
    title: "v2e",
    publication: "Hu et al., CVPRW 2021",
    ranges: Some(presets::RANGES),
};

impl From<V2eModel> for SensorChoice {
    fn from(model: V2eModel) -> Self {
        Self::V2e(model)
    }
}

impl SensorParameters for V2eModel {
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
        Self { threshold: ThresholdMismatch { on, off, ..self.threshold }, ..self.clone() }.into()
    }

    fn dead_us(&self) -> i64 {
        self.refractory.whole_us()
    }

    fn without_noise(&self) -> SensorChoice {
        Self { leak: LeakNoise::default(), shot: 0.0, ..self.clone() }.into()
    }

    fn without_idle(&self) -> SensorChoice {
        let leak = if self.leak.rate == 0.0 { LeakNoise::default() } else { self.leak };
        let filter = if self.cutoff == 0.0 { FilterSteps::default() } else { self.filter };
        Self { leak, filter, ..self.clone() }.into()
    }

    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        Self::screen(self, rate)
    }

    fn brightness(&self, grey: f64) -> f64 {
        super::lin_log(grey)
    }

    fn contrast_spread(&self) -> f64 {
        self.threshold.spread
    }

    fn settling_seconds(&self, grey: f64) -> f64 {
        if self.cutoff > 0.0 { self.filter_seconds(grey) } else { 0.0 }
    }

    fn noise_at(&self, grey: f64) -> ConstantLightNoise {
        self.array_noise(grey)
    }

    fn released(&self) -> Value {
        json!(self)
    }
}
