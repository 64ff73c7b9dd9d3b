//! The merged recipe in full with all defaults, as `scene.json` shows it. It is itself a recipe,
//! with one canonical spelling.

mod reconstruct;
mod trajectory;

use super::field::Field;
use super::resolve::ResolvedRecipe;
use super::{LicenceChoice, OutputKind, ReconstructMethod, SceneSource, UpstreamOrigin, schema};
use crate::licence::UpstreamGrant;
use crate::render::AntialiasMode;
use crate::sensor::noise::HotPixelNoise;
use crate::sensor::voltmeter::{VoltmeterModel, VoltmeterPreset};
use crate::sensor::{SensorChoice, SensorSet};
use crate::units::Ratio;
use serde_json::{Map, Value, json};

/// Returns the canonical form of a recipe. `raw` supplies values that are shown as written: paths,
/// formulae, a literal `k`.
pub(super) fn canonical_recipe(raw: &schema::RecipeSchema, recipe: &ResolvedRecipe) -> Value {
    let mut out = json!({
        "version": 1,
        "scene": recipe.scene,
        "seed": recipe.seed,
        "source": source_value(raw, &recipe.source),
        "trajectories": trajectory::trajectory_values(raw, &recipe.trajectories),
        "sampling": sampling_value(recipe),
        "render": {
            "rules": recipe.render.rules,
            "antialiased": antialiased_value(recipe.render.antialiased),
            "background": recipe.render.background,
        },
        "outputs": recipe.outputs.iter().map(|o| output_name(*o)).collect::<Vec<_>>(),
        "sharp": { "every": recipe.every.sharp },
        "checks": recipe.checks,
    });
    let mut add = |key: &str, value: Value| out[key] = value;
    match &recipe.sensors {
        SensorSet::One(one) => add("sensor", sensor_value(raw.sensor.given().map(|(raw, _)| raw), one)),
        SensorSet::Named(named) => {
            let raw = raw.sensors.given().map(|(raw, _)| raw);
            let written = |name: &String| Some(raw?.get(name)?.given()?.0);
            add(
                "sensors",
                named.iter().map(|(name, s)| (name.clone(), sensor_value(written(name), s))).collect(),
            );
        }
    }
    let reconstruct = match &recipe.reconstruct {
        Some(ReconstructMethod::Given(_)) => Some(json!({ "given": { "path": given_path(raw) } })),
        Some(ReconstructMethod::Command(command)) => {
            Some(json!({ "command": reconstruct::command_value(raw, command) }))
        }
        Some(ReconstructMethod::Builtin(training)) => {
            Some(json!({ "builtin": reconstruct::builtin_value(training) }))
        }
        Some(ReconstructMethod::Newest(_)) | None => None,
    };
    reconstruct.into_iter().for_each(|value| add("reconstruct", value));
    if let Some(camera) = recipe.camera {
        let mut sides = json!({ "width": camera.width, "height": camera.height });
        for (key, value) in ["fx", "fy", "cx", "cy"].into_iter().zip(camera.intrinsics.into_iter().flatten())
        {
            sides[key] = json!(value);
        }
        add("camera", sides);
    }
    for (key, value) in picture_values(recipe) {
        add(key, value);
    }
    if let Some(scale) = recipe.scale {
        add("attributes", json!({ "scene_scale": scale.name() }));
    }
    if let Some(group) = &recipe.group {
        add("group", json!(group));
    }
    if let Some(licence) = &recipe.licence {
        add("licence", licence_value(licence));
    }
    out
}

fn licence_value(licence: &LicenceChoice) -> Value {
    let mut value = json!({ "expression": licence.expression, "holder": licence.holder });
    if let Some(UpstreamGrant { expression, granted_by, url, date }) = &licence.grant {
        value["upstream"] = json!(expression);
        value["evidence"] = json!({ "granted_by": granted_by, "url": url, "date": date });
    }
    value
}

/// Returns the settings of blur, depth and flow pictures, if they are requested.
fn picture_values(recipe: &ResolvedRecipe) -> impl Iterator<Item = (&'static str, Value)> {
    let said = [
        (OutputKind::Blur, "blur", json!(recipe.shutter)),
        (OutputKind::Depth, "depth", json!({ "every": recipe.every.depth })),
        (OutputKind::Flow, "flow", json!({ "every": recipe.every.flow })),
    ];
    let asked = said.into_iter().filter(|(output, ..)| recipe.outputs.contains(output));
    asked.map(|(_, key, value)| (key, value))
}

fn sampling_value(recipe: &ResolvedRecipe) -> Value {
    let mut out = json!({ "rate": ratio_value(recipe.rate.0), "law": recipe.law });
    let between = match recipe.tolerance {
        Some(tolerance) => {
            out["tolerance"] = json!(tolerance.rms);
            tolerance.between
        }
        // All sensors have the same value.
        None => recipe.sensors.iter().map(|(_, sensor)| sensor.between()).next(),
    };
    if let Some(between) = between {
        out["between"] = json!(between);
    }
    out
}

fn source_value(raw: &schema::RecipeSchema, source: &SceneSource) -> Value {
    match source {
        SceneSource::Procedural(still_life) => {
            // The fields of the still life have the names that recipes use.
            let mut fields = Map::from_iter([("kind".to_owned(), json!("still-life"))]);
            if let Ok(Value::Object(rest)) = serde_json::to_value(still_life) {
                fields.extend(rest);
            }
            json!({ "procedural": fields })
        }
        SceneSource::Captured(captured, upstream) => {
            let mut fields = Map::from_iter([("path".to_owned(), json!(source_path(raw)))]);
            if let Ok(Value::Object(rest)) = serde_json::to_value(&captured.selection) {
                fields.extend(rest);
            }
            let UpstreamOrigin { id, url, accessed, terms_accepted } = upstream;
            let said = [
                ("upstream_id", json!(id)),
                ("upstream_url", json!(url)),
                ("accessed", json!(accessed)),
                ("terms_accepted", json!(terms_accepted)),
            ];
            let said = said.into_iter().filter(|(_, value)| !value.is_null());
            fields.extend(said.map(|(key, value)| (key.to_owned(), value)));
            json!({ captured.kind.name(): fields })
        }
        SceneSource::None => json!("none"),
    }
}

/// Returns the path of a capture as written.
fn source_path(raw: &schema::RecipeSchema) -> Option<&str> {
    match raw.source.given()?.0 {
        schema::SourceSection::Colmap(folder)
        | schema::SourceSection::Nerfstudio(folder)
        | schema::SourceSection::Mvimgnet(folder)
        | schema::SourceSection::Dl3dv(folder)
        | schema::SourceSection::Model(folder) => written_text(&folder.given()?.0.path),
        schema::SourceSection::Procedural(_) | schema::SourceSection::None => None,
    }
}

fn given_path(raw: &schema::RecipeSchema) -> Option<&str> {
    match raw.reconstruct.given() {
        Some((schema::ReconstructSection::Given(given), _)) => written_text(&given.given()?.0.path),
        _ => None,
    }
}

fn written_text(field: &Field<String>) -> Option<&str> {
    field.given().map(|(text, _)| text.as_str())
}

fn sensor_value(raw: Option<&schema::SensorSection>, sensor: &SensorChoice) -> Value {
    if let Some(schema::SensorSection::TwinOf(name)) = raw {
        return json!({ "twin_of": written_text(name) });
    }
    let fields = match sensor {
        SensorChoice::Voltmeter(sensor) => voltmeter_value(raw, sensor),
        // The serialized fields have the names that recipes use.
        SensorChoice::Esim(sensor) => json!(sensor),
        SensorChoice::V2e(sensor) => json!(sensor),
    };
    json!({ sensor.name(): fields })
}

fn voltmeter_value(raw: Option<&schema::SensorSection>, voltmeter: &VoltmeterModel) -> Value {
    let mut out = json!({
        "threshold": { "on": voltmeter.threshold_on, "off": voltmeter.threshold_off },
        "law": voltmeter.law,
        "gain": voltmeter.gain,
        "initial": voltmeter.initial,
        "max_events_per_pixel_frame": voltmeter.max_events_per_pixel_frame,
    });
    if voltmeter.threshold_spread > 0.0 {
        out["threshold"]["spread"] = json!(voltmeter.threshold_spread);
    }
    if voltmeter.hot_pixels != HotPixelNoise::default() {
        out["hot_pixels"] = json!(voltmeter.hot_pixels);
    }
    if voltmeter.allow_cap {
        out["allow_cap"] = json!(true);
    }
    if !voltmeter.front_end.is_plain() {
        out["front_end"] = json!(voltmeter.front_end);
    }
    if voltmeter.labels {
        out["labels"] = json!(true);
    }
    let raw = match raw {
        Some(schema::SensorSection::Voltmeter(raw)) => raw.given().map(|(raw, _)| raw),
        _ => None,
    };
    match raw.and_then(|raw| Some((raw.k.given()?.0, raw.units.given()?.0))) {
        Some((k, units)) => {
            out["k"] = k.iter().map(|k| json!(k.given().map(|(k, _)| *k))).collect();
            out["units"] = json!(units);
        }
        None => {
            out["preset"] =
                json!(raw.and_then(|raw| written_text(&raw.preset)).unwrap_or(VoltmeterPreset::Dvs346.name()))
        }
    }
    out
}

/// Shows an integer as a number and any other ratio as `n/d`, which recipes may contain.
fn ratio_value(ratio: Ratio) -> Value {
    if ratio.denominator() == 1 { json!(ratio.numerator()) } else { json!(ratio.to_string()) }
}

fn antialiased_value(choice: AntialiasMode) -> Value {
    match choice {
        AntialiasMode::Auto => json!("auto"),
        AntialiasMode::On => json!(true),
        AntialiasMode::Off => json!(false),
    }
}

fn output_name(output: OutputKind) -> &'static str {
    match output {
        OutputKind::Events => "events",
        OutputKind::Sharp => "sharp",
        OutputKind::Blur => "blur",
        OutputKind::Depth => "depth",
        OutputKind::Flow => "flow",
    }
}
