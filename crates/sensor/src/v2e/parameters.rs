//! The answers of v2e to what is asked of any sensor.

use super::{FilterSteps, LeakNoise, V2eModel, presets};
use crate::SensorChoice;
use crate::noise::ThresholdMismatch;
use crate::noise::mismatch::FLOOR;
use crate::parameters::{SensorFacts, SensorParameters, SensorSettings};
use crate::screening::{
    ConstantLightNoise, LIMIT_PER_FRAME, ScreenError, SensorScreening, array_mean, at_least_zero, normal_mean,
};
use gs2e_num::units::Hertz;
use serde_json::{Value, json};
use std::f64::consts::LN_10;

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
        self.settings
    }

    fn with_contrast(&self, on: f64, off: f64) -> SensorChoice {
        Self { threshold: ThresholdMismatch { on, off, ..self.threshold }, ..self.clone() }.into()
    }

    fn without_noise(&self) -> SensorChoice {
        Self { leak: LeakNoise::default(), shot: 0.0, ..self.clone() }.into()
    }

    fn without_idle(&self) -> SensorChoice {
        let leak = if self.leak.rate == 0.0 { LeakNoise::default() } else { self.leak };
        let filter = if self.cutoff == 0.0 { FilterSteps::default() } else { self.filter };
        Self { leak, filter, ..self.clone() }.into()
    }

    fn validate(&self) -> Result<(), ScreenError> {
        self.threshold.validate()?;
        let LeakNoise { rate, jitter, cov } = self.leak;
        at_least_zero("cutoff", self.cutoff)?;
        at_least_zero("leak.rate", rate)?;
        at_least_zero("leak.jitter", jitter)?;
        at_least_zero("leak.cov", cov)?;
        at_least_zero("shot", self.shot)?;
        self.settings.validate()
    }

    fn screen(&self, rate: Hertz) -> Result<SensorScreening, ScreenError> {
        let screened = SensorScreening::new("ln L (above grey 20)", self.threshold.sides(), rate, self)?;
        // Without shots, which reset the leak. The mean of a log-normal factor is `exp` of half the
        // variance of its logarithm.
        let LeakNoise { rate: leak, jitter, cov } = self.leak;
        // A jitter above 1 turns the leak around in some frames. The OFF events of those count as
        // well.
        let (frames_per_second, share) = (rate.to_f64(), jitter.max(1.0));
        let hz = leak * share * libm::exp(0.5 * (cov * LN_10) * (cov * LN_10));
        let per_frame = hz / frames_per_second;
        if per_frame > LIMIT_PER_FRAME {
            return Err(ScreenError::Leak { hz, per_frame, frames_per_second });
        }
        Ok(screened)
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

    fn array_noise(&self, grey: f64) -> ConstantLightNoise {
        let sides = self.threshold.sides();
        let of_law = array_mean(sides, self.threshold.spread, [FLOOR; 2], |[on, off]| {
            let shares = [sides[0] / on, sides[1] / off];
            // The leak rate is log-normal over the pixels.
            let deviation = self.leak.cov * LN_10;
            let leaky = |z: f64| self.noise_of(grey, shares, libm::exp(deviation * z));
            if deviation == 0.0 { leaky(0.0) } else { normal_mean(leaky) }
        });
        of_law.plus([self.settings.hot_pixels.mean_hz(), 0.0])
    }

    fn released(&self) -> Value {
        json!(self)
    }
}
