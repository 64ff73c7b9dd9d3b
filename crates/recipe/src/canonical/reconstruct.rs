//! Canonical form of a training.

use crate::schema;
use gs2e_scene::dynamic::{SceneSpan, SceneTime};
use gs2e_source::reconstruct::{ArgumentTemplate, TrainerCommand};
use gs2e_train::TrainingSettings;
use serde_json::{Map, Value, json};

/// Returns the time of a scene that changes by itself.
pub(crate) fn time_value(time: &SceneTime) -> Value {
    let (key, value) = match time.span {
        SceneSpan::Duration(seconds) => ("duration", seconds),
        SceneSpan::Rate(hertz) => ("rate", hertz),
    };
    json!({ "start": time.start, "speed": time.speed, key: value })
}

/// Returns all known fields; file paths are as written.
pub(super) fn command_value(raw: &schema::RecipeSchema, command: &TrainerCommand) -> Value {
    let texts = |list: &[ArgumentTemplate]| list.iter().map(ArgumentTemplate::to_string).collect::<Vec<_>>();
    let mut out = json!({
        "program": command.program.to_string(),
        "arguments": texts(&command.arguments),
        "version": command.version,
        "licence": command.licence,
    });
    let mut add = |key: &str, value: Option<Value>| {
        if let Some(value) = value {
            out[key] = value;
        }
    };
    add("probe", command.probe.as_deref().map(|probe| json!(texts(probe))));
    add("scene", command.scene.as_ref().map(|scene| json!(scene)));
    add("iterations", command.iterations.map(|iterations| json!(iterations)));
    add("hold_out", command.hold_out.map(|every| json!(every)));
    add("gaussians", (!command.gaussians.is_any()).then(|| json!(command.gaussians)));
    let is_stated = command.min_psnr.to_bits() != TrainerCommand::MIN_PSNR_DB.to_bits();
    add("min_psnr", is_stated.then(|| json!(command.min_psnr)));
    add("environment", (!command.environment.is_empty()).then(|| json!(command.environment)));
    add("files", (!command.files.is_empty()).then(|| files_value(raw)));
    out
}

/// Returns the settings of a training inside the program. The rendering is in the recipe's own
/// section.
pub(super) fn builtin_value(training: &TrainingSettings) -> Value {
    let TrainingSettings { gaussians, iterations, resolution, seed, hold_out, until, .. } = training;
    let mut out = json!({
        "gaussians": gaussians, "iterations": iterations, "resolution": resolution, "seed": seed,
        "hold_out": hold_out,
    });
    if !until.is_none() {
        out["until"] = json!(until);
    }
    out
}

fn files_value(raw: &schema::RecipeSchema) -> Value {
    let Some((schema::ReconstructSection::Command(written), _)) = raw.reconstruct.given() else {
        return Value::Null;
    };
    let files = written.given().and_then(|(written, _)| written.files.given()).into_iter();
    let file =
        |(name, path): (&String, &crate::field::Field<String>)| Some((name.clone(), json!(path.given()?.0)));
    files.flat_map(|(files, _)| files.iter().filter_map(file)).collect::<Map<_, _>>().into()
}
