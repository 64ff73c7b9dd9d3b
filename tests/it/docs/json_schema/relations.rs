//! Relations between the keys of a mapping, and between those of the whole recipe.
//!
//! A recipe is merged over its defaults file, which may have any key that is not in a list. A
//! relation therefore does not say that such a key is missing; it says that keys exclude each other.

use crate::docs::declared::Member;
use serde_json::{Value, json};

/// Keys of which a path has at most one: they set its number of poses.
const COUNTS: [&str; 3] = ["factor", "frames", "duration"];

/// The relations between the keys of a type.
pub(super) fn of(name: &str, members: &[Member]) -> Vec<Value> {
    let mut rules: Vec<Value> = match name {
        "RecipeSchema" => whole_recipe(),
        "TrajectorySection" => vec![
            one_of(&["refine", "novel", "orbit", "keyframes"]),
            json!({ "properties": { "name": device_free() } }),
        ],
        "ObjectSection" => vec![one_of(&["select", "scene"])],
        "PoseSection" => vec![
            exclude("rotation", "look_at"),
            exclude("rotation", "up"),
            json!({ "anyOf": [{ "required": ["rotation"] }, { "required": ["look_at", "up"] }] }),
        ],
        "LuminanceSection" => {
            vec![json!({ "properties": { "weights": { "items": { "minimum": 0, "maximum": 1 } } } })]
        }
        "CameraSection" => vec![
            exclude("size", "width"),
            exclude("size", "height"),
            json!({ "anyOf": [{ "required": ["size"] }, { "required": ["width", "height"] }] }),
            exclude("fov", "fx"),
            exclude("fov", "fy"),
            exclude("fov", "cx"),
            exclude("fov", "cy"),
        ],
        "SharpSection" | "EverySection" => vec![exclude("every", "fps")],
        "EsimSection" | "V2eSection" => vec![exclude_contrast()],
        "BlurSection" => vec![
            json!({ "properties": { "frames": { "not": { "multipleOf": 2 } } } }),
            exclude("frames", "fps"),
        ],
        "OrbitSection" => vec![json!({ "properties": { "up": { "not": { "const": [0, 0, 0] } } } })],
        "RenderSection" => vec![if_then(
            &json!({ "order": { "const": "blended" }, "rules": {} }),
            &json!({ "properties": { "rules": { "const": "soft" } } }),
        )],
        "SamplingSection" => vec![not_both(&json!({ "law": { "const": "sum" }, "tolerance": {} }))],
        "VoltmeterSection" => voltmeter(),
        "CommandSection" => vec![command()],
        _ => Vec::new(),
    };
    let counts: Vec<&str> = COUNTS.into_iter().filter(|key| members.iter().any(|m| m.name == *key)).collect();
    for (i, first) in counts.iter().enumerate() {
        rules.extend(counts[i + 1..].iter().map(|second| exclude(first, second)));
    }
    rules
}

/// A contrast as a mapping, or as one number or two.
pub(super) fn short_contrast(mapping: &Value) -> Value {
    let number = json!({ "type": "number", "minimum": 0.0001, "maximum": 20 });
    json!({ "anyOf": [mapping, number, { "type": "array", "items": number, "minItems": 2, "maxItems": 2 }] })
}

/// A law in the place of a number of a sensor.
pub(super) fn drawn_number() -> Value {
    let two = json!({ "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 });
    let law = |keys: &[&str]| {
        let properties: serde_json::Map<String, Value> =
            keys.iter().map(|key| ((*key).to_owned(), two.clone())).collect();
        json!({ "type": "object", "properties": properties, "required": keys, "additionalProperties": false })
    };
    json!({ "description": "A law that a number of a sensor is drawn from, once for each trajectory.",
            "oneOf": [law(&["uniform"]), law(&["log_uniform"]), law(&["normal", "within"])] })
}

fn whole_recipe() -> Vec<Value> {
    let source = |kind: &str| json!({ "type": "object", "required": [kind] });
    let trains =
        json!({ "type": "object", "anyOf": [{ "required": ["command"] }, { "required": ["builtin"] }] });
    let frame_rate = json!({ "type": "object", "required": ["speed"], "properties": { "speed": {
        "type": "object", "required": ["list"], "properties": { "list": {
            "type": "object", "required": ["meaning"],
            "properties": { "meaning": { "const": "frame-rate" } } } } } } });
    let refines = json!({ "type": "object", "required": ["refine"] });
    vec![
        exclude("sensor", "sensors"),
        not_both(&json!({ "source": source("procedural"), "reconstruct": {} })),
        not_both(&json!({ "source": source("model"), "reconstruct": trains })),
        not_both(&json!({
            "source": { "const": "none" }, "trajectories": { "type": "array", "contains": refines },
        })),
        not_both(&json!({
            "sampling": { "type": "object", "required": ["law"], "properties": { "law": { "const": "integral" } } },
            "trajectories": { "type": "array", "contains": frame_rate },
        })),
        json!({ "properties": { "outputs": { "uniqueItems": true } } }),
        // A novel trajectory is drawn from one that is not novel.
        not_both(&json!({ "trajectories": { "minItems": 1, "items": { "required": ["novel"] } } })),
        json!({ "properties": { "scene": device_free() } }),
    ]
}

fn voltmeter() -> Vec<Value> {
    // The constants k1 and k2 are above 0, k3 and k6 are not negative.
    let low = |end: &str, low: f64| json!({ end: low, "maximum": 1e12 });
    let (above, least, any) = (low("exclusiveMinimum", 0.0), low("minimum", 0.0), low("minimum", -1e12));
    vec![
        json!({ "properties": { "k": { "prefixItems": [above, above, least, any, any, least] } } }),
        exclude("preset", "k"),
        exclude("preset", "units"),
        exclude_contrast(),
        not_both(&json!({ "law": { "const": "official" }, "initial": { "const": "stationary" } })),
        json!({ "properties": { "refractory": { "properties": { "reference": { "const": "passing" } } } } }),
    ]
}

/// Braces in arguments belong to a placeholder, such as `{capture}`.
fn command() -> Value {
    let texts = json!({ "items": { "pattern": "^([^{}]|\\{[A-Za-z0-9_-]+\\})*$" } });
    json!({ "properties": { "arguments": texts, "probe": texts } })
}

/// No part of the name is a device of Windows.
fn device_free() -> Value {
    json!({ "not": { "pattern": "(^|/)(con|prn|aux|nul|com[0-9]|lpt[0-9])(\\.|/|$)" } })
}

/// Two keys that exclude each other.
fn exclude(a: &str, b: &str) -> Value {
    json!({ "not": { "required": [a, b] } })
}

/// A contrast excludes the thresholds of events, but not their spread.
fn exclude_contrast() -> Value {
    let sides = json!({ "anyOf": [{ "required": ["on"] }, { "required": ["off"] }] });
    not_both(&json!({ "contrast": {}, "threshold": sides }))
}

/// Exactly one of these keys.
fn one_of(keys: &[&str]) -> Value {
    json!({ "oneOf": keys.iter().map(|key| json!({ "required": [key] })).collect::<Vec<_>>() })
}

/// The keys do not have these values together.
fn not_both(values: &Value) -> Value {
    json!({ "not": { "required": names(values), "properties": values } })
}

/// Where the keys have these values, the rest holds.
fn if_then(values: &Value, then: &Value) -> Value {
    json!({ "if": { "required": names(values), "properties": values }, "then": then })
}

fn names(values: &Value) -> Vec<&String> {
    values.as_object().expect("keys with values").keys().collect()
}
