//! The sensor: a preset or a file, with the changes that the command line requests.

use super::SimulateArgs;
use crate::cli::VerbError;
use crate::cli::words::parse_numbers;
use gs2e_files::is_there;
use gs2e_recipe::draw_sensor;
use gs2e_sensor::SensorChoice;
use gs2e_sensor::front_end::{GreyRange, LuminanceWeights};
use gs2e_sensor::voltmeter::{BetweenFrames, VoltmeterModel, VoltmeterPreset};
use std::collections::BTreeMap;
use std::path::Path;

/// The numbers of a sensor that were drawn from ranges, by path.
pub(super) type DrawnNumbers = BTreeMap<String, f64>;

/// Chooses the sensor. Options override its file, except that `--allow-cap` and `--labels` only
/// switch on.
pub(super) fn choose_sensor(asked: &SimulateArgs) -> Result<(SensorChoice, DrawnNumbers), VerbError> {
    let (sensor, drawn) = sensor_from(&asked.sensor, asked.lux, asked.seed)?;
    let of_voltmeter = [
        ("--law", asked.law.is_some()),
        ("--gain", asked.gain.is_some()),
        // The other sensors always interpolate linearly, so this value is accepted for them.
        ("--between", asked.between.is_some_and(|between| between != BetweenFrames::Linear)),
        ("--initial", asked.initial.is_some()),
    ];
    match of_voltmeter.into_iter().find(|(_, given)| *given) {
        Some((option, _)) if sensor.as_voltmeter().is_none() => {
            let own = sensor.name();
            let what = format!("{option} applies to the sensor voltmeter, but this sensor is {own}");
            Err(VerbError::usage("sensor", what).help("leave the option out"))
        }
        _ => Ok((with_settings(with_law(with_threshold(sensor, asked), asked), asked)?, drawn)),
    }
}

/// Applies the contrast thresholds.
fn with_threshold(sensor: SensorChoice, asked: &SimulateArgs) -> SensorChoice {
    match asked.threshold {
        Some((on, off)) => sensor.as_model().with_contrast(on, off),
        None => sensor,
    }
}

/// Applies the options of the voltmeter to the sensor, if it is one.
fn with_law(sensor: SensorChoice, asked: &SimulateArgs) -> SensorChoice {
    let Some(found) = sensor.as_voltmeter() else { return sensor };
    SensorChoice::from(VoltmeterModel {
        law: asked.law.unwrap_or(found.law),
        gain: asked.gain.unwrap_or(found.gain),
        between: asked.between.unwrap_or(found.between),
        initial: asked.initial.unwrap_or(found.initial),
        ..found.clone()
    })
}

/// Applies the options that concern every sensor.
fn with_settings(sensor: SensorChoice, asked: &SimulateArgs) -> Result<SensorChoice, VerbError> {
    let mut settings = sensor.settings();
    settings.allow_cap |= asked.allow_cap;
    settings.labels |= asked.labels;
    let front_end = &mut settings.front_end;
    front_end.luminance = asked.luminance.unwrap_or(front_end.luminance);
    front_end.decode = asked.decode.unwrap_or(front_end.decode);
    front_end.exposure = asked.exposure.unwrap_or(front_end.exposure);
    front_end.range = asked.range.unwrap_or(front_end.range);
    front_end.validate().map_err(|error| VerbError::usage("sensor", error.to_string()))?;
    Ok(sensor.with_settings(settings))
}

/// Reads the weights of the colours, by name or as three numbers.
pub(super) fn luminance(text: &str) -> Result<LuminanceWeights, String> {
    if !text.contains(',') {
        let named = super::parse_word(text).ok();
        let named = named.filter(|named| !matches!(named, LuminanceWeights::Weights(_)));
        let wanted = || format!("`{text}` is not rec601, rec709, or R,G,B such as 0.25,0.5,0.25");
        return named.ok_or_else(wanted);
    }
    let weights = parse_numbers(text).ok_or_else(|| format!("`{text}` is not R,G,B: three numbers"))?;
    LuminanceWeights::from_weights(weights).map_err(|error| error.to_string())
}

/// Reads the ends of a range. The upper end may be `inf`.
pub(super) fn parse_range(text: &str) -> Result<GreyRange, String> {
    let [min, max] =
        parse_numbers(text).ok_or_else(|| format!("`{text}` is not MIN,MAX, such as 0,255 or 5,inf"))?;
    // An infinite end means no clamp.
    Ok(GreyRange { min, max: Some(max).filter(|max| *max != f64::INFINITY) })
}

/// The sensor of a name or of a file. `lux` is the light of white, if the command line states it; numbers
/// with a law are drawn with `seed`.
pub(in crate::cli) fn sensor_from(
    name: &str,
    lux: Option<f64>,
    seed: u64,
) -> Result<(SensorChoice, DrawnNumbers), VerbError> {
    let path = Path::new(name);
    // A preset is hidden by a file of its name, and not by a folder.
    let is_hidden = is_there(path) && !path.is_dir();
    if let Some(lux) = lux {
        let preset = VoltmeterPreset::by_name(name).filter(|preset| preset.is_in_lux() && !is_hidden);
        return Ok((sensor_in_light(preset, name, lux)?, DrawnNumbers::new()));
    }
    if let Some(sensor) = SensorChoice::by_name(name).filter(|_| !is_hidden) {
        return Ok((sensor, DrawnNumbers::new()));
    }
    if is_there(path) {
        return Ok(draw_sensor(path, None, seed)?);
    }
    if let Some((path, sensor)) = named_in_recipe(name) {
        return Ok(draw_sensor(path, Some(sensor), seed)?);
    }
    let names = SensorChoice::NAMES.join(", ");
    Err(VerbError::usage("input-missing", format!("{name} is neither a file nor a preset: {names}")))
}

/// A preset with `lux` as the light of white.
fn sensor_in_light(preset: Option<VoltmeterPreset>, name: &str, lux: f64) -> Result<SensorChoice, VerbError> {
    let Some(preset) = preset else {
        let what = format!("--lux applies to the presets davis346, evk4 and dvxplorer, not to {name}");
        let help = "leave it out, or write front_end: { lux: 250 } in the file of the sensor";
        return Err(VerbError::usage("sensor", what).help(help));
    };
    if !(lux.is_finite() && lux > 0.0) {
        return Err(VerbError::usage("sensor", format!("--lux {lux}, wanted a finite number above 0")));
    }
    Ok(preset.model_at(lux).into())
}

/// The file and the name in `recipe.yaml:name`, if there is such a file.
pub(super) fn named_in_recipe(text: &str) -> Option<(&Path, &str)> {
    text.rsplit_once(':').map(|(path, name)| (Path::new(path), name)).filter(|(path, _)| is_there(path))
}

/// Reads the thresholds: one number, or ON,OFF.
pub(super) fn parse_threshold(text: &str) -> Result<(f64, f64), String> {
    let pair = parse_numbers(text).map(|[on, off]| (on, off));
    let both = pair.or_else(|| parse_numbers(text).map(|[both]| (both, both)));
    let is_threshold = |value: f64| value > 0.0 && value.is_finite();
    both.filter(|(on, off)| is_threshold(*on) && is_threshold(*off))
        .ok_or_else(|| format!("`{text}` is not a number above 0, nor ON,OFF such as 0.2,0.25"))
}

/// Checks that rates are given exactly if the interpolation needs them.
pub(super) fn check_rates(sensor: &SensorChoice, given: bool, coloured: bool) -> Result<(), VerbError> {
    let between = sensor.between();
    let needed = between == BetweenFrames::Hermite;
    // Rates are those of one luminance. A sensor with other weights would see another rate.
    let (code, what, help) = if needed && coloured && sensor.as_model().front_end().needs_colour() {
        let what = "hermite needs rates of change of luminance rec601, not decoded".to_owned();
        ("rates-other", what, "use grey frames in a .npy, which have one luminance")
    } else if needed && !given {
        let what = "hermite needs the change of luminance per second, and none is given".to_owned();
        ("rates-missing", what, "pass --rates with a .npy of float32, one value per pixel")
    } else if !needed && given {
        let what = format!("--rates applies to hermite, but the sensor interpolates with {}", between.name());
        ("rates-unused", what, "add --between hermite, or leave --rates out")
    } else {
        return Ok(());
    };
    Err(VerbError::usage(code, what).help(help))
}
