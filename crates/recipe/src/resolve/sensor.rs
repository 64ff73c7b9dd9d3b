//! The sensor: conversion of presets and units to numbers.

mod front_end;
mod models;

use super::number::RealRange;
use super::{Resolver, all};
use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::text::TextSpan;
use crate::{names, schema};
use gs2e_num::units::Hertz;
use gs2e_sensor::bandwidth::PixelBandwidth;
use gs2e_sensor::noise::{PhotoreceptorNoise, ThresholdMismatch};
use gs2e_sensor::voltmeter::{BetweenFrames, SamplerKind, VoltmeterModel, VoltmeterPreset};
use gs2e_sensor::{SensorChoice, SensorSet, SensorSettings};
use std::collections::BTreeMap;

/// Ranges of `k1` to `k6`. The gain and the offset of the logarithm are positive; standard
/// deviations are not negative.
const K: [RealRange; 6] = [
    RealRange::above(0.0, 1e12),
    RealRange::above(0.0, 1e12),
    RealRange::new(0.0, 1e12),
    RealRange::new(-1e12, 1e12),
    RealRange::new(-1e12, 1e12),
    RealRange::new(0.0, 1e12),
];

/// Contrasts of one event, in ln.
const CONTRAST: RealRange = RealRange::new(1e-4, 20.0);

impl Resolver<'_> {
    /// Resolves the one sensor, or several named sensors.
    pub(crate) fn sensors(
        &self,
        raw: &schema::RecipeSchema,
        between: Option<BetweenFrames>,
        rate: Option<Hertz>,
    ) -> Option<SensorSet> {
        let (sensors, place) = match &raw.sensors {
            Field::Absent => return self.sensor(&raw.sensor, between, rate).map(SensorSet::One),
            Field::Bad => return None,
            Field::Given(sensors, place) => (sensors, *place),
        };
        if let Some(at) = raw.sensor.place() {
            let problem = FieldProblem::of_key("and sensors exclude each other");
            return self.refuse(problem.help("move it to sensors").at(at));
        }
        if sensors.is_empty() {
            let help = "write sensors: { my-name: { voltmeter: {} } }";
            return self.refuse(FieldProblem::of_field("names no sensor").help(help).at(place));
        }
        // Of names that differ in case only, the map keeps one, and the others do not find
        // themselves.
        let lower: BTreeMap<String, &String> =
            sensors.keys().map(|name| (name.to_lowercase(), name)).collect();
        if let Some(name) = sensors.keys().find(|name| lower[&name.to_lowercase()] != *name) {
            // Sensor names are file names, and some systems ignore case.
            let found = format!(
                "has {}, which differs from {} only in case",
                quote_text(lower[&name.to_lowercase()]),
                quote_text(name)
            );
            return self.refuse(FieldProblem::of_field(found).help("choose another name").at(place));
        }
        // Every sensor is checked, so that all faults are reported.
        let mut found: BTreeMap<&str, Option<SensorChoice>> = BTreeMap::new();
        for (name, field) in sensors {
            let place = field.place().unwrap_or(place);
            let named = self.named(name, place, names::check_sensor(name), names::SENSOR_HELP);
            // Twins are resolved after the sensors that they are twins of.
            let sensor = if is_twin(field) { None } else { self.sensor(field, between, rate) };
            found.insert(name, named.and(sensor));
        }
        let twins = sensors.iter().filter_map(|(name, field)| {
            let of = field.given()?.0.twin_of()?;
            Some((name.as_str(), self.twin(name, of, sensors, &found)))
        });
        let twins: Vec<(&str, Option<SensorChoice>)> = twins.collect();
        found.extend(twins);
        let all = found.into_iter().map(|(name, sensor)| Some((name.to_owned(), sensor?)));
        all.collect::<Option<_>>().map(SensorSet::Named)
    }

    /// Resolves the twin of another sensor. `found` has the sensors that are no twins.
    fn twin(
        &self,
        twin: &str,
        of: &Field<String>,
        sensors: &BTreeMap<String, Field<schema::SensorSection>>,
        found: &BTreeMap<&str, Option<SensorChoice>>,
    ) -> Option<SensorChoice> {
        let (name, place) = of.given()?;
        let refuse = |what: &str, help: &str| {
            self.refuse(
                FieldProblem::of_field(format!("is {}, {what}", quote_text(name))).help(help).at(place),
            )
        };
        if name == twin {
            return refuse("which is the sensor itself", "name the sensor with noise");
        }
        let Some(other) = sensors.get(name) else {
            let others: Vec<&str> =
                sensors.keys().map(String::as_str).filter(|other| *other != twin).collect();
            return self.refuse(FieldProblem::unknown_name("sensor", name, &others).at(place));
        };
        if is_twin(other) {
            return refuse("which is a twin itself", "name the sensor with noise");
        }
        // A fault of the other sensor is reported there.
        let noisy = found.get(name.as_str())?.as_ref()?;
        if !noisy.has_noise() {
            return refuse(
                "which has no noise to leave out",
                "name a sensor with noise, or leave this one out",
            );
        }
        Some(noisy.without_noise())
    }

    pub(crate) fn sensor(
        &self,
        field: &Field<schema::SensorSection>,
        between: Option<BetweenFrames>,
        rate: Option<Hertz>,
    ) -> Option<SensorChoice> {
        let default = Field::Given(Box::default(), self.root);
        let (sensor, place) = match field {
            Field::Absent => (self.voltmeter_sensor(&default, between), self.root),
            Field::Bad => return None,
            Field::Given(schema::SensorSection::Voltmeter(raw), _) => {
                (self.voltmeter_sensor(raw, between), raw.place()?)
            }
            // Both parts are evaluated before a fault returns, so that both are reported.
            Field::Given(schema::SensorSection::Esim(raw), _) => {
                let (raw, place) = raw.given()?;
                let linear = self.only_linear(between, "the sensor esim", place);
                (linear.and(self.esim(raw)).map(SensorChoice::from), place)
            }
            Field::Given(schema::SensorSection::V2e(raw), _) => {
                let (raw, place) = raw.given()?;
                let linear = self.only_linear(between, "the sensor v2e", place);
                (linear.and(self.v2e(raw)).map(SensorChoice::from), place)
            }
            Field::Given(schema::SensorSection::TwinOf(_), place) => {
                let problem = FieldProblem::of_field("is a twin of another sensor, and there is no other");
                return self.refuse(problem.help("write both under sensors, each with a name").at(*place));
            }
        };
        let sensor = match field.given().and_then(|(raw, _)| raw.contrast()) {
            Some((contrast, threshold)) => self.with_contrast(sensor?, contrast, threshold)?,
            None => sensor?,
        };
        self.possible(&sensor, rate?, place).then_some(sensor)
    }

    /// Applies the contrasts of a sensor, which exclude its thresholds.
    fn with_contrast(
        &self,
        sensor: SensorChoice,
        contrast: &Field<schema::ContrastSection>,
        threshold: &Field<schema::ThresholdSection>,
    ) -> Option<SensorChoice> {
        let Some((raw, place)) = contrast.given() else { return contrast.is_absent().then_some(sensor) };
        let states = |raw: &schema::ThresholdSection| !(raw.on.is_absent() && raw.off.is_absent());
        if threshold.given().is_some_and(|(raw, _)| states(raw)) {
            let problem = FieldProblem::of_key("and threshold exclude each other");
            return self.refuse(problem.help("keep one of them: both say when an event fires").at(place));
        }
        let (on, off) = sensor.as_model().contrast();
        let [on, off] =
            [(&raw.on, on), (&raw.off, off)].map(|(field, default)| self.real(field, default, CONTRAST));
        Some(sensor.as_model().with_contrast(on?, off?))
    }

    fn voltmeter_sensor(
        &self,
        field: &Field<Box<schema::VoltmeterSection>>,
        between: Option<BetweenFrames>,
    ) -> Option<SensorChoice> {
        let (raw, place) = field.given()?;
        let found = self.voltmeter(raw, place);
        let voltmeter = VoltmeterModel { between: between?, ..found? };
        self.rates_of(&voltmeter.settings.front_end, voltmeter.between, &raw.front_end)?;
        if let Some(at) = raw.law.place().filter(|_| voltmeter.law == SamplerKind::Official) {
            self.only_linear(between, "the law official", at)?;
        }
        Some(voltmeter.into())
    }

    /// Returns true if the sensor produces a usable stream (docs/design/numerics-sensor.md,
    /// "Screening"). Otherwise it reports the fault.
    fn possible(&self, sensor: &SensorChoice, rate: Hertz, place: TextSpan) -> bool {
        let screened = sensor.screen(rate).map_err(|error| {
            let problem = FieldProblem::of_key(format!("is not a usable sensor: {error}"));
            self.report(problem.at(place));
        });
        screened.is_ok()
    }

    fn voltmeter(&self, raw: &schema::VoltmeterSection, place: TextSpan) -> Option<VoltmeterModel> {
        let k = self.k(raw, place);
        let preset = Self::preset_of(raw);
        let default = preset.map_or_else(|| VoltmeterModel::new([1.0; 6]), VoltmeterPreset::model);
        let threshold = self.threshold_in_volts(raw, &default);
        let floor = self.floor(&raw.floor, default.floor.clone());
        let photoreceptor_noise =
            self.photoreceptor_noise(&raw.photoreceptor_noise, &default.photoreceptor_noise);
        let bandwidth = self.bandwidth(&raw.bandwidth, &default.bandwidth);
        let in_lux = preset.is_some_and(VoltmeterPreset::is_in_lux)
            || floor.as_ref().is_some_and(|floor| !floor.is_absent())
            || photoreceptor_noise.as_ref().is_some_and(PhotoreceptorNoise::follows_light)
            || bandwidth.as_ref().is_some_and(PixelBandwidth::follows_light);
        let model = resolved!(VoltmeterModel {
            threshold_on: threshold.map(|threshold| threshold.on),
            threshold_off: threshold.map(|threshold| threshold.off),
            threshold_spread: threshold.map(|threshold| threshold.spread),
            law: raw.law.or(default.law),
            gain: raw.gain.or(default.gain),
            initial: raw.initial.or(default.initial),
            floor,
            photoreceptor_noise,
            bandwidth,
            settings: models::settings!(self, raw, default.settings, in_lux: in_lux),
            ..VoltmeterModel::new(k?)
        })?;
        // The constants of a preset in lux depend on the light of white.
        let k = preset.map_or(model.k, |preset| preset.model_at(model.settings.front_end.white_lux()).k);
        Some(VoltmeterModel { k, ..model })
    }

    fn k(&self, raw: &schema::VoltmeterSection, place: TextSpan) -> Option<[f64; 6]> {
        match (&raw.preset, &raw.k) {
            (Field::Bad, _) | (_, Field::Bad) => None,
            (Field::Given(_, at), Field::Given(..)) => {
                let problem = FieldProblem::of_key("and k exclude each other");
                self.refuse(problem.help("a preset is a named k").at(*at))
            }
            (preset, Field::Absent) => {
                if let Some(at) = raw.units.place() {
                    self.report(
                        FieldProblem::of_key("applies only to k: a preset has its own units")
                            .help("remove it")
                            .at(at),
                    );
                }
                self.preset(preset).map(VoltmeterPreset::k)
            }
            (Field::Absent, Field::Given(k, _)) => {
                let help =
                    "write units: { time: us, brightness: 255 }; time is us, ms or s, brightness 255 or 1";
                let units = self.required(&raw.units, "units", place, help);
                let k: Option<Vec<f64>> = all(k.iter().zip(K), |(k, range)| self.real(k, 0.0, range));
                Some(units?.0.to_official(k?.try_into().ok()?))
            }
        }
    }

    /// The preset of a voltmeter without constants of its own, if its name is known.
    fn preset_of(raw: &schema::VoltmeterSection) -> Option<VoltmeterPreset> {
        match (&raw.preset, &raw.k) {
            (Field::Absent, Field::Absent) => Some(VoltmeterPreset::DEFAULT),
            (preset, Field::Absent) => VoltmeterPreset::by_name(preset.given()?.0),
            _ => None,
        }
    }

    fn preset(&self, field: &Field<String>) -> Option<VoltmeterPreset> {
        let Some((name, place)) = field.given() else { return Some(VoltmeterPreset::DEFAULT) };
        let names = VoltmeterPreset::ALL.map(VoltmeterPreset::name);
        VoltmeterPreset::by_name(name)
            .or_else(|| self.refuse(FieldProblem::unknown_name("preset", name, &names).at(place)))
    }

    /// Resolves the thresholds of a voltmeter. They are voltages, which only the constants turn into
    /// contrasts, so a recipe that writes them names its constants too.
    fn threshold_in_volts(
        &self,
        raw: &schema::VoltmeterSection,
        default: &VoltmeterModel,
    ) -> Option<ThresholdMismatch> {
        if let (Some(at), Field::Absent, Field::Absent) = (raw.threshold.place(), &raw.preset, &raw.k) {
            let found = "has a unit of the preset's own, and the recipe names no preset";
            let help = "write preset: davis346, where a threshold of 1 is a contrast of 0.134, or preset: \
                        dvs346-paper, where it is 0.190";
            return self.refuse(FieldProblem::of_field(found).help(help).at(at));
        }
        let (on, off, spread) = (default.threshold_on, default.threshold_off, default.threshold_spread);
        self.threshold_of(&raw.threshold, ThresholdMismatch { on, off, spread })
    }
}

fn is_twin(field: &Field<schema::SensorSection>) -> bool {
    field.given().is_some_and(|(raw, _)| raw.twin_of().is_some())
}
