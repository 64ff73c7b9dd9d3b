//! `crates/recipe/src/recipe.schema.json`: the recipe as a JSON Schema, for editors and other programs.
//!
//! Names, types and words are those of `docs/recipe.md`. Ranges and forms of single values are read
//! off the loader, relations between keys are a table.

mod relations;
mod values;

use super::declared::{Crate, Declared, Member};
use super::recipe_page::{Reference, Words};
use serde_json::{Map, Value, json};

/// Folder of the declarations of sensors, whose numbers may be laws.
const SENSORS: &str = "crates/recipe/src/schema/sensor";

/// The schema as the file holds it.
pub(super) fn text(krate: &Crate) -> String {
    let mut writer = SchemaWriter { krate, reference: Reference::of(krate), defs: Map::new() };
    let mut root = Value::Object(writer.object("RecipeSchema", krate.recipe()));
    root["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    root["title"] = json!("Recipe of gs2e");
    root["properties"]["checks"] = writer.checks();
    // The defaults file or a preset may have any of the other keys.
    root["required"] = json!(["version"]);
    root["properties"]["version"] = json!({ "const": 1, "description": "Version of the recipe language." });
    writer.defs.insert("DrawnNumber".to_owned(), relations::drawn_number());
    root["$defs"] = Value::Object(writer.defs);
    format!("{root:#}\n")
}

/// The schema while it is written.
struct SchemaWriter<'c> {
    krate: &'c Crate,
    reference: Reference<'c>,
    defs: Map<String, Value>,
}

impl SchemaWriter<'_> {
    /// A mapping with its keys.
    fn object(&mut self, name: &str, declared: &Declared) -> Map<String, Value> {
        let mut properties = Map::new();
        let mut required = Vec::new();
        for member in &declared.members {
            let words = Words::of(&member.doc);
            let paths = self.reference.places_of(declared, member);
            let mut schema = self.of_type(&member.ty, &declared.file);
            if member.ty.contains("ContrastSection") {
                schema = relations::short_contrast(&schema);
            }
            values::narrow(&mut schema, member, &words, &paths);
            // A contrast is no law: the unit of a law is that of the sensor.
            if declared.file.starts_with(SENSORS) && name != "ContrastSection" {
                values::admit_laws(&mut schema);
            }
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
        let rules = relations::of(name, &declared.members);
        if !rules.is_empty() {
            object.insert("allOf".to_owned(), Value::Array(rules));
        }
        object
    }

    /// A value of a type of the schema.
    fn of_type(&mut self, ty: &str, file: &str) -> Value {
        if let Some(inner) = within(ty, "Field<").or(within(ty, "Box<")).or(within(ty, "Option<")) {
            return self.of_type(inner, file);
        }
        if let Some(inner) = within(ty, "Vec<") {
            return json!({ "type": "array", "items": self.of_type(inner, file) });
        }
        if let Some(inner) = within(ty, "BTreeMap<String, ") {
            return json!({ "type": "object", "additionalProperties": self.of_type(inner, file) });
        }
        if let Some((inner, count)) =
            ty.strip_prefix('[').and_then(|ty| ty.trim_end_matches(']').rsplit_once("; "))
        {
            let count: u64 = count.parse().expect("a list has a number of items");
            let items = self.of_type(inner, file);
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
            name => self.named(name, file),
        }
    }

    /// A reference to a type that the sources declare.
    fn named(&mut self, name: &str, file: &str) -> Value {
        let krate = self.krate;
        let declared = krate.named(name, file).unwrap_or_else(|| panic!("{name} is not declared"));
        if !self.defs.contains_key(name) {
            // Entered first, so that a type that holds itself ends.
            self.defs.insert(name.to_owned(), Value::Null);
            let schema = if declared.is_enum {
                self.choice(name, declared)
            } else {
                self.object(name, declared).into()
            };
            self.defs.insert(name.to_owned(), schema);
        }
        json!({ "$ref": format!("#/$defs/{name}") })
    }

    /// One of several words, or a mapping with one of several keys.
    fn choice(&mut self, name: &str, declared: &Declared) -> Value {
        let choices: Vec<Value> = declared.members.iter().map(|member| self.one(declared, member)).collect();
        let mut choice = json!({ "description": declared.doc, "oneOf": choices });
        let rules = relations::of(name, &[]);
        if !rules.is_empty() {
            choice["allOf"] = Value::Array(rules);
        }
        choice
    }

    fn one(&mut self, declared: &Declared, member: &Member) -> Value {
        if member.ty.is_empty() {
            // In YAML, `true` and `false` are no texts.
            let word = member.name.parse::<bool>().map_or_else(|_| json!(member.name), |truth| json!(truth));
            return json!({ "const": word, "description": member.doc });
        }
        let value = self.of_type(&member.ty, &declared.file);
        let name = &member.name;
        json!({ "type": "object", "description": member.doc, "properties": { name: value }, "required": [name],
                "additionalProperties": false })
    }

    /// The section `checks`, whose limits are declared with the checks that read them.
    fn checks(&self) -> Value {
        let mut passes = Map::new();
        for name in values::limited_checks() {
            passes.insert(name, json!({ "type": "object", "properties": {}, "additionalProperties": false }));
        }
        for (path, member, _) in self.reference.limits() {
            let (pass, key) = path.split_once('.').expect("a limit belongs to a pass");
            let whole = member.ty.contains("u32");
            let mut limit = json!({ "type": if whole { "integer" } else { "number" } });
            values::narrow(&mut limit, member, &Words::default(), &[format!("checks.{path}")]);
            limit["description"] = json!(member.doc);
            passes[pass]["properties"][key] = limit;
        }
        passes.insert(
            "waive".to_owned(),
            json!({
                "description": "Failures to accept.",
                "type": "array",
                "items": { "type": "object",
                           "properties": { "check": { "enum": values::waivable_checks() },
                                           "because": { "type": "string", "pattern": "\\S" } },
                           "required": ["check", "because"], "additionalProperties": false },
            }),
        );
        json!({ "description": "Limits that replace the defaults of the validation passes.", "type": "object",
                "properties": passes, "additionalProperties": false })
    }
}

/// The comment of a key as a text of its own: without the marks of the reference.
fn description(doc: &str) -> String {
    doc.trim_end_matches("Required.").trim_end().to_owned()
}

/// The text between `begin` and the bracket that ends the type.
fn within<'t>(ty: &'t str, begin: &str) -> Option<&'t str> {
    ty.strip_prefix(begin)?.strip_suffix('>')
}
