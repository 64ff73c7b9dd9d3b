//! Sensors by name, as the command line and Python accept them.

use super::SensorChoice;
use super::esim::{EsimModel, IntensityScale};
use super::noise::ThresholdMismatch;
use super::v2e::{V2eModel, V2ePreset};
use super::voltmeter::{VoltmeterModel, VoltmeterPreset};

impl SensorChoice {
    /// The names of [`SensorChoice::by_name`].
    pub const NAMES: [&'static str; 6] = ["dvs346", "dvs240", "gs2e-si", "v2e-noisy", "v2e-clean", "esim"];

    /// The sensor with this name: a preset of the voltmeter, a preset of v2e after `v2e-`, or `esim` with its
    /// defaults.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        if let Some(preset) = VoltmeterPreset::by_name(name) {
            return Some(VoltmeterModel::new(preset.k()).into());
        }
        let v2e = name.strip_prefix("v2e-").and_then(V2ePreset::by_name);
        let v2e = v2e.map(|preset| Self::V2e(V2eModel::from(preset)));
        v2e.or_else(|| (name == "esim").then(|| Self::Esim(EsimModel::default())))
    }

    /// The sensor with these contrast thresholds: changes of `ln` of the brightness that make one ON and one
    /// OFF event. It is the inverse of [`super::SensorModel::contrast`]; the spread over the pixels keeps its
    /// value.
    #[must_use]
    pub fn with_contrast(&self, on: f64, off: f64) -> Self {
        match self.clone() {
            // The voltage moves by k1 for a change of 1 in the logarithm.
            Self::Voltmeter(model) => Self::Voltmeter(VoltmeterModel {
                threshold_on: on * model.k[0],
                threshold_off: off * model.k[0],
                ..model
            }),
            Self::Esim(model) => {
                // On the linear scale the contrast is that of a step from half of white.
                let threshold = |contrast: f64| match model.intensity {
                    IntensityScale::Log => contrast,
                    IntensityScale::Linear => libm::expm1(contrast) / 2.0,
                };
                let threshold =
                    ThresholdMismatch { on: threshold(on), off: threshold(off), ..model.threshold };
                Self::Esim(EsimModel { threshold, ..model })
            }
            Self::V2e(model) => {
                Self::V2e(V2eModel { threshold: ThresholdMismatch { on, off, ..model.threshold }, ..model })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_leads_to_a_sensor_of_its_own() {
        let found: Vec<SensorChoice> =
            SensorChoice::NAMES.iter().filter_map(|name| SensorChoice::by_name(name)).collect();
        assert_eq!(found.len(), SensorChoice::NAMES.len());
        assert!((1..found.len()).all(|i| !found[..i].contains(&found[i])));
        assert!(["v2e", "noisy", "voltmeter", ""].iter().all(|name| SensorChoice::by_name(name).is_none()));
    }

    #[test]
    fn thresholds_become_the_contrast() {
        for name in SensorChoice::NAMES {
            let sensor = SensorChoice::by_name(name).unwrap().with_contrast(0.31, 0.17);
            let (on, off) = sensor.as_model().contrast();
            assert!((on - 0.31).abs() < 1e-15 && (off - 0.17).abs() < 1e-15, "{name}: {on}, {off}");
        }
        let linear = EsimModel { intensity: IntensityScale::Linear, ..EsimModel::default() };
        let (on, _) = SensorChoice::Esim(linear).with_contrast(0.31, 0.17).as_model().contrast();
        assert!((on - 0.31).abs() < 1e-15, "{on}");
    }
}
