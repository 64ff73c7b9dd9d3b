//! `docs/recipe.md`: every key of a recipe with type, unit, range, default and meaning.
//!
//! Names, types and words come from the declarations of the schema. Ranges, and the check of the
//! defaults, come from the loader.

use super::declared::{Crate, Declared, Member};
use super::markdown::{slug, wrapped};
use super::probe;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Comment of a field, in its parts.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Words {
    pub(super) meaning: String,
    unit: String,
    pub(super) range: String,
    pub(super) default: String,
    pub(super) required: bool,
    ablation: bool,
}

/// Last word of the comment on a key or a choice that only comparisons with other programs need. It is listed
/// in `docs/ablations.md` instead of the reference.
const ABLATION: &str = "Ablation.";

impl Words {
    pub(super) fn of(doc: &str) -> Self {
        let (rest, required) = match doc.strip_suffix("Required.") {
            Some(rest) => (rest.trim_end(), true),
            None => (doc, false),
        };
        let (rest, default) = part(rest, "Default: ");
        let (rest, range) = part(rest, "Range: ");
        let (rest, unit) = part(rest, "Unit: ");
        let (meaning, ablation) = match rest.strip_suffix(ABLATION) {
            Some(meaning) => (meaning.trim_end(), true),
            None => (rest, false),
        };
        Self { meaning: meaning.to_owned(), unit, range, default, required, ablation }
    }

    /// The default, if it is written as YAML: in backticks, and nothing else.
    pub(super) fn yaml_default(&self) -> Option<&str> {
        let inner = self.default.strip_prefix('`')?.strip_suffix('`')?;
        (!inner.contains('`')).then_some(inner)
    }
}

/// Splits a comment at `tag`: the text before, and the tag's text without its final full stop.
fn part<'d>(doc: &'d str, tag: &str) -> (&'d str, String) {
    match doc.rsplit_once(tag) {
        Some((before, after)) => (before.trim_end(), after.trim_end().trim_end_matches('.').to_owned()),
        None => (doc, String::new()),
    }
}

/// A key with its path, as the reference lists it.
pub(super) struct Key<'c> {
    pub(super) path: String,
    pub(super) member: &'c Member,
    pub(super) words: Words,
    file: &'c str,
}

/// A mapping of the recipe, with every path that leads to it.
struct Section<'c> {
    paths: Vec<String>,
    declared: &'c Declared,
}

/// A key, or a choice of one, as the page of ablations lists it.
struct Ablation<'c> {
    of: &'c Member,
    value: String,
}

/// The reference: sections in the order in which a reader of the schema meets them.
pub(super) struct Reference<'c> {
    krate: &'c Crate,
    sections: Vec<Section<'c>>,
}

impl<'c> Reference<'c> {
    pub(super) fn of(krate: &'c Crate) -> Self {
        let mut reference = Self { krate, sections: Vec::new() };
        reference.visit("", krate.recipe());
        reference
    }

    fn visit(&mut self, path: &str, declared: &'c Declared) {
        let known = self.sections.iter_mut().find(|section| std::ptr::eq(section.declared, declared));
        if let Some(section) = known {
            section.paths.push(path.to_owned());
        } else if !declared.is_enum {
            self.sections.push(Section { paths: vec![path.to_owned()], declared });
        }
        for (path, inner) in self.below(path, declared) {
            self.visit(&path, inner);
        }
    }

    /// The mappings directly below one.
    fn below(&self, path: &str, declared: &'c Declared) -> Vec<(String, &'c Declared)> {
        let inner = |member: &Member| {
            let (name, list) = core(&member.ty);
            // `sensors` holds the same as `sensor`, as do the cameras of a rig, and limits have a section of
            // their own.
            let repeated = path == "rig.cameras[]" && ["camera", "sensor"].contains(&member.name.as_str());
            if name == "Limits" || member.ty.contains("BTreeMap") || repeated {
                return None;
            }
            let found = self.krate.named(name, &declared.file)?;
            Some((format!("{}{list}", join(path, &member.name)), found))
        };
        declared.members.iter().filter_map(inner).collect()
    }

    /// Every key, with the first path that leads to it.
    pub(super) fn keys(&self) -> Vec<Key<'c>> {
        let of = |section: &Section<'c>| {
            let declared = section.declared;
            let path = section.paths[0].clone();
            declared.members.iter().map(move |member| Key {
                path: join(&path, &member.name),
                member,
                words: Words::of(&member.doc),
                file: &declared.file,
            })
        };
        self.sections.iter().flat_map(of).collect()
    }

    /// Every path that leads to a key.
    pub(super) fn places_of(&self, declared: &Declared, member: &Member) -> Vec<String> {
        let section = self.sections.iter().find(|section| std::ptr::eq(section.declared, declared));
        let paths = section.map_or(&[][..], |section| &section.paths);
        paths.iter().map(|path| join(path, &member.name)).collect()
    }

    /// The page's generated part.
    pub(super) fn markdown(&self) -> String {
        let mut out = String::new();
        for section in &self.sections {
            let heading = heading(&section.paths);
            let _ = write!(out, "\n## {heading}\n\n");
            let used = used_in(&section.paths).map(|list| format!("Used in {list}. ")).unwrap_or_default();
            let _ = write!(out, "{}\n\n{HEAD}", wrapped(&format!("{used}{}", section.declared.doc)));
            for member in section.declared.members.iter().filter(|member| !Words::of(&member.doc).ablation) {
                out.push_str(&self.row(&section.paths[0], member, &section.declared.file));
            }
        }
        out + &self.checks()
    }

    /// The generated part of the page of ablations: keys, and choices of keys.
    pub(super) fn ablations(&self) -> String {
        let mut out = "\n| key | value | meaning |\n|---|---|---|\n".to_owned();
        for section in &self.sections {
            let file = &section.declared.file;
            for member in &section.declared.members {
                let key = Ablation { of: member, value: self.kind(member, file) };
                let choices = self.enumeration(member, file).map_or(&[][..], |found| &found.members);
                let choice = |of| Ablation { of, value: format!("`{}`", of.name) };
                for Ablation { of, value } in std::iter::once(key).chain(choices.iter().map(choice)) {
                    if let Words { meaning, ablation: true, .. } = Words::of(&of.doc) {
                        let path = join(&section.paths[0], &member.name);
                        let _ = writeln!(out, "| `{path}` | {value} | {meaning} |");
                    }
                }
            }
        }
        out
    }

    fn row(&self, within: &str, member: &Member, file: &str) -> String {
        let words = Words::of(&member.doc);
        let path = join(within, &member.name);
        let range =
            if words.range.is_empty() { number_range(&path, &member.ty) } else { words.range.clone() };
        let default = if words.required { "required" } else { &words.default };
        let cells = [&format!("`{}`", member.name), &self.kind(member, file), &words.unit, &range, default];
        let cells: Vec<&str> = cells.into_iter().map(|cell| cell as &str).collect();
        format!("| {} | {}{} |\n", cells.join(" | "), words.meaning, self.choices(&path, member, file))
    }

    /// Type of a field in words, with a link to the section of a mapping.
    fn kind(&self, member: &Member, file: &str) -> String {
        let (name, _) = core(&member.ty);
        let ty = member.ty.as_str();
        let of = match name {
            "u64" | "u32" => "integer".to_owned(),
            "f64" | "NumberLiteral" => "number".to_owned(),
            "bool" => "boolean".to_owned(),
            "String" => "text".to_owned(),
            "UnsupportedField" => return "not built yet".to_owned(),
            "WhiteBrightness" => "`255` or `1`".to_owned(),
            "Limits" => "[mapping](#checks)".to_owned(),
            name => match self.krate.named(name, file) {
                Some(found) if found.is_enum => "choice".to_owned(),
                Some(found) => format!("[mapping](#{})", self.anchor(found)),
                None => panic!("{name}, the type of `{}`, is not declared", member.name),
            },
        };
        let count = ty.split_once("; ").and_then(|(_, rest)| rest.split(']').next());
        if let Some(count) = count {
            return format!("list of {count} numbers");
        }
        if ty.contains("BTreeMap") {
            return format!("{of} by name");
        }
        if ty.contains("Vec<") { format!("list of {of}") } else { of }
    }

    fn anchor(&self, declared: &Declared) -> String {
        let section = self.sections.iter().find(|section| std::ptr::eq(section.declared, declared));
        slug(&heading(&section.expect("every mapping has a section").paths))
    }

    /// The enumeration that a key takes its value from.
    fn enumeration(&self, member: &Member, file: &str) -> Option<&'c Declared> {
        let (name, _) = core(&member.ty);
        // White is written as a number, and the same choices stand with `sensor`.
        let elsewhere = matches!(name, "WhiteBrightness" | "Limits") || member.ty.contains("BTreeMap");
        if elsewhere {
            return None;
        }
        self.krate.named(name, file).filter(|found| found.is_enum)
    }

    /// Choices of an enumeration, one per line.
    fn choices(&self, path: &str, member: &Member, file: &str) -> String {
        let Some(found) = self.enumeration(member, file) else {
            return String::new();
        };
        let choice = |choice: &Member| {
            let inner = self.krate.named(core(&choice.ty).0, &found.file).filter(|_| !choice.ty.is_empty());
            let name = match inner {
                Some(inner) => format!("[`{}`](#{})", choice.name, self.anchor(inner)),
                None => format!("`{}`", choice.name),
            };
            let later = if choice.ty.contains("UnsupportedField") { " Not built yet." } else { "" };
            assert!(!choice.doc.is_empty(), "`{}` of {path} has no comment", choice.name);
            format!("<br>{name}: {}{later}", choice.doc)
        };
        found.members.iter().filter(|choice| !Words::of(&choice.doc).ablation).map(choice).collect()
    }

    /// The section `checks`, whose limits are declared with the checks that read them.
    fn checks(&self) -> String {
        let mut out = format!("\n## `checks`\n\n{}\n\n{HEAD}", wrapped(CHECKS));
        for (path, member, file) in self.limits() {
            let words = Words::of(&member.doc);
            let default = constants(&words.default, self.krate.text(&file));
            let kind = if member.ty.contains("u32") { "integer" } else { "number" };
            let range = number_range(&format!("checks.{path}"), &member.ty);
            let _ = writeln!(
                out,
                "| `{path}` | {kind} | {} | {range} | {default} | {} |",
                words.unit, words.meaning
            );
        }
        out + WAIVERS
    }

    /// Keys of limits, with the file that declares each.
    pub(super) fn limits(&self) -> Vec<(String, &'c Member, String)> {
        let rows = self.krate.text("crates/check/src/table.rs").lines();
        let passes = rows.filter_map(|row| row.split_once("(limits ")?.1.split(')').next());
        let keys = passes.flat_map(|pass| {
            let file = format!("crates/check/src/{pass}.rs");
            let declared = self.krate.named("Limits", &file).expect("every pass has limits");
            declared
                .members
                .iter()
                .map(move |member| (format!("{pass}.{}", member.name), member, file.clone()))
        });
        keys.collect()
    }
}

const HEAD: &str = "| key | type | unit | range | default | meaning |\n|---|---|---|---|---|---|\n";

const CHECKS: &str = "Limits that replace the defaults of [the validation passes](checks.md). A limit that a recipe sets is a \
                      gate: a release is refused \
                      where it is exceeded. `pose_colmap`, `pose_opencv` and `readback` run only where a recipe names \
                      them, and `{}` is enough.";

const WAIVERS: &str = "| `waive` | list of mapping |  |  | `[]` | Failures to accept: `{ check: NAME, because: reason }`, both \
                       required. |\n";

/// Name of the type inside `Field`, `Box`, lists and mappings, and `[]` if it is the type of a
/// list's items.
fn core(ty: &str) -> (&str, &'static str) {
    let list = if ty.contains("Vec<") { "[]" } else { "" };
    let inner = ty.rsplit('<').next().unwrap_or(ty).trim_start_matches('[');
    (inner.trim_end_matches(['>', ']']).split([',', ';', '>']).next().unwrap_or(inner).trim(), list)
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Last key of a path.
fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

fn heading(paths: &[String]) -> String {
    let common = paths.iter().all(|path| last(path) == last(&paths[0]));
    match paths {
        [path] if path.is_empty() => "The whole recipe".to_owned(),
        [path] => format!("`{path}`"),
        [path, ..] if common => format!("`{}`", last(path)),
        paths => paths.iter().map(|path| format!("`{path}`")).collect::<Vec<_>>().join(", "),
    }
}

/// Paths that share a mapping under one name.
fn used_in(paths: &[String]) -> Option<String> {
    let shared = paths.len() > 1 && paths.iter().all(|path| last(path) == last(&paths[0]));
    let parents =
        paths.iter().filter_map(|path| path.rsplit_once('.')).map(|(parent, _)| format!("`{parent}`"));
    shared.then(|| parents.collect::<Vec<_>>().join(", "))
}

/// Range of a number as the loader states it when it refuses an absurd one; empty if the key holds
/// no number.
pub(super) fn number_range(path: &str, ty: &str) -> String {
    let (name, _) = core(ty);
    let absurd = match name {
        "u64" => json!(u64::MAX),
        "u32" => json!(0),
        "f64" | "NumberLiteral" => json!(-1e300),
        _ => return String::new(),
    };
    let count = ty.split_once("; ").and_then(|(_, rest)| rest.split(']').next()?.parse::<usize>().ok());
    let absurd = match count {
        Some(count) => Value::Array(vec![absurd; count]),
        None if ty.contains("Vec<") => json!([absurd]),
        None => absurd,
    };
    probe::range(path, absurd).unwrap_or_default()
}

/// A default, with the constants of a source replaced by their values.
fn constants(default: &str, source: &str) -> String {
    let values: BTreeMap<&str, &str> = source
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("const "))
        .filter_map(|line| Some((line.split(':').next()?, line.split(" = ").nth(1)?.trim_end_matches(';'))))
        .collect();
    let parts = default.split('`').enumerate().map(|(i, part)| match values.get(part) {
        Some(value) if i % 2 == 1 => value.trim_end_matches(".0").to_owned(),
        _ => part.to_owned(),
    });
    parts.collect::<Vec<_>>().join("`")
}

impl Key<'_> {
    /// Returns true if the key is reserved for a feature that does not exist.
    pub(super) fn is_later(&self) -> bool {
        self.member.ty.contains("UnsupportedField")
    }

    /// Place of the declaration, for messages.
    pub(super) fn place(&self) -> String {
        format!("{}: `{}`", self.file, self.path)
    }
}

#[test]
fn comments_have_parts() {
    let words = Words::of("Width of the image. Unit: px. Required.");
    assert_eq!(
        (words.meaning.as_str(), words.unit.as_str(), words.required),
        ("Width of the image.", "px", true)
    );
    let words = Words::of("Days. Range: `Y`. Default: `[0, 1]`.");
    assert_eq!((words.range.as_str(), words.yaml_default()), ("`Y`", Some("[0, 1]")));
    assert_eq!(Words::of("A. Default: `a` for `b`.").yaml_default(), None);
    let words = Words::of("The paper's equation. Ablation. Default: `false`.");
    assert_eq!((words.meaning.as_str(), words.ablation), ("The paper's equation.", true));
    assert_eq!(core("Field<BTreeMap<String, Field<Sensor>>>"), ("Sensor", ""));
    assert_eq!(core("Field<Vec<Field<Trajectory>>>"), ("Trajectory", "[]"));
    assert_eq!(core("Field<[Field<f64>; 3]>"), ("f64", ""));
    assert_eq!(core("Option<f64>"), ("f64", ""));
    assert_eq!(constants("`MOST` or so", "const MOST: f64 = 3.0;\n"), "`3` or so");
}
