//! Sensors by name, as the command line and Python accept them.

use super::SensorChoice;
use super::esim::EsimModel;
use super::v2e::{V2eModel, V2ePreset};
use super::voltmeter::VoltmeterPreset;

/// Name of ESIM with its defaults.
const ESIM: &str = "esim";

impl SensorChoice {
    /// The names of [`SensorChoice::by_name`].
    pub const NAMES: [&'static str; 9] = [
        "davis346",
        "evk4",
        "dvxplorer",
        "dvs346-paper",
        "dvs240",
        "gs2e-si",
        "v2e-noisy",
        "v2e-clean",
        ESIM,
    ];

    /// The sensor with this name: a preset of the voltmeter, a preset of v2e after `v2e-`, or `esim` with its
    /// defaults.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        if let Some(preset) = VoltmeterPreset::by_name(name) {
            return Some(preset.model().into());
        }
        let v2e = name.strip_prefix("v2e-").and_then(V2ePreset::by_name);
        let v2e = v2e.map(|preset| V2eModel::from(preset).into());
        v2e.or_else(|| (name == ESIM).then(|| EsimModel::default().into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorParameters as _;
    use crate::esim::IntensityScale;

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
            let sensor = SensorChoice::by_name(name).unwrap().as_model().with_contrast(0.31, 0.17);
            let (on, off) = sensor.as_model().contrast();
            assert!((on - 0.31).abs() < 1e-15 && (off - 0.17).abs() < 1e-15, "{name}: {on}, {off}");
        }
        let linear = EsimModel { intensity: IntensityScale::Linear, ..EsimModel::default() };
        let (on, _) = linear.with_contrast(0.31, 0.17).as_model().contrast();
        assert!((on - 0.31).abs() < 1e-15, "{on}");
    }
}
