//! Edits of a recipe that concern a step, by the sections that its parameters come from.

use gs2e_recipe::{Recipe, RecipeEdit, find_edits};
use gs2e_store::Store;
use serde_json::Value;

/// Sections of a recipe for each step; a step that is not listed has the section of its name. Pictures also
/// have those of [`OF_PICTURES`].
const SECTIONS: [(&str, &[&str]); 13] = [
    ("capture", &["source"]),
    ("poses", &["source"]),
    ("frames", &["source"]),
    ("reconstruct", &["reconstruct", "source", "render", "seed"]),
    ("fidelity", &["source", "render"]),
    ("checks", &["checks", "lights", "imu", "scale", "rig", "objects", "render"]),
    ("trajectory", &["trajectories", "sampling", "camera", "render", "rig", "seed", "scene"]),
    ("events", &["sensor", "sensors", "seed", "scene", "sampling", "camera", "render", "lights", "rig"]),
    ("sharp", &["sharp", "blur", "lights", "camera", "render", "rig"]),
    ("blur", &["blur", "lights", "camera", "render", "rig"]),
    ("imu", &["imu", "scale", "seed", "scene"]),
    ("foreign", &["checks", "camera"]),
    ("objects", &["objects"]),
];
const OF_PICTURES: [&str; 3] = ["camera", "render", "rig"];

/// The edits of a recipe since its scene was last built; empty if that is not known.
#[must_use]
pub fn edits_since(recipe: &Recipe, store: &Store) -> Vec<RecipeEdit> {
    let last = store.last_recipe(&recipe.scene).and_then(|text| serde_json::from_str(&text).ok());
    last.map(|last: Value| find_edits(&last, &recipe.meta.merged)).unwrap_or_default()
}

/// The edits that may change the parameters of a step.
#[must_use]
pub fn edits_of_step<'e>(edits: &'e [RecipeEdit], step: &str) -> Vec<&'e RecipeEdit> {
    let (trajectory, stage) = step.rsplit_once('/').unwrap_or(("", step));
    let listed = SECTIONS.iter().find(|(name, _)| *name == stage).map(|(_, sections)| *sections);
    let concerns = |edit: &&RecipeEdit| {
        let mut parts = edit.path.split('.');
        let section = parts.next().unwrap_or_default();
        // A camera of a rig has the name of its body before the slash, and only that name is in the recipe.
        let is_other = section == "trajectories"
            && parts.next().is_some_and(|name| name != trajectory.split('/').next().unwrap_or_default());
        let is_own = match listed {
            Some(sections) => sections.contains(&section),
            None => section == stage || OF_PICTURES.contains(&section),
        };
        is_own && !is_other
    };
    edits.iter().filter(concerns).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_has_the_edits_of_its_sections() {
        let paths = [
            "sensor.esim.threshold.on",
            "trajectories.base.speed.function",
            "trajectories.b.speed",
            "sharp.every",
        ];
        let edit = |path: &&str| RecipeEdit { path: (*path).to_owned(), old: None, new: None };
        let edits: Vec<RecipeEdit> = paths.iter().map(edit).collect();
        let t = |step: &str, wanted: &[&str]| {
            let found: Vec<&str> =
                edits_of_step(&edits, step).iter().map(|edit| edit.path.as_str()).collect();
            assert_eq!(found, wanted, "{step}");
        };
        t("base/events", &paths[..1]);
        t("base/trajectory", &paths[1..2]);
        t("base/left/trajectory", &paths[1..2]);
        t("base/sharp", &paths[3..]);
        t("base/depth", &[]);
        t("capture", &[]);
    }
}
