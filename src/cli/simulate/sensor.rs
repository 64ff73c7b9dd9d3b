//! Which sensor: a preset or a file, and what the command line says otherwise.

use super::Simulate;
use crate::cli::problem::Problem;
use crate::recipe::read_sensor;
use crate::sensor::Sensor;
use crate::sensor::voltmeter::{Preset, Voltmeter};
use serde::Serialize;
use std::path::Path;

/// The sensor that is asked for.
pub(super) fn choose(asked: &Simulate) -> Result<Sensor, Problem> {
    let sensor = read(&asked.sensor)?;
    Ok(match sensor {
        Sensor::Voltmeter(found) => Sensor::Voltmeter(Voltmeter {
            law: asked.law.unwrap_or(found.law),
            gain: asked.gain.unwrap_or(found.gain),
            between: asked.between.unwrap_or(found.between),
            initial: asked.initial.unwrap_or(found.initial),
            ..found
        }),
    })
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

/// The most events of a pixel between two frames, and the same sensor without that cap.
pub(super) fn without_cap(sensor: &Sensor) -> (u32, Sensor) {
    match sensor {
        Sensor::Voltmeter(voltmeter) => {
            let free = Voltmeter { max_events_per_pixel_frame: u32::MAX, ..voltmeter.clone() };
            (voltmeter.max_events_per_pixel_frame, Sensor::Voltmeter(free))
        }
    }
}

/// Cubics with given slopes need them.
pub(super) fn check_rates(sensor: &Sensor, given: bool) -> Result<(), Problem> {
    let between = match sensor {
        Sensor::Voltmeter(voltmeter) => name(&voltmeter.between),
    };
    if between == "hermite" && !given {
        let what = "hermite goes by the luminance's change per second, and none is given".to_owned();
        return Err(Problem::usage("rates-missing", what).help("--rates: a .npy of float32, one a pixel"));
    }
    if between != "hermite" && given {
        let what = format!("--rates is for hermite, and between the frames it is {between}");
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
