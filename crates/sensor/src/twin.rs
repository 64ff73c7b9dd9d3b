//! Noise-free twins: two sensors of a set that differ only in noise.
//!
//! A sensor is the twin of another if the other has noise and, without it, equals the sensor.
//! Labels and parameters without effect do not count.
//!
//! # Examples
//!
//! ```
//! use gs2e_sensor::{SensorChoice, SensorSet};
//! use std::collections::BTreeMap;
//!
//! let noisy = SensorChoice::by_name("v2e-noisy").ok_or("there is no such sensor")?;
//! let clean = noisy.without_noise();
//! let set = SensorSet::Named(BTreeMap::from([("a".to_owned(), noisy), ("b".to_owned(), clean)]));
//! // The sensor `b` is the noise-free twin of `a`.
//! assert_eq!(set.twins(), [("b", "a")]);
//! assert!(set.near_twins().is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{SensorChoice, SensorSet};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of differing parameters of a near twin. More differences are no oversight.
const NEAR: usize = 3;

/// A sensor without noise that a few parameters keep from being a twin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NearTwin {
    /// The sensor without noise.
    pub name: String,
    /// The sensor with noise.
    pub noisy: String,
    /// The parameters in which they differ, apart from noise, as recipes write them.
    pub differing: Vec<String>,
}

/// The name of the first sensor with noise that equals `sensor` without its noise. Sensors without a
/// name are passed over.
pub fn twin_of<'s>(
    sensor: &SensorChoice,
    mut all: impl Iterator<Item = (Option<&'s str>, &'s SensorChoice)>,
) -> Option<&'s str> {
    let quiet = sensor.effective();
    let is_twin = |other: &SensorChoice| {
        let noisy = other.effective();
        noisy != quiet && noisy.without_noise().effective() == quiet
    };
    all.find(|(_, other)| is_twin(other))?.0
}

impl SensorSet {
    /// Each noise-free twin with the sensor whose twin it is, in the order of names.
    #[must_use]
    pub fn twins(&self) -> Vec<(&str, &str)> {
        let own = self.iter().filter_map(|(name, own)| Some((name?, own)));
        own.filter_map(|(name, own)| Some((name, twin_of(own, self.iter())?))).collect()
    }

    /// The sensors without noise that are no twins and differ from a sensor of the same model with
    /// noise in at most three parameters, each with the nearest such sensor.
    #[must_use]
    pub fn near_twins(&self) -> Vec<NearTwin> {
        let named = || self.iter().filter_map(|(name, sensor)| Some((name?, sensor)));
        let alone = named().filter(|(_, own)| !own.has_noise() && twin_of(own, self.iter()).is_none());
        let nearest = |(name, own): (&str, &SensorChoice)| {
            let noisy = named().filter(|(_, other)| other.has_noise() && other.name() == own.name());
            let apart = noisy.map(|(noisy, other)| NearTwin {
                name: name.to_owned(),
                noisy: noisy.to_owned(),
                differing: differing_parameters(own, &other.without_noise()),
            });
            apart.min_by_key(|near| near.differing.len()).filter(|near| near.differing.len() <= NEAR)
        };
        alone.filter_map(nearest).collect()
    }
}

/// The parameters in which two sensors of one model differ, in the order of their names.
fn differing_parameters(a: &SensorChoice, b: &SensorChoice) -> Vec<String> {
    let [a, b] = [a, b].map(|sensor| {
        let mut all = BTreeMap::new();
        let written = serde_json::to_value(sensor.effective()).unwrap_or_default();
        // The outermost key is the model.
        written.as_object().into_iter().flatten().for_each(|(_, model)| flatten("", model, &mut all));
        all
    });
    let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    names.into_iter().filter(|name| a.get(*name) != b.get(*name)).cloned().collect()
}

/// Adds each scalar of a value with its path: `threshold.on`, and `k1` for the first of `k`.
fn flatten(path: &str, value: &Value, out: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                // The model of DVS-Voltmeter keeps the three keys of `threshold` apart.
                let key = key.replacen("threshold_", "threshold.", 1);
                let path = if path.is_empty() { key } else { format!("{path}.{key}") };
                flatten(&path, value, out);
            }
        }
        Value::Array(items) => {
            items.iter().zip(1..).for_each(|(item, i)| flatten(&format!("{path}{i}"), item, out));
        }
        scalar => {
            out.insert(path.to_owned(), scalar.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorSettings;
    use crate::esim::EsimModel;
    use crate::noise::{HotPixelNoise, RedrawRule, ThresholdMismatch};
    use crate::v2e::{FilterSteps, LeakNoise, V2eModel, V2ePreset};

    fn set<const N: usize>(sensors: [(&str, SensorChoice); N]) -> SensorSet {
        SensorSet::Named(sensors.map(|(name, sensor)| (name.to_owned(), sensor)).into())
    }

    fn v2e(change: impl FnOnce(&mut V2eModel)) -> SensorChoice {
        let mut model = V2eModel::from(V2ePreset::Noisy);
        change(&mut model);
        SensorChoice::V2e(model)
    }

    fn quiet(model: &mut V2eModel) {
        (model.leak.rate, model.shot) = (0.0, 0.0);
    }

    #[test]
    fn parameters_without_effect_do_not_separate_twins() {
        let t = |clean: SensorChoice, noisy: SensorChoice, wanted: bool| {
            let set = set([("clean", clean), ("noisy", noisy)]);
            assert_eq!(set.twins(), if wanted { vec![("clean", "noisy")] } else { vec![] }, "{set:?}");
        };
        // The preset's jitter and cov stay, and act on a rate of 0.
        t(v2e(quiet), v2e(|_| ()), true);
        let other = LeakNoise { rate: 0.0, jitter: 0.7, cov: 0.2 };
        t(v2e(|v| (v.leak, v.shot) = (other, 0.0)), v2e(|_| ()), true);
        let silent = HotPixelNoise { share: 0.5, rate: 0.0, ..HotPixelNoise::default() };
        t(v2e(|v| (quiet(v), v.settings.hot_pixels = silent).1), v2e(|_| ()), true);
        t(v2e(|v| (quiet(v), v.filter = FilterSteps::Euler).1), v2e(|_| ()), false);
        let unfiltered = |steps| move |v: &mut V2eModel| (v.cutoff, v.filter) = (0.0, steps);
        t(
            v2e(|v| (quiet(v), unfiltered(FilterSteps::Euler)(v)).1),
            v2e(unfiltered(FilterSteps::Exact)),
            true,
        );
        let hot = HotPixelNoise { share: 0.5, rate: 3.0, ..HotPixelNoise::default() };
        let esim = |spread, mismatch, hot_pixels| {
            let threshold = ThresholdMismatch { on: 0.2, off: 0.2, spread };
            SensorChoice::Esim(EsimModel {
                threshold,
                mismatch,
                settings: SensorSettings { hot_pixels, ..SensorSettings::default() },
                ..EsimModel::default()
            })
        };
        let none = HotPixelNoise::default();
        t(esim(0.0, RedrawRule::PerFrame, none), esim(0.0, RedrawRule::PerSensor, hot), true);
        t(esim(0.1, RedrawRule::PerFrame, none), esim(0.1, RedrawRule::PerSensor, hot), false);
        t(esim(0.1, RedrawRule::PerSensor, none), esim(0.1, RedrawRule::PerSensor, hot), true);
        // Two sensors without noise are no pair.
        t(v2e(quiet), v2e(|v| (quiet(v), v.leak.jitter = 0.3).1), false);
    }

    #[test]
    fn near_twins_name_the_parameters_between_them() {
        let clean = || SensorChoice::V2e(V2eModel::from(V2ePreset::Clean));
        let noisy = || v2e(|_| ());
        let far = || v2e(|v| (v.cutoff, v.threshold.on, v.threshold.off) = (5.0, 0.9, 0.8));
        let near = |set: &SensorSet| -> Vec<String> {
            let found = set.near_twins();
            found.iter().map(|n| format!("{} {}: {}", n.name, n.noisy, n.differing.join(", "))).collect()
        };
        let all = set([("clean", clean()), ("far", far()), ("noisy", noisy())]);
        assert_eq!(near(&all), ["clean noisy: cutoff, threshold.spread"]);
        assert!(near(&set([("clean", clean()), ("far", far())])).is_empty());
        assert!(near(&set([("clean", v2e(quiet)), ("noisy", noisy())])).is_empty());
        assert!(near(&SensorSet::One(noisy())).is_empty());
        let voltmeter = |k: [f64; 6], on: f64| {
            let model = crate::voltmeter::VoltmeterModel::new(k);
            SensorChoice::Voltmeter(crate::voltmeter::VoltmeterModel { threshold_on: on, ..model })
        };
        let pair = set([
            ("a", voltmeter([5.0, 21.0, 0.0, 0.0, 0.0, 0.0], 0.5)),
            ("b", voltmeter([5.0, 20.0, 1e-4, 1e-8, 1e-9, 1e-5], 1.0)),
        ]);
        assert_eq!(near(&pair), ["a b: k2, threshold.on"]);
    }
}
