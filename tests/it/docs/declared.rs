//! Types of the recipe as their Rust sources declare them: names, comments and field types.
//!
//! The parser reads the form that rustfmt writes, one field or variant per line, and nothing else.

use crate::support::repository::{root, sources_below};
use std::collections::BTreeMap;

/// A `struct` or an `enum`.
#[derive(Debug, Clone)]
pub(super) struct Declared {
    pub(super) doc: String,
    pub(super) is_enum: bool,
    pub(super) members: Vec<Member>,
    /// Path of the file, from the root of the repository.
    pub(super) file: String,
}

/// A field of a struct, or a variant of an enum.
#[derive(Debug, Clone)]
pub(super) struct Member {
    /// Name in a recipe.
    pub(super) name: String,
    pub(super) doc: String,
    /// Type of the field, or of the variant's content; empty for a variant without content.
    pub(super) ty: String,
}

/// Every type that the crate declares, by file.
#[derive(Debug)]
pub(super) struct Crate {
    files: BTreeMap<String, (String, BTreeMap<String, Declared>)>,
}

/// Folder of the schema.
const SCHEMA: &str = "crates/recipe/src/schema";

impl Crate {
    pub(super) fn read() -> Self {
        let file = |path: String| {
            let text = std::fs::read_to_string(root().join(&path)).expect("a source can be read");
            let types = parse(&text, &path);
            (path, (text, types))
        };
        Self { files: sources_below("crates").into_iter().map(file).collect() }
    }

    /// The type of the whole recipe.
    pub(super) fn recipe(&self) -> &Declared {
        &self.files[&format!("{SCHEMA}.rs")].1["RecipeSchema"]
    }

    /// Text of a file.
    pub(super) fn text(&self, file: &str) -> &str {
        &self.files[file].0
    }

    /// The type that `name` means in `file`: declared there, elsewhere in the schema, or imported.
    pub(super) fn named(&self, name: &str, file: &str) -> Option<&Declared> {
        let own = self.files.get(file)?.1.get(name);
        let schema = || {
            let files = self.files.iter().filter(|(path, _)| path.starts_with(SCHEMA));
            files.filter_map(|(_, (_, types))| types.get(name)).next()
        };
        own.or_else(schema).or_else(|| self.imported(name, file))
    }

    fn imported(&self, name: &str, file: &str) -> Option<&Declared> {
        let module = imports(&self.files[file].0, file).remove(name)?;
        let inside = |path: &str| path == format!("{module}.rs") || path.starts_with(&format!("{module}/"));
        let found: Vec<&Declared> = self
            .files
            .iter()
            .filter(|(path, _)| inside(path))
            .filter_map(|(_, (_, types))| types.get(name))
            .collect();
        assert!(found.len() < 2, "{name} is declared twice below {module}");
        found.first().copied()
    }
}

/// Names that a file imports from the workspace, each with its module as a path:
/// `crates/sensor/src/noise` for `use gs2e_sensor::noise::Redraw;`.
fn imports(text: &str, file: &str) -> BTreeMap<String, String> {
    let own = file.split("/src/").next().unwrap_or_default();
    let mut found = BTreeMap::new();
    for import in text.split("\nuse ").skip(1).filter_map(|rest| rest.split_once(';')) {
        let flat: String = import.0.split_whitespace().collect();
        let Some((first, flat)) = flat.split_once("::") else { continue };
        let folder = match first.strip_prefix("gs2e_") {
            Some(name) => format!("crates/{name}/src"),
            None if first == "crate" => format!("{own}/src"),
            None => continue,
        };
        let (module, names) = match flat.split_once("::{") {
            Some((module, names)) => (module.to_owned(), names.trim_end_matches('}').to_owned()),
            None => match flat.rsplit_once("::") {
                Some((module, name)) => (module.to_owned(), name.to_owned()),
                None => (String::new(), flat.trim_matches(['{', '}']).to_owned()),
            },
        };
        let path = format!("{folder}/{}", module.replace("::", "/"));
        let path = path.trim_end_matches('/').to_owned();
        found.extend(names.split(',').map(|name| (name.to_owned(), path.clone())));
    }
    found
}

/// Types that a source declares, by name.
fn parse(text: &str, file: &str) -> BTreeMap<String, Declared> {
    let mut types = BTreeMap::new();
    let (mut doc, mut attributes) = (Vec::new(), String::new());
    let mut open: Option<(String, String, Declared)> = None;
    for line in text.lines().map(str::trim) {
        if let Some(comment) = line.strip_prefix("///") {
            doc.push(comment.trim());
            continue;
        }
        if line.starts_with("#[") {
            attributes.push_str(line);
            continue;
        }
        let (doc, attributes) = (std::mem::take(&mut doc).join(" "), std::mem::take(&mut attributes));
        match &mut open {
            None => {
                let Some((name, is_enum)) = head(line) else { continue };
                let declared = Declared { doc, is_enum, members: Vec::new(), file: file.to_owned() };
                if line.ends_with('}') {
                    types.insert(name, declared);
                } else {
                    open = Some((name, attributes, declared));
                }
            }
            Some(_) if line == "}" => types.extend(open.take().map(|(name, _, declared)| (name, declared))),
            Some((_, outer, declared)) => {
                declared.members.extend(member(line, doc, &attributes, outer, declared.is_enum));
            }
        }
    }
    types
}

/// The name of the type that a line begins, and true if it is an enum.
fn head(line: &str) -> Option<(String, bool)> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let keyword = words.iter().position(|word| matches!(*word, "struct" | "enum"))?;
    let public = words.first().is_some_and(|word| word.starts_with("pub"));
    let brace = words.get(keyword + 2).is_some_and(|word| word.starts_with('{'));
    (public && brace).then(|| (words[keyword + 1].to_owned(), words[keyword] == "enum"))
}

fn member(line: &str, doc: String, attributes: &str, outer: &str, is_enum: bool) -> Option<Member> {
    let line = line.trim_end_matches(',');
    let (name, ty) = if is_enum {
        match line.split_once('(') {
            Some((name, ty)) => (name, ty.trim_end_matches(')')),
            None => (line, ""),
        }
    } else {
        line.trim_start_matches("pub ").split_once(": ")?
    };
    let renamed = attributes.split_once("rename = \"").and_then(|(_, rest)| rest.split('"').next());
    let name = match renamed {
        Some(name) => name.to_owned(),
        None if is_enum && outer.contains("rename_all") => kebab(name),
        None => name.to_owned(),
    };
    Some(Member { name, doc, ty: ty.to_owned() })
}

/// The name in kebab case, as serde writes it: `slerp-lerp` for `SlerpLerp`.
fn kebab(name: &str) -> String {
    let dashed = name.chars().enumerate().flat_map(|(i, c)| {
        let dash = (i > 0 && c.is_ascii_uppercase()).then_some('-');
        dash.into_iter().chain([c.to_ascii_lowercase()])
    });
    dashed.collect()
}

#[test]
fn declarations_are_read() {
    let text = "use crate::{B, C};\nuse gs2e_sensor::noise::F;\n\n/// A thing\n/// of two lines.\n#[serde(rename_all = \
                \"kebab-case\")]\npub(super) enum Thing {\n    /// First.\n    SlerpLerp,\n    V2e(Field<Box<X>>),\n}\n\n\
                pub struct Limits {}\n\n#[serde(default)]\npub struct Y {\n    /// Required.\n    \
                #[serde(default)]\n    pub width: Field<u64>,\n}\n";
    let types = parse(text, "crates/recipe/src/lib.rs");
    let thing = &types["Thing"];
    assert_eq!((thing.doc.as_str(), thing.is_enum, types.len()), ("A thing of two lines.", true, 3));
    let names: Vec<(&str, &str, &str)> =
        thing.members.iter().map(|m| (m.name.as_str(), m.ty.as_str(), m.doc.as_str())).collect();
    assert_eq!(names, [("slerp-lerp", "", "First."), ("v2e", "Field<Box<X>>", "")]);
    assert_eq!(
        (types["Y"].members[0].ty.as_str(), types["Y"].members[0].name.as_str()),
        ("Field<u64>", "width")
    );
    let imports = imports(&format!("\n{text}"), "crates/recipe/src/lib.rs");
    assert_eq!(imports["C"], "crates/recipe/src");
    assert_eq!(imports["F"], "crates/sensor/src/noise");
}
