//! `src/recipe/recipe.schema.json`: the recipe as a JSON Schema, for editors and other programs.
//!
//! It comes from the same declarations and words as `docs/recipe.md`. Ranges that several keys share
//! are the loader's alone.

use super::declared::{Crate, Declared, Member};
use super::recipe_page::{Reference, Words};
use serde_json::{Map, Value, json};

/// The schema as the file holds it.
pub(super) fn text(krate: &Crate) -> String {
    let mut defs = Map::new();
    let mut root = Value::Object(object(krate, krate.recipe(), &mut defs));
    root["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    root["title"] = json!("Recipe of gs2e");
    root["properties"]["checks"] = checks(krate);
    // The defaults file or a preset may have any of the other keys.
    root["required"] = json!(["version"]);
    root["properties"]["version"] = json!({ "const": 1, "description": "Version of the recipe language." });
    // Pairs of keys of which a recipe has one.
    root["not"] = json!({ "required": ["sensor", "sensors"] });
    root["$defs"] = Value::Object(defs);
    format!("{root:#}\n")
}

/// A mapping with its keys.
fn object(krate: &Crate, declared: &Declared, defs: &mut Map<String, Value>) -> Map<String, Value> {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for member in &declared.members {
        let words = Words::of(&member.doc);
        let mut schema = of_type(krate, &member.ty, &declared.file, defs);
        schema["description"] = json!(description(&member.doc));
        if let Some(default) = words.yaml_default().and_then(|text| super::probe::yaml(text).ok()) {
            schema["default"] = default;
        }
        if words.required {
            required.push(member.name.clone());
        }
        properties.insert(member.name.clone(), schema);
    }
    let mut object = Map::new();
    object.insert("type".to_owned(), json!("object"));
    object.insert("description".to_owned(), json!(declared.doc));
    object.insert("properties".to_owned(), Value::Object(properties));
    object.insert("additionalProperties".to_owned(), json!(false));
    if !required.is_empty() {
        object.insert("required".to_owned(), json!(required));
    }
    object
}

/// The comment of a key as a text of its own: without the marks of the reference.
fn description(doc: &str) -> String {
    doc.trim_end_matches("Required.").trim_end().to_owned()
}

/// A value of a type of the schema.
fn of_type(krate: &Crate, ty: &str, file: &str, defs: &mut Map<String, Value>) -> Value {
    if let Some(inner) = within(ty, "Field<").or(within(ty, "Box<")).or(within(ty, "Option<")) {
        return of_type(krate, inner, file, defs);
    }
    if let Some(inner) = within(ty, "Vec<") {
        return json!({ "type": "array", "items": of_type(krate, inner, file, defs) });
    }
    if let Some(inner) = within(ty, "BTreeMap<String, ") {
        return json!({ "type": "object", "additionalProperties": of_type(krate, inner, file, defs) });
    }
    if let Some((inner, count)) =
        ty.strip_prefix('[').and_then(|ty| ty.trim_end_matches(']').rsplit_once("; "))
    {
        let count: u64 = count.parse().expect("a list has a number of items");
        let items = of_type(krate, inner, file, defs);
        return json!({ "type": "array", "items": items, "minItems": count, "maxItems": count });
    }
    match ty {
        "u64" | "u32" => json!({ "type": "integer", "minimum": 0 }),
        "f64" => json!({ "type": "number" }),
        // Such as 30000/1001.
        "NumberLiteral" => json!({ "type": ["number", "string"] }),
        "bool" => json!({ "type": "boolean" }),
        "String" => json!({ "type": "string" }),
        "UnsupportedField" => json!({ "not": {} }),
        "WhiteBrightness" => json!({ "enum": [255, 1] }),
        "Limits" => json!({}),
        name => named(krate, name, file, defs),
    }
}

/// The text between `begin` and the bracket that ends the type.
fn within<'t>(ty: &'t str, begin: &str) -> Option<&'t str> {
    ty.strip_prefix(begin)?.strip_suffix('>')
}

/// A reference to a type that the sources declare.
fn named(krate: &Crate, name: &str, file: &str, defs: &mut Map<String, Value>) -> Value {
    let declared = krate.named(name, file).unwrap_or_else(|| panic!("{name} is not declared"));
    if !defs.contains_key(name) {
        // Entered first, so that a type that holds itself ends.
        defs.insert(name.to_owned(), Value::Null);
        let schema = if declared.is_enum {
            choice(krate, declared, defs)
        } else {
            object(krate, declared, defs).into()
        };
        defs.insert(name.to_owned(), schema);
    }
    json!({ "$ref": format!("#/$defs/{name}") })
}

/// One of several words, or a mapping with one of several keys.
fn choice(krate: &Crate, declared: &Declared, defs: &mut Map<String, Value>) -> Value {
    let one = |member: &Member, defs: &mut Map<String, Value>| {
        if member.ty.is_empty() {
            // In YAML, `true` and `false` are no texts.
            let word = member.name.parse::<bool>().map_or_else(|_| json!(member.name), |truth| json!(truth));
            return json!({ "const": word, "description": member.doc });
        }
        let value = of_type(krate, &member.ty, &declared.file, defs);
        let name = &member.name;
        json!({ "type": "object", "description": member.doc, "properties": { name: value }, "required": [name],
                "additionalProperties": false })
    };
    let choices: Vec<Value> = declared.members.iter().map(|member| one(member, defs)).collect();
    json!({ "description": declared.doc, "oneOf": choices })
}

/// The section `checks`, whose limits are declared with the checks that read them.
fn checks(krate: &Crate) -> Value {
    let mut passes = Map::new();
    for (path, member, _) in Reference::of(krate).limits() {
        let (pass, key) = path.split_once('.').expect("a limit belongs to a pass");
        let limit = if member.ty.contains("u32") {
            json!({ "type": "integer", "minimum": 0 })
        } else {
            json!({ "type": "number" })
        };
        let pass = passes
            .entry(pass)
            .or_insert_with(|| json!({ "type": "object", "properties": {}, "additionalProperties": false }));
        pass["properties"][key] = limit;
        pass["properties"][key]["description"] = json!(member.doc);
    }
    let text = json!({ "type": "string" });
    passes.insert("waive".to_owned(), json!({
        "description": "Failures to accept.",
        "type": "array",
        "items": { "type": "object", "properties": { "check": text, "because": text }, "required": ["check", "because"],
                   "additionalProperties": false },
    }));
    json!({ "description": "Limits that replace the defaults of the validation passes.", "type": "object",
            "properties": passes })
}
