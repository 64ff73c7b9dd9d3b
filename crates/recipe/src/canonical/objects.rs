//! Objects in the merged recipe. Paths of files are shown as written.

use super::{fields_without, written_text};
use crate::schema;
use gs2e_scene::objects::{ObjectSettings, ObjectSource};
use serde_json::{Value, json};

/// The list of objects; `None` if it is empty.
pub(super) fn objects_value(raw: &schema::RecipeSchema, objects: &[ObjectSettings]) -> Option<Value> {
    let items = raw.objects.given().map_or(&[][..], |(items, _)| items);
    let written = items.iter().filter_map(|item| item.given());
    let values: Value = written.zip(objects).map(|((raw, _), object)| object_value(raw, object)).collect();
    (!objects.is_empty()).then_some(values)
}

fn object_value(raw: &schema::ObjectSection, object: &ObjectSettings) -> Value {
    let (key, source) = match &object.from {
        from @ (ObjectSource::Box { .. } | ObjectSource::Sphere { .. }) => ("select", json!(from)),
        ObjectSource::Ids { .. } => ("select", json!({ "ids": ids_path(raw) })),
        ObjectSource::Scene { at, turn, scale, .. } => {
            let path = raw.scene.given().and_then(|(scene, _)| written_text(&scene.path));
            ("scene", json!({ "path": path, "at": at, "turn": turn, "scale": scale }))
        }
    };
    let mut value = fields_without(object, &["from"]);
    value[key] = source;
    value
}

fn ids_path(raw: &schema::ObjectSection) -> Option<&str> {
    match raw.select.given() {
        Some((schema::SelectSection::Ids(path), _)) => written_text(path),
        _ => None,
    }
}
