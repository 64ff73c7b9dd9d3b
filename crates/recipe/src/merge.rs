//! Merging of a recipe over `defaults.yaml`. Mappings merge deeply, and lists replace. In an
//! enumeration, a different key replaces the whole mapping. Every value keeps its original place.

use super::drawn::is_law;
use super::reader::{ChoiceNodes, Problems, TreeReader};
use super::schema::RecipeSchema;
use super::tree::{MappingEntry, NodeKind, TreeNode};
use serde::Deserialize as _;
use std::collections::BTreeSet;

/// Groups of mutually exclusive keys. A key of the recipe removes the other groups of the defaults.
const EXCLUSIVE: [(&str, [&[&str]; 2]); 9] = [
    ("", [&["sensor"], &["sensors"]]),
    ("sensor.voltmeter", [&["preset"], &["k", "units"]]),
    ("sensors.*.voltmeter", [&["preset"], &["k", "units"]]),
    ("sensor.*", [&["contrast"], &["threshold"]]),
    ("sensors.*.*", [&["contrast"], &["threshold"]]),
    // A sensor by itself, over the ranges of its preset; and `sharp`, `depth` and their like.
    ("*", [&["contrast"], &["threshold"]]),
    ("*", [&["every"], &["fps"]]),
    ("*", [&["frames"], &["fps"]]),
    ("camera", [&["fov"], &["fx", "fy", "cx", "cy"]]),
];

/// Merges `over` with `under`; values of `over` win.
pub(super) fn merge_nodes(over: TreeNode, under: &TreeNode) -> TreeNode {
    let (problems, choices) = (Problems::default(), ChoiceNodes::default());
    // The faults are reported when the merged tree is read.
    drop(RecipeSchema::deserialize(TreeReader::new(under, &problems).noting(&choices)));
    merge_at("", over, under, &choices.into_inner())
}

fn merge_at(path: &str, over: TreeNode, under: &TreeNode, choices: &BTreeSet<*const TreeNode>) -> TreeNode {
    // A law is one value: with keys of two laws it would be neither.
    if is_law(under) || is_law(&over) {
        return over;
    }
    // A value that is no mapping replaces the default as a whole.
    let TreeNode { place, kind: NodeKind::Map(entries) } = over else { return over };
    let NodeKind::Map(defaults) = &under.kind else {
        return TreeNode { place, kind: NodeKind::Map(entries) };
    };
    // A merge of two different choices would be neither of them.
    // By address, since an equal value elsewhere may be read as a plain mapping.
    if choices.contains(&std::ptr::from_ref(under)) && !same_key(&entries, defaults) {
        return TreeNode { place, kind: NodeKind::Map(entries) };
    }
    let mut merged: Vec<MappingEntry> = Vec::with_capacity(entries.len() + defaults.len());
    let inherited: Vec<&MappingEntry> =
        defaults.iter().filter(|d| !is_overruled(path, &d.key, &entries)).collect();
    for mut entry in entries {
        if let Some(default) = defaults.iter().find(|d| d.key == entry.key) {
            entry.value = merge_at(&join_path(path, &entry.key), entry.value, &default.value, choices);
        }
        merged.push(entry);
    }
    merged.extend(inherited.into_iter().cloned());
    TreeNode { place, kind: NodeKind::Map(merged) }
}

fn same_key(a: &[MappingEntry], b: &[MappingEntry]) -> bool {
    matches!((a, b), ([a], [b]) if a.key == b.key)
}

/// Returns true if a default's key is overridden by the same key or by a key of another group.
fn is_overruled(path: &str, key: &str, entries: &[MappingEntry]) -> bool {
    let given = |key: &str| entries.iter().any(|e| e.key == key);
    let excludes = |groups: &[&[&str]; 2]| {
        let (own, others): (Vec<&[&str]>, Vec<&[&str]>) =
            groups.iter().partition(|group| group.contains(&key));
        !own.is_empty() && others.iter().any(|group| group.iter().any(|k| given(k)))
    };
    given(key) || EXCLUSIVE.iter().any(|(at, groups)| paths_match(at, path) && excludes(groups))
}

fn paths_match(pattern: &str, path: &str) -> bool {
    let (pattern, path): (Vec<&str>, Vec<&str>) = (pattern.split('.').collect(), path.split('.').collect());
    pattern.len() == path.len() && pattern.iter().zip(&path).all(|(p, q)| *p == "*" || p == q)
}

fn join_path(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::SourceText;
    use crate::tree;

    fn parse(yaml: &str) -> TreeNode {
        let text = SourceText { path: "test.yaml".into(), body: yaml.into() };
        tree::parse_tree(&text, 0).unwrap_or_else(|p| panic!("{yaml}: {p:?}")).expect("it is not empty")
    }

    /// Canonical form without places: keys sorted.
    fn plain(node: &TreeNode) -> String {
        match &node.kind {
            NodeKind::Null | NodeKind::Refused => "~".into(),
            NodeKind::Scalar { text, .. } => text.clone(),
            NodeKind::List(items) => format!("[{}]", items.iter().map(plain).collect::<Vec<_>>().join(" ")),
            NodeKind::Map(entries) => {
                let mut parts: Vec<String> =
                    entries.iter().map(|e| format!("{}:{}", e.key, plain(&e.value))).collect();
                parts.sort();
                format!("{{{}}}", parts.join(" "))
            }
        }
    }

    #[test]
    fn the_scene_wins_and_what_it_leaves_open_is_inherited() {
        let t = |over: &str, under: &str, wanted: &str| {
            assert_eq!(plain(&merge_nodes(parse(over), &parse(under))), wanted, "{over} over {under}");
        };
        t("a: 1", "b: 2", "{a:1 b:2}");
        t("a: {x: 1}", "a: {x: 2, y: 3}", "{a:{x:1 y:3}}");
        t("a: {b: {c: 1}}", "a: {b: {d: 2}, e: 3}", "{a:{b:{c:1 d:2} e:3}}");
        t("a: [1]", "a: [2, 3]", "{a:[1]}");
        t("a: 1", "a: {x: 2}", "{a:1}");
        t("a: {x: 1}", "a: 2", "{a:{x:1}}");
    }

    #[test]
    fn another_choice_replaces_the_whole() {
        let t = |over: &str, under: &str, wanted: &str| {
            assert_eq!(plain(&merge_nodes(parse(over), &parse(under))), wanted, "{over} over {under}");
        };
        t("source: {colmap: {path: a}}", "source: {procedural: {seed: 1}}", "{source:{colmap:{path:a}}}");
        t("sensor: {esim: {c: 1}}", "sensor: {voltmeter: {preset: dvs346}}", "{sensor:{esim:{c:1}}}");
        t(
            "sensor: {esim: {front_end: {luminance: {weights: [1]}}}}",
            "sensor: {esim: {front_end: {luminance: {other: 2}, exposure: 3}}}",
            "{sensor:{esim:{front_end:{exposure:3 luminance:{weights:[1]}}}}}",
        );
        t(
            "source: {procedural: {arc: 1}}",
            "source: {procedural: {seed: 1}}",
            "{source:{procedural:{arc:1 seed:1}}}",
        );
        t(
            "checks: {speed: {max: 1}}",
            "checks: {polarity: {max: 2}}",
            "{checks:{polarity:{max:2} speed:{max:1}}}",
        );
    }

    #[test]
    fn another_way_of_saying_it_replaces_the_default_one() {
        let t = |over: &str, under: &str, wanted: &str| {
            let wrap = |s: &str| parse(&format!("sensor: {{voltmeter: {{{s}}}}}"));
            let merged = plain(&merge_nodes(wrap(over), &wrap(under)));
            assert_eq!(merged, format!("{{sensor:{{voltmeter:{{{wanted}}}}}}}"), "{over} over {under}");
        };
        t("k: [1], units: u", "preset: dvs346, gain: log", "gain:log k:[1] units:u");
        t("preset: dvs240", "k: [1], units: u", "preset:dvs240");
        t("units: v", "k: [1], units: u", "k:[1] units:v");
        t("gain: log", "preset: dvs240", "gain:log preset:dvs240");
        assert_eq!(
            plain(&merge_nodes(parse("sensors: {a: 1}"), &parse("sensor: {b: 2}"))),
            "{sensors:{a:1}}"
        );
    }
}
