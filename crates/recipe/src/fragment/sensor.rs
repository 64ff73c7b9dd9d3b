//! Sensors from a fragment of a recipe.

use super::all_but;
use crate::fault::{RecipeFault, RecipeFaults};
use crate::load::RecipeParts;
use gs2e_sensor::{SensorChoice, SensorSet};
use std::collections::BTreeMap;
use std::path::Path;

/// The key of the only sensor, and the key of several.
const SENSOR: &str = "sensor";

const SENSORS: &str = "sensors";

/// Replacement for the other keys. The check of the noise per frame interval needs an interval; it uses
/// one microsecond here.
const STAND_IN_FOR_THEM: &str = "version: 1\nscene: sensor\nsource: { procedural: {} }\n\
    trajectories: [{ name: base, refine: {} }]\nsampling: { rate: 1000000 }\n";

/// Reads the sensor of a file. The file contains either the content of the key `sensor` or a
/// recipe. Of a recipe, only the sensors and `sampling` are read. `name` is the name of one of
/// `sensors`, and is wanted exactly if the recipe has this key. Numbers with a law are drawn with seed 0.
///
/// # Errors
/// The fragment has faults, or has no sensor of this name.
pub fn read_sensor(path: &Path, name: Option<&str>) -> Result<SensorChoice, RecipeFaults> {
    draw_sensor(path, name, 0).map(|(sensor, _)| sensor)
}

/// Like [`read_sensor`], with the numbers drawn for a seed, and their list by path.
///
/// # Errors
/// As [`read_sensor`].
pub fn draw_sensor(
    path: &Path,
    name: Option<&str>,
    seed: u64,
) -> Result<(SensorChoice, BTreeMap<String, f64>), RecipeFaults> {
    let read = || sensor_of(RecipeParts::without_defaults(path)?, path, name, seed);
    read().map_err(RecipeFaults::new)
}

/// Reads a sensor from a text with the same content as a file of [`read_sensor`]. Faults name the text
/// as `display_path`.
///
/// # Errors
/// As [`read_sensor`].
pub fn sensor_from_text(
    text: String,
    display_path: &Path,
    name: Option<&str>,
) -> Result<SensorChoice, RecipeFaults> {
    let read = || sensor_of(RecipeParts::of_text(display_path, text)?, display_path, name, 0);
    read().map(|(sensor, _)| sensor).map_err(RecipeFaults::new)
}

fn sensor_of(
    parts: RecipeParts,
    path: &Path,
    name: Option<&str>,
    seed: u64,
) -> Result<(SensorChoice, BTreeMap<String, f64>), Vec<RecipeFault>> {
    let refusal = |message: String, help: &str| vec![RecipeFault::of_file(path, &message, Some(help))];
    let has_names = parts.has(SENSORS);
    if let Some(name) = name.filter(|_| !has_names) {
        let message = format!("it has one sensor without a name, asked for is {name}");
        return Err(refusal(message, "leave the name out"));
    }
    // The content of the key may stand alone in the file.
    let parts = if has_names || parts.has(SENSOR) { parts } else { parts.under(SENSOR) };
    // The keys of a recipe that affect its sensors.
    let kept = ["version", "preset", "group", if has_names { SENSORS } else { SENSOR }, "sampling"];
    let others = format!("{STAND_IN_FOR_THEM}seed: {seed}\n");
    let recipe = parts.standing_in(&all_but(&kept), &others).with_ranges().resolved()?;
    // The stand-in has one trajectory.
    let drawn = recipe.trajectories.into_iter().find_map(|trajectory| trajectory.drawn);
    let (sensors, mut numbers) = match drawn {
        Some(drawn) => (drawn.sensors, drawn.numbers),
        None => (recipe.sensors, BTreeMap::new()),
    };
    let mut sensors = match sensors {
        SensorSet::One(sensor) => return Ok((sensor, numbers.remove("").unwrap_or_default())),
        SensorSet::Named(sensors) => sensors,
    };
    let names = sensors.keys().cloned().collect::<Vec<_>>().join(", ");
    let Some(name) = name else {
        let help = "name one after a colon, such as recipe.yaml:noisy";
        return Err(refusal(format!("it has several sensors: {names}"), help));
    };
    match sensors.remove(name) {
        Some(sensor) => Ok((sensor, numbers.remove(name).unwrap_or_default())),
        None => Err(refusal(format!("it has no sensor {name}"), &format!("its sensors are {names}"))),
    }
}
