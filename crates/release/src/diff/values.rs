//! Differences between two JSON values, leaf by leaf.

use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeSet;

/// A value that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ValueChange {
    /// Its place: keys, indices and names of list elements, joined by dots.
    pub path: String,
    /// The value in the old release; `None` if it was absent.
    pub old: Option<Value>,
    /// The value in the new release; `None` if it is absent.
    pub new: Option<Value>,
}

/// The leaves that differ, sorted by place.
///
/// Elements of a list are compared by their `name` if all have one, or else by index if the lists
/// have the same length. Other lists differ as a whole.
pub fn value_changes(old: &Value, new: &Value) -> Vec<ValueChange> {
    let mut found = Vec::new();
    walk_values(&mut found, "", Some(old), Some(new));
    found
}

fn walk_values(found: &mut Vec<ValueChange>, path: &str, old: Option<&Value>, new: Option<&Value>) {
    if old == new {
        return;
    }
    let pairs = match (old, new) {
        (Some(old), Some(new)) => value_pairs(old, new),
        _ => None,
    };
    let Some(pairs) = pairs else {
        found.push(ValueChange { path: path.to_owned(), old: old.cloned(), new: new.cloned() });
        return;
    };
    for (name, old, new) in pairs {
        let below = if path.is_empty() { name } else { format!("{path}.{name}") };
        walk_values(found, &below, old, new);
    }
}

type ValuePair<'a> = (String, Option<&'a Value>, Option<&'a Value>);

/// Pairs of parts that belong together; `None` if the values can only be compared as a whole.
fn value_pairs<'a>(old: &'a Value, new: &'a Value) -> Option<Vec<ValuePair<'a>>> {
    match (old, new) {
        (Value::Object(a), Value::Object(b)) => {
            let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            Some(names.into_iter().map(|name| (name.clone(), a.get(name), b.get(name))).collect())
        }
        (Value::Array(a), Value::Array(b)) => by_name(a, b).or_else(|| by_index(a, b)),
        _ => None,
    }
}

fn by_name<'a>(old: &'a [Value], new: &'a [Value]) -> Option<Vec<ValuePair<'a>>> {
    fn name(element: &Value) -> Option<&str> {
        element.get("name")?.as_str()
    }
    let names: Vec<&str> = old.iter().chain(new).map(name).collect::<Option<_>>()?;
    let unique = |list: &[Value]| list.iter().map(name).collect::<BTreeSet<_>>().len() == list.len();
    // A repeated name does not identify an element.
    if !unique(old) || !unique(new) {
        return None;
    }
    let find = |list: &'a [Value], wanted| list.iter().find(|element| name(element) == Some(wanted));
    let names: BTreeSet<&str> = names.into_iter().collect();
    Some(names.into_iter().map(|name| (name.to_owned(), find(old, name), find(new, name))).collect())
}

fn by_index<'a>(old: &'a [Value], new: &'a [Value]) -> Option<Vec<ValuePair<'a>>> {
    // With an insertion, all later elements would differ, so lengths must agree.
    let both = old.iter().zip(new).enumerate();
    (old.len() == new.len()).then(|| both.map(|(i, (a, b))| (i.to_string(), Some(a), Some(b))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn leaves_that_differ_are_told_by_their_place() {
        let t = |old: Value, new: Value, wanted: &[&str]| {
            let show = |value: &Option<Value>| value.as_ref().map_or("absent".to_owned(), Value::to_string);
            let found = value_changes(&old, &new).into_iter();
            let found: Vec<_> =
                found.map(|c| format!("{}: {} -> {}", c.path, show(&c.old), show(&c.new))).collect();
            assert_eq!(found, wanted, "{old} | {new}");
        };
        t(json!({ "a": 1, "b": [1, 2] }), json!({ "b": [1, 2], "a": 1 }), &[]);
        t(json!({ "a": { "b": 1 } }), json!({ "a": { "b": 2 } }), &["a.b: 1 -> 2"]);
        t(json!({ "a": 1 }), json!({ "b": 1 }), &["a: 1 -> absent", "b: absent -> 1"]);
        t(json!({ "a": 1 }), json!({ "a": { "b": 1 } }), &["a: 1 -> {\"b\":1}"]);
        t(json!([1, 2]), json!([1, 3]), &["1: 2 -> 3"]);
        t(json!({ "a": [1, 2] }), json!({ "a": [1] }), &["a: [1,2] -> [1]"]);
        t(
            json!([{ "name": "x", "r": 1 }, { "name": "y", "r": 1 }]),
            json!([{ "name": "new", "r": 1 }, { "name": "y", "r": 2 }]),
            &[
                "new: absent -> {\"name\":\"new\",\"r\":1}",
                "x: {\"name\":\"x\",\"r\":1} -> absent",
                "y.r: 1 -> 2",
            ],
        );
        t(
            json!([{ "name": "x" }, { "name": "x" }]),
            json!([{ "name": "x" }]),
            &[": [{\"name\":\"x\"},{\"name\":\"x\"}] -> [{\"name\":\"x\"}]"],
        );
    }
}
