//! Differences between two merged recipes: the changed values, old and new.

use serde::Serialize;
use serde_json::{Map, Value};

/// One value that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecipeEdit {
    /// Path of the value, for example `sensor.voltmeter.threshold.on`. A list element is identified
    /// by its name, for example `trajectories.base.refine.window`, or by its index from 0, for
    /// example `render.background[2]`.
    pub path: String,
    /// The old value; null if there was no value.
    pub old: Option<Value>,
    /// The new value; null if there is no value.
    pub new: Option<Value>,
}

/// Returns the differing values, ordered by path. A subtree that was added or removed as a whole is
/// one edit.
#[must_use]
pub fn find_edits(old: &Value, new: &Value) -> Vec<RecipeEdit> {
    let mut found = Vec::new();
    compare_values("", old, new, &mut found);
    found
}

fn compare_values(path: &str, old: &Value, new: &Value, found: &mut Vec<RecipeEdit>) {
    if old == new {
        return;
    }
    match (old, new) {
        (Value::Object(old), Value::Object(new)) => compare_fields(path, old, new, found),
        // Elements with names are paired by name, so that a reordered list has no edits.
        (Value::Array(before), Value::Array(after)) => {
            match (named_elements(before), named_elements(after)) {
                (Some(old), Some(new)) => compare_fields(path, &old, &new, found),
                _ if before.len() == after.len() => {
                    for (i, (old, new)) in before.iter().zip(after).enumerate() {
                        compare_values(&format!("{path}[{i}]"), old, new, found);
                    }
                }
                // Lists of different lengths without names have no known pairing of elements.
                _ => found.push(make_edit(path, Some(old), Some(new))),
            }
        }
        _ => found.push(make_edit(path, Some(old), Some(new))),
    }
}

fn compare_fields(
    path: &str,
    old: &Map<String, Value>,
    new: &Map<String, Value>,
    found: &mut Vec<RecipeEdit>,
) {
    let mut names: Vec<&String> = old.keys().chain(new.keys()).collect();
    names.sort();
    names.dedup();
    for name in names {
        let below = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        match (old.get(name), new.get(name)) {
            (Some(old), Some(new)) => compare_values(&below, old, new, found),
            (old, new) => found.push(make_edit(&below, old, new)),
        }
    }
}

fn make_edit(path: &str, old: Option<&Value>, new: Option<&Value>) -> RecipeEdit {
    RecipeEdit { path: path.to_owned(), old: old.cloned(), new: new.cloned() }
}

/// Returns the elements of a list by name; `None` unless each element is a mapping with a unique
/// name.
fn named_elements(list: &[Value]) -> Option<Map<String, Value>> {
    let pairs = list.iter().map(|element| Some((element.get("name")?.as_str()?.to_owned(), element.clone())));
    let by_name = pairs.collect::<Option<Map<String, Value>>>()?;
    (by_name.len() == list.len()).then_some(by_name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Asserts the edits, written as `path: old -> new`.
    fn t(old: &Value, new: &Value, wanted: &[&str]) {
        let shown = |value: &Option<Value>| value.as_ref().map_or("absent".to_owned(), Value::to_string);
        let found: Vec<String> = find_edits(old, new)
            .iter()
            .map(|edit| format!("{}: {} -> {}", edit.path, shown(&edit.old), shown(&edit.new)))
            .collect();
        assert_eq!(found, wanted, "{old} | {new}");
    }

    #[test]
    fn the_number_that_was_edited_is_named() {
        let recipe = |on: f64| json!({ "seed": 7, "sensor": { "voltmeter": { "threshold": { "on": on, "off": 1.0 } } } });
        t(&recipe(1.0), &recipe(1.2), &["sensor.voltmeter.threshold.on: 1.0 -> 1.2"]);
        t(&recipe(1.0), &recipe(1.0), &[]);
        t(&json!({ "b": 1, "a": 2 }), &json!({ "a": 3, "b": 4 }), &["a: 2 -> 3", "b: 1 -> 4"]);
        t(&json!({ "k": [0, 1, 2] }), &json!({ "k": [0, 5, 6] }), &["k[1]: 1 -> 5", "k[2]: 2 -> 6"]);
    }

    #[test]
    fn one_choice_for_another_is_one_gone_and_one_come() {
        let refine = |count: &str, n: u32| json!({ "refine": { "window": 2, count: n } });
        let wanted = ["refine.factor: 5 -> absent", "refine.frames: absent -> 150"];
        t(&refine("factor", 5), &refine("frames", 150), &wanted);
        t(
            &json!({ "background": "none" }),
            &json!({ "background": [0, 1, 0] }),
            &["background: \"none\" -> [0,1,0]"],
        );
        t(
            &json!({ "outputs": ["a", "b"] }),
            &json!({ "outputs": ["a"] }),
            &["outputs: [\"a\",\"b\"] -> [\"a\"]"],
        );
    }

    #[test]
    fn elements_with_names_are_known_by_them() {
        let path = |name: &str, window: u32| json!({ "name": name, "refine": { "window": window } });
        let list = |paths: &[Value]| json!({ "trajectories": paths });
        let [base, mini] = [path("base", 2), path("mini", 2)];
        t(&list(&[base.clone(), mini.clone()]), &list(&[mini.clone(), base.clone()]), &[]);
        t(
            &list(std::slice::from_ref(&base)),
            &list(&[path("base", 3)]),
            &["trajectories.base.refine.window: 2 -> 3"],
        );
        let whole = r#"{"name":"mini","refine":{"window":2}}"#;
        let [come, gone] = [format!("absent -> {whole}"), format!("{whole} -> absent")];
        let both = [base.clone(), mini.clone()];
        t(&list(std::slice::from_ref(&base)), &list(&both), &[&format!("trajectories.mini: {come}")]);
        t(&list(&both), &list(std::slice::from_ref(&base)), &[&format!("trajectories.mini: {gone}")]);
        // Two elements with the same name cannot be identified by name.
        t(
            &list(&[base.clone(), base]),
            &list(&[path("base", 2), mini]),
            &["trajectories[1].name: \"base\" -> \"mini\""],
        );
    }
}
