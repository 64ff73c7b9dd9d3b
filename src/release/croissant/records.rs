//! The record sets: the rows of the index, and a record of each `scene.json`.

use crate::release::index::table::Kind;
use crate::release::index::{self, COLUMNS};
use serde_json::{Value, json};

/// What is told of a `scene.json`: name, kind and path in it, and what it is.
const SCENE: [(&str, Kind, &str, &str); 12] = [
    ("id", Kind::Text, "$.id", "scene id, and its folder"),
    ("source", Kind::Text, "$.source.kind", "kind of source that the poses come from"),
    ("licence", Kind::Text, "$.licence.expression", "SPDX expression"),
    ("attribution", Kind::Text, "$.licence.attribution", "who is to be named"),
    ("gated", Kind::Flag, "$.licence.gated", "whether receivers must accept the upstream terms first"),
    ("width", Kind::Whole, "$.camera.width", "width of the camera, px"),
    ("height", Kind::Whole, "$.camera.height", "height of the camera, px"),
    ("fx", Kind::Number, "$.camera.fx", "focal length, px"),
    ("fy", Kind::Number, "$.camera.fy", "focal length, px"),
    ("cx", Kind::Number, "$.camera.cx", "principal point, px"),
    ("cy", Kind::Number, "$.camera.cy", "principal point, px"),
    ("recipe_sha256", Kind::Text, "$.recipe_sha256", "SHA-256 of the recipe as compact JSON"),
];

/// How Croissant calls a kind.
pub(in crate::release) fn data_type(kind: Kind) -> &'static str {
    match kind {
        Kind::Text => "sc:Text",
        Kind::Whole => "sc:Integer",
        Kind::Number => "sc:Float",
        Kind::Flag => "sc:Boolean",
    }
}

fn set(name: &str, description: &str, key: &str, fields: &[Value]) -> Value {
    json!({
        "@type": "cr:RecordSet", "@id": name, "name": name, "description": description,
        "key": { "@id": format!("{name}/{key}") }, "field": fields,
    })
}

fn field(set: &str, name: &str, kind: Kind, description: &str, source: Value) -> Value {
    let mut field = json!({
        "@type": "cr:Field", "@id": format!("{set}/{name}"), "name": name, "description": description,
        "dataType": data_type(kind),
    });
    field["source"] = source;
    field
}

/// The rows of the index.
pub(super) fn index() -> Value {
    let from =
        |column: &str| json!({ "fileObject": { "@id": index::NAME }, "extract": { "column": column } });
    let fields = COLUMNS.iter().map(|c| field("index", c.name, c.kind, c.description, from(c.name)));
    set(
        "index",
        "a row a trajectory, and a row a sensor where several saw it",
        "id",
        &fields.collect::<Vec<_>>(),
    )
}

/// The scene files, which are the file set `files`.
pub(super) fn scenes(files: &str) -> Value {
    let from = |path: &str| json!({ "fileSet": { "@id": files }, "extract": { "jsonPath": path } });
    let fields = SCENE.iter().map(|(name, kind, path, what)| field("scenes", name, *kind, what, from(path)));
    set("scenes", "a record a scene, from its scene.json", "id", &fields.collect::<Vec<_>>())
}
