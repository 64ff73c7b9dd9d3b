//! The record sets: one record per row of the index, and one per `scene.json`.

use crate::index;
use crate::index::COLUMNS;
use crate::index::table::ColumnKind;
use gs2e_recipe::SplitPlan;
use serde_json::{Value, json};

/// Fields of a `scene.json`: name, kind, path in the file, and description.
const SCENE: [(&str, ColumnKind, &str, &str); 12] = [
    ("id", ColumnKind::Text, "$.id", "scene id, and its folder"),
    ("source", ColumnKind::Text, "$.source.kind", "kind of source that the poses come from"),
    ("licence", ColumnKind::Text, "$.licence.expression", "SPDX expression"),
    ("attribution", ColumnKind::Text, "$.licence.attribution", "names for attribution"),
    ("gated", ColumnKind::Flag, "$.licence.gated", "whether receivers must accept the upstream terms first"),
    ("width", ColumnKind::Whole, "$.camera.width", "width of the camera, px"),
    ("height", ColumnKind::Whole, "$.camera.height", "height of the camera, px"),
    ("fx", ColumnKind::Number, "$.camera.fx", "focal length, px"),
    ("fy", ColumnKind::Number, "$.camera.fy", "focal length, px"),
    ("cx", ColumnKind::Number, "$.camera.cx", "principal point, px"),
    ("cy", ColumnKind::Number, "$.camera.cy", "principal point, px"),
    ("recipe_sha256", ColumnKind::Text, "$.recipe_sha256", "SHA-256 of the recipe as compact JSON"),
];

/// Name of a kind in Croissant.
pub fn data_type(kind: ColumnKind) -> &'static str {
    match kind {
        ColumnKind::Text => "sc:Text",
        ColumnKind::Whole => "sc:Integer",
        ColumnKind::Number => "sc:Float",
        ColumnKind::Flag => "sc:Boolean",
    }
}

fn record_set(name: &str, description: &str, key: &str, fields: &[Value]) -> Value {
    json!({
        "@type": "cr:RecordSet", "@id": name, "name": name, "description": description,
        "key": { "@id": format!("{name}/{key}") }, "field": fields,
    })
}

fn record_field(set: &str, name: &str, kind: ColumnKind, description: &str, source: Value) -> Value {
    let mut field = json!({
        "@type": "cr:Field", "@id": format!("{set}/{name}"), "name": name, "description": description,
        "dataType": data_type(kind),
    });
    field["source"] = source;
    field
}

/// The rows of the index. If there are splits, their column refers to the records of the splits.
pub(super) fn index_records(splits: Option<&SplitPlan>) -> Value {
    let from =
        |column: &str| json!({ "fileObject": { "@id": index::NAME }, "extract": { "column": column } });
    let mut fields: Vec<Value> =
        COLUMNS.iter().map(|c| record_field("index", c.name, c.kind, c.description, from(c.name))).collect();
    let split = fields.iter_mut().find(|field| field["name"] == "split");
    if let (Some(field), Some(_)) = (split, splits) {
        field["references"] = json!({ "field": { "@id": format!("{SPLITS}/name") } });
    }
    record_set("index", "one row per trajectory, or one row per sensor if it has several", "id", &fields)
}

/// Id of the record set of splits.
pub const SPLITS: &str = "splits";

/// The splits, one record each, with the data written into the file.
pub(super) fn split_records(splits: &SplitPlan) -> Value {
    let name = format!("{SPLITS}/name");
    let field = json!({
        "@type": "cr:Field", "@id": name, "name": "name", "description": "name of the split",
        "dataType": "sc:Text",
    });
    let mut records =
        record_set(SPLITS, "the splits; scenes are assigned by capture or object", "name", &[field]);
    records["dataType"] = "cr:Split".into();
    records["data"] = splits.shares.keys().map(|split| json!({ name.as_str(): split })).collect();
    records
}

/// The scene files, as records of the file set `files`.
pub(super) fn scene_records(files: &str) -> Value {
    let from = |path: &str| json!({ "fileSet": { "@id": files }, "extract": { "jsonPath": path } });
    let fields =
        SCENE.iter().map(|(name, kind, path, what)| record_field("scenes", name, *kind, what, from(path)));
    record_set("scenes", "one record per scene, from its scene.json", "id", &fields.collect::<Vec<_>>())
}
