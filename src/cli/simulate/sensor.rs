//! Which sensor: a preset or a file, and what the command line says otherwise.

use super::Simulate;
use crate::cli::problem::Problem;
use crate::recipe::read_sensor;
use crate::sensor::Sensor;
use crate::sensor::voltmeter::{Between, Preset, Voltmeter};
use serde::Serialize;
use std::path::Path;

/// The sensor that is asked for.
pub(super) fn choose(asked: &Simulate) -> Result<Sensor, Problem> {
    let mut sensor = read(&asked.sensor)?;
    match &mut sensor {
        Sensor::Voltmeter(found) => {
            found.law = asked.law.unwrap_or(found.law);
            found.gain = asked.gain.unwrap_or(found.gain);
            found.between = asked.between.unwrap_or(found.between);
            found.initial = asked.initial.unwrap_or(found.initial);
            found.allow_cap |= asked.allow_cap;
        }
        Sensor::Esim(found) => found.allow_cap |= asked.allow_cap,
        Sensor::V2e(found) => found.allow_cap |= asked.allow_cap,
    }
    let of_voltmeter = [
        ("--law", asked.law.is_some()),
        ("--gain", asked.gain.is_some()),
        ("--between", asked.between.is_some_and(|between| between != Between::Linear)),
        ("--initial", asked.initial.is_some()),
    ];
    match of_voltmeter.into_iter().find(|(_, given)| *given) {
        Some((option, _)) if !matches!(sensor, Sensor::Voltmeter(_)) => {
            let what = format!("{option} is of the sensor voltmeter, and this is {}", sensor.name());
            Err(Problem::usage("sensor", what).help("leave it out"))
        }
        _ => Ok(sensor),
    }
}

fn read(name: &str) -> Result<Sensor, Problem> {
    let path = Path::new(name);
    if let Some(preset) = Preset::by_name(name).filter(|_| !path.is_file()) {
        return Ok(Sensor::Voltmeter(Voltmeter::new(preset.k())));
    }
    if path.exists() {
        return Ok(read_sensor(path)?);
    }
    let names = Preset::ALL.map(Preset::name).join(", ");
    Err(Problem::usage("input-missing", format!("{name} is neither a file nor a preset: {names}")))
}

/// Cubics with given slopes need them.
pub(super) fn check_rates(sensor: &Sensor, given: bool) -> Result<(), Problem> {
    let between = sensor.between();
    if between == Between::Hermite && !given {
        let what = "hermite goes by the luminance's change per second, and none is given".to_owned();
        return Err(Problem::usage("rates-missing", what).help("--rates: a .npy of float32, one a pixel"));
    }
    if between != Between::Hermite && given {
        let what = format!("--rates is for hermite, and between the frames it is {}", name(&between));
        return Err(Problem::usage("rates-unused", what).help("--between hermite with it, or leave it out"));
    }
    Ok(())
}

/// What recipes call a value.
pub(super) fn name(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        _ => String::new(),
    }
}
