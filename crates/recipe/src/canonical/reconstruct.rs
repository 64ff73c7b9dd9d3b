//! Canonical form of a training.

use super::fields_without;
use crate::schema;
use gs2e_scene::dynamic::{SceneSpan, SceneTime};
use gs2e_source::reconstruct::TrainerCommand;
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
    // The fields that enter the key have the names of recipes; the others are added here.
    let mut out = json!(command);
    out["licence"] = json!(command.licence);
    let mut add = |key: &str, value: Option<Value>| {
        if let Some(value) = value {
            out[key] = value;
        }
    };
    add("probe", command.probe.as_ref().map(|probe| json!(probe)));
    add("iterations", command.iterations.map(|iterations| json!(iterations)));
    let is_stated = command.min_psnr.to_bits() != TrainerCommand::MIN_PSNR_DB.to_bits();
    add("min_psnr", is_stated.then(|| json!(command.min_psnr)));
    add("files", (!command.files.is_empty()).then(|| files_value(raw)));
    out
}

/// Returns the settings of a training inside the program. The rendering is in the recipe's own
/// section.
pub(super) fn builtin_value(training: &TrainingSettings) -> Value {
    fields_without(training, &["rules", "antialiased", "background"])
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
