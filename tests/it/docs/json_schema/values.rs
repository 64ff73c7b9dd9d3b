//! Ranges and forms of single values, read off the messages of the loader.
//!
//! A type that stands in several places has a range only if it is the same in all that state one. A
//! place states none where the key needs another key, which is missing in the recipe of the probe.

use crate::docs::declared::Member;
use crate::docs::probe;
use crate::docs::recipe_page::{Words, number_range};
use gs2e_check as check;
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// A part of the path of a scene, or the name of a trajectory.
const PART: &str = "[A-Za-z0-9._-]*[A-Za-z0-9_-]";

/// States in `schema` what the loader requires of the values of a key in all its places.
pub(super) fn narrow(schema: &mut Value, member: &Member, words: &Words, paths: &[String]) {
    let ranges: BTreeSet<String> = paths.iter().map(|path| number_range(path, &member.ty)).collect();
    let ranges = ranges.iter().filter(|range| !range.is_empty());
    // A key whose comment states a range has another one for each item, or none that is an interval.
    if let ([range], "", Some(bounds)) = (&ranges.collect::<Vec<_>>()[..], words.range.as_str(), item(schema))
    {
        bound(bounds, range);
    }
    if member.ty.contains("Vec<") && everywhere(paths, &json!([]), "is an empty list") {
        schema["minItems"] = json!(1);
    }
    if member.ty.contains("String>") && !member.ty.contains("BTreeMap") {
        let form = form_of(member, words);
        if form.is_some() || everywhere(paths, &json!(" "), "is empty") {
            schema["pattern"] = json!(form.unwrap_or_else(|| "\\S".to_owned()));
        }
        let most = words.range.strip_prefix("at most ").and_then(|rest| rest.strip_suffix(" bytes"));
        if let Some(most) = most.and_then(|most| most.parse::<u64>().ok()) {
            schema["maxLength"] = json!(most);
        }
    }
    if member.name == "preset" && schema["type"] == "string" {
        let known = |word: &&str| paths.iter().all(|path| loads(path, &json!(word)));
        let named: Vec<&str> = words.meaning.split('`').skip(1).step_by(2).filter(known).collect();
        *schema = json!({ "enum": named });
    }
}

/// A number of a sensor may be a law that it is drawn from.
pub(super) fn admit_laws(schema: &mut Value) {
    if schema["type"] == "array" {
        return admit_laws(&mut schema["items"]);
    }
    if schema["type"] == "number" {
        *schema = json!({ "anyOf": [schema.take(), { "$ref": "#/$defs/DrawnNumber" }] });
    }
}

/// The names of the checks that have a section in `checks`.
pub(super) fn limited_checks() -> Vec<String> {
    let known = |name: &&str| loads(&format!("checks.{name}"), &json!({}));
    check::NAMES.into_iter().filter(known).map(str::to_owned).collect()
}

/// The names of the checks that a recipe may waive.
pub(super) fn waivable_checks() -> Vec<String> {
    let known = |name: &&str| loads("checks.waive", &json!([{ "check": name, "because": "x" }]));
    check::NAMES.into_iter().filter(known).map(str::to_owned).collect()
}

fn loads(path: &str, value: &Value) -> bool {
    probe::load(&probe::with(probe::context(path), path, value.clone())).is_ok()
}

/// Returns true if the loader refuses a value with these words in every place.
fn everywhere(paths: &[String], value: &Value, words: &str) -> bool {
    let refused = |path: &String| {
        let answer = probe::load(&probe::with(probe::context(path), path, value.clone()));
        answer.err().is_some_and(|faults| faults.contains(words))
    };
    !paths.is_empty() && paths.iter().all(refused)
}

/// The schema of the numbers: the value itself, or the items of a list.
fn item(schema: &mut Value) -> Option<&mut Value> {
    let schema = if schema["type"] == "array" { &mut schema["items"] } else { schema };
    let is_number = ["number", "integer"].iter().any(|kind| schema["type"] == *kind)
        || schema["type"] == json!(["number", "string"]);
    is_number.then_some(schema)
}

/// States a range in the words of the reference.
fn bound(schema: &mut Value, range: &str) {
    let number = |text: &str| text.parse::<f64>().ok();
    let (range, not_zero) = match range.strip_suffix(" other than 0") {
        Some(range) => (range, true),
        None => (range, false),
    };
    let ends = if let Some((low, high)) = range.split_once(" to ") {
        Some(("minimum", number(low), number(high)))
    } else if let Some(rest) = range.strip_prefix("above ") {
        let (low, high) = rest.split_once(", at most ").map_or((rest, None), |(low, high)| (low, Some(high)));
        Some(("exclusiveMinimum", number(low), high.and_then(number)))
    } else {
        range.strip_prefix("at least ").map(|low| ("minimum", number(low), None))
    };
    let Some((name, Some(low), high)) = ends else { return };
    schema[name] = short(low);
    if let Some(high) = high {
        schema["maximum"] = short(high);
    }
    if not_zero {
        schema["not"] = json!({ "const": 0 });
    }
    if name != "minimum" {
        schema.as_object_mut().expect("a schema is a mapping").remove("minimum");
    }
}

/// A number without a fraction that is zero.
#[expect(clippy::cast_possible_truncation, reason = "checked to be whole and small")]
fn short(value: f64) -> Value {
    let whole = value.fract() == 0.0 && value.abs() < 1e15;
    if whole { json!(value as i64) } else { json!(value) }
}

/// Pattern of a text that has a form.
fn form_of(member: &Member, words: &Words) -> Option<String> {
    let is_path = words.meaning.contains("parts of letters, digits");
    match (words.range.as_str(), member.name.as_str()) {
        ("a URL", _) => Some("^(https?://[^\\s]|doi:10\\.)\\S*$".to_owned()),
        ("`YYYY-MM-DD`", _) => Some("^\\d{4}-\\d{2}-\\d{2}$".to_owned()),
        ("at most 200 bytes", "scene") if is_path => Some(format!("^{PART}(/{PART})*$")),
        ("at most 100 bytes", "name") => Some(format!("^{PART}$")),
        _ => None,
    }
}

#[test]
fn ranges_become_bounds() {
    let t = |range: &str, wanted: Value| {
        let mut schema = json!({ "type": "number" });
        bound(&mut schema, range);
        assert_eq!(schema, wanted, "{range}");
    };
    t("0 to 1000", json!({ "type": "number", "minimum": 0, "maximum": 1000 }));
    t("above 0, at most 1e9", json!({ "type": "number", "exclusiveMinimum": 0, "maximum": 1_000_000_000 }));
    t("1e-6 to 1e6", json!({ "type": "number", "minimum": 1e-6, "maximum": 1_000_000 }));
    t("at least 3", json!({ "type": "number", "minimum": 3 }));
    t(
        "-36000 to 36000 other than 0",
        json!({ "type": "number", "minimum": -36000, "maximum": 36000, "not": { "const": 0 } }),
    );
    t("scene, none, or above 0, at most 1e12", json!({ "type": "number" }));
    t("", json!({ "type": "number" }));
}
