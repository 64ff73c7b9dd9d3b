//! The merged recipe in full with all defaults, as `scene.json` shows it. It is itself a recipe,
//! with one canonical spelling.

mod objects;
mod reconstruct;
mod rig;
mod trajectory;

pub(super) use reconstruct::time_value;

use super::field::Field;
use super::{LicenceChoice, OutputKind, Recipe, ReconstructMethod, schema};
use gs2e_num::units::Ratio;
use gs2e_render::AntialiasMode;
use gs2e_scene::camera::CameraChoice;
use gs2e_sensor::voltmeter::VoltmeterPreset;
use gs2e_sensor::{SensorChoice, SensorSet};
use gs2e_source::licence::UpstreamGrant;
use serde::Serialize;
use serde_json::{Value, json};

/// Returns the canonical form of a recipe. `raw` supplies values that are shown as written: paths,
/// formulae, a literal `k`.
pub(super) fn canonical_recipe(raw: &schema::RecipeSchema, recipe: &Recipe) -> Value {
    let mut out = json!({
        "version": 1,
        "scene": recipe.scene,
        "seed": recipe.seed,
        "source": recipe.source.written(raw.source.given().map(|(source, _)| source)),
        "trajectories": trajectory::trajectory_values(raw, &recipe.trajectories),
        "sampling": sampling_value(recipe),
        "render": {
            "rules": recipe.render.rules,
            "antialiased": antialiased_value(recipe.render.antialiased),
            "background": recipe.render.background,
        },
        "outputs": recipe.outputs,
        "checks": recipe.checks,
    });
    if let Some(near) = recipe.render.near {
        out["render"]["near"] = json!(near);
    }
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
    reconstruct_value(raw, recipe).into_iter().for_each(|value| add("reconstruct", value));
    if let Some(camera) = recipe.camera {
        add("camera", camera_value(camera));
    }
    let settings =
        OutputKind::ALL.into_iter().filter_map(|output| Some((output.name(), output.settings(recipe)?)));
    settings.for_each(|(name, value)| add(name, value));
    let unit = recipe.imu.as_ref().map(|imu| json!({ "metres_per_unit": imu.metres_per_unit }));
    let lights = recipe.lights.as_ref().map(|lights| json!(lights));
    let attributes = recipe.scale.map(|scale| json!({ "scene_scale": scale.name() }));
    let group = recipe.group.as_ref().map(|group| json!(group));
    let licence = recipe.licence.as_ref().map(licence_value);
    let given = [
        ("scale", unit),
        ("lights", lights),
        ("objects", objects::objects_value(raw, &recipe.objects)),
        ("rig", rig::rig_value(raw, &recipe.rig)),
        ("attributes", attributes),
        ("group", group),
        ("licence", licence),
    ];
    given.into_iter().filter_map(|(key, value)| Some((key, value?))).for_each(|(key, value)| add(key, value));
    out
}

/// The source of the Gaussians, if the recipe states it.
fn reconstruct_value(raw: &schema::RecipeSchema, recipe: &Recipe) -> Option<Value> {
    match &recipe.reconstruct {
        Some(ReconstructMethod::Given(_)) => Some(json!({ "given": { "path": given_path(raw) } })),
        Some(ReconstructMethod::Changing(_, time)) => {
            Some(json!({ "given": { "path": given_path(raw), "time": time_value(time) } }))
        }
        Some(ReconstructMethod::Command(command)) => {
            Some(json!({ "command": reconstruct::command_value(raw, command) }))
        }
        Some(ReconstructMethod::Builtin(training)) => {
            Some(json!({ "builtin": reconstruct::builtin_value(training) }))
        }
        Some(ReconstructMethod::Newest(_)) | None => None,
    }
}

/// The fields of a domain type that have the names of recipes: all but those in `others`.
pub(super) fn fields_without(settings: impl Serialize, others: &[&str]) -> Value {
    let mut value = json!(settings);
    if let Some(fields) = value.as_object_mut() {
        fields.retain(|key, _| !others.contains(&key.as_str()));
    }
    value
}

fn camera_value(camera: CameraChoice) -> Value {
    let mut value = fields_without(camera, &["intrinsics"]);
    // The numbers of a point with a name are not the ones used, and a recipe refuses both.
    let keys = if camera.principal.is_given() { &["fx", "fy", "cx", "cy"][..] } else { &["fx", "fy"] };
    for (key, number) in keys.iter().zip(camera.intrinsics.into_iter().flatten()) {
        value[key] = json!(number);
    }
    value
}

fn licence_value(licence: &LicenceChoice) -> Value {
    let mut value = json!({ "expression": licence.expression, "holder": licence.holder });
    if let Some(UpstreamGrant { expression, granted_by, url, date }) = &licence.grant {
        value["upstream"] = json!(expression);
        value["evidence"] = json!({ "granted_by": granted_by, "url": url, "date": date });
    }
    value
}

fn sampling_value(recipe: &Recipe) -> Value {
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
    if let Some(name) = raw.and_then(schema::SensorSection::twin_of) {
        return json!({ "twin_of": written_text(name) });
    }
    let mut fields = sensor.as_model().written();
    if sensor.as_voltmeter().is_some() {
        add_constants(raw.and_then(schema::SensorSection::voltmeter), &mut fields);
    }
    json!({ sensor.name(): fields })
}

/// Adds the constants of a voltmeter as written, or the name of their preset.
fn add_constants(raw: Option<&schema::VoltmeterSection>, out: &mut Value) {
    match raw.and_then(|raw| Some((raw.k.given()?.0, raw.units.given()?.0))) {
        Some((k, units)) => {
            out["k"] = k.iter().map(|k| json!(k.given().map(|(k, _)| *k))).collect();
            out["units"] = json!(units);
        }
        None => {
            let named = raw.and_then(|raw| VoltmeterPreset::by_name(written_text(&raw.preset)?));
            out["preset"] = json!(named.unwrap_or(VoltmeterPreset::DEFAULT).name());
        }
    }
}

/// Shows an integer as a number and any other ratio as `n/d`, which recipes may contain.
pub(super) fn ratio_value(ratio: Ratio) -> Value {
    if ratio.denominator() == 1 { json!(ratio.numerator()) } else { json!(ratio.to_string()) }
}

fn antialiased_value(choice: AntialiasMode) -> Value {
    match choice {
        AntialiasMode::Auto => json!("auto"),
        AntialiasMode::On => json!(true),
        AntialiasMode::Off => json!(false),
    }
}
