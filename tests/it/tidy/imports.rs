//! The order of modules: the table of `src/lib.rs` and the `crate::` paths in the code.

use super::Fault;
use super::source::Source;

/// The modules from the ground up. A module may name only those before it.
const ORDER: &[&str] = &[
    // foundation: pure values
    "units",
    "escape",
    "html",
    "files",
    "programs",
    "budget",
    "stats",
    "elementary",
    "seed",
    "image",
    "se3",
    // domain: values and models; bytes only through Read and Write
    "camera",
    "source",
    "scene",
    "speed",
    "trajectory",
    "render",
    "gpu",
    "lights",
    "frames",
    "event",
    "sensor",
    "sampling",
    "imu",
    "reconstruct",
    "training",
    "foreign",
    "check",
    "dataset",
    "licence",
    // engine
    "store",
    "artifact",
    "stage",
    "recipe",
    "plan",
    "run",
    "cluster",
    "release",
    "export",
    "study",
    "cli",
];

/// Imports that the order alone would allow and the project does not: (module, forbidden module).
const NEVER: &[(&str, &str)] = &[
    // A sensor knows luminance and time, from any origin.
    ("sensor", "camera"),
    ("sensor", "scene"),
    ("sensor", "trajectory"),
    ("sensor", "render"),
    ("event", "render"),
    ("event", "scene"),
    // The store keeps bytes. Of the crate's modules it uses only the one for files.
    ("store", "*"),
];

/// Faults of one file: names of later modules in the order, and of forbidden ones.
pub(super) fn imports_go_upward(sources: &[Source]) -> Vec<Fault> {
    sources
        .iter()
        .flat_map(|source| source.modules().first().map_or_else(Vec::new, |own| faults(source, own)))
        .collect()
}

fn faults(source: &Source, own: &str) -> Vec<Fault> {
    let rank = |module: &str| ORDER.iter().position(|other| *other == module);
    let Some(own_rank) = rank(own) else {
        return vec![Fault::new(source, 1, format!("module `{own}` has no place in the table of imports"))];
    };
    let forbids = |module: &str| {
        NEVER.iter().any(|(who, whom)| *who == own && (is_any(whom, module) || *whom == module))
    };
    let bad = |module: &str| rank(module).is_some_and(|r| r > own_rank) || forbids(module);
    named_modules(source)
        .into_iter()
        .filter(|(_, module)| module != own && bad(module))
        .map(|(line, module)| Fault::new(source, line, format!("`{own}` must not know `{module}`")))
        .collect()
}

/// Returns true if `whom` is `*`, which means every module except `files`, and `module` is one of
/// these.
fn is_any(whom: &str, module: &str) -> bool {
    whom == "*" && module != "files"
}

/// The crate's modules that the code names, with their lines: after `crate::`, in a group after it,
/// and through `super`s that reach the root.
fn named_modules(source: &Source) -> Vec<(usize, String)> {
    let mut to_root = vec!["crate::".to_owned()];
    if !source.modules().is_empty() {
        to_root.push("super::".repeat(source.modules().len()));
    }
    let mut found = Vec::new();
    for prefix in &to_root {
        for (at, _) in source.code.match_indices(prefix.as_str()) {
            let line = 1 + source.code[..at].matches('\n').count();
            let names = first_names(&source.code[at + prefix.len()..]);
            found.extend(names.into_iter().map(|name| (line, name)));
        }
    }
    found.retain(|(_, name)| ORDER.contains(&name.as_str()));
    found.sort();
    found
}

/// The first name of each path in `a::b`, `{a, b::{c, d}}`.
fn first_names(path: &str) -> Vec<String> {
    let name =
        |text: &str| -> String { text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect() };
    let Some(group) = path.strip_prefix('{') else { return vec![name(path)] };
    let mut depth = 0;
    let mut names = vec![name(group.trim_start())];
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => names.push(name(group[i + 1..].trim_start())),
            _ => {}
        }
    }
    names
}

#[test]
fn names_are_found_in_every_form_of_import() {
    let names = |path: &str, code: &str| {
        let found = named_modules(&Source::new(path, code));
        found.into_iter().map(|(_, name)| name).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(names("src/camera.rs", "use crate::image::Size;"), "image");
    assert_eq!(
        names("src/scene.rs", "use crate::{se3::{Se3, exp}, units};\nfn f() -> crate::image::Size"),
        "se3 units image"
    );
    assert_eq!(
        names("src/scene/ply.rs", "use super::Gaussians; use super::super::camera::Camera;"),
        "camera"
    );
    assert_eq!(names("src/scene.rs", "use super::camera::Camera;"), "camera");
    assert_eq!(names("src/scene.rs", "// crate::camera\nlet s = \"crate::camera\";"), "");
}
