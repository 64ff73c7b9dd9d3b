//! What cargo does not enforce about the crates: where heavy packages are named, what a crate that a
//! stranger takes brings along, and how long a crate may be.

use super::source::{Source, crate_sources, root};
use std::collections::{BTreeMap, BTreeSet};

/// Packages that take long to build, each with the most crates that may name it.
const HEAVY: [&str; 6] = ["clap", "object_store", "parquet", "rusqlite", "rust-hdf5", "wgpu"];
const MOST_NAMING: usize = 2;

/// Crates for other programs. With their neighbours below they bring no heavy package but HDF5.
const FOR_OTHERS: [&str; 7] = ["num", "image", "event", "sensor", "scene", "render", "tree"];

/// Pairs of a crate and one that it must never need: a sensor knows luminance and time, from any
/// origin, and a reader of releases knows no way of making them.
const NEVER: [(&str, &str); 4] =
    [("sensor", "scene"), ("sensor", "render"), ("event", "scene"), ("tree", "sensor")];

/// The modules of the build engine, from the ground up. A module names only those before it.
const ENGINE: [&str; 5] = ["artifact", "stage", "plan", "run", "cluster"];

/// Names of the packages that each crate needs, by crate. The program is `gs2e`.
fn needed() -> BTreeMap<String, BTreeSet<String>> {
    let folders = std::fs::read_dir(root().join("crates")).expect("there are crates");
    let folders = folders.map(|entry| entry.expect("the folder can be read").path());
    folders
        .chain([root().to_owned()])
        .map(|folder| {
            let text = std::fs::read_to_string(folder.join("Cargo.toml")).expect("a crate has a manifest");
            let name = folder.file_name().expect("a folder has a name").to_string_lossy().into_owned();
            (if folder == root() { "gs2e".to_owned() } else { name }, dependencies(&text))
        })
        .collect()
}

/// Names in the section `[dependencies]` of a manifest.
fn dependencies(manifest: &str) -> BTreeSet<String> {
    let section = manifest.split("\n[dependencies]\n").nth(1).unwrap_or_default();
    let section = section.split("\n[").next().unwrap_or_default();
    let names = section.lines().filter_map(|line| line.split(['.', ' ', '=']).next());
    names.filter(|name| !name.is_empty() && !name.starts_with('#')).map(str::to_owned).collect()
}

/// Everything that a crate needs, through other crates of the workspace too.
fn cone(name: &str, needed: &BTreeMap<String, BTreeSet<String>>) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    let mut open = vec![name.to_owned()];
    while let Some(next) = open.pop() {
        for package in needed.get(&next).into_iter().flatten() {
            if all.insert(package.clone()) {
                open.extend(package.strip_prefix("gs2e-").map(str::to_owned));
            }
        }
    }
    all
}

#[test]
fn heavy_packages_stay_where_they_are_used() {
    let needed = needed();
    assert!(needed.len() > 15, "{needed:?}");
    for heavy in HEAVY {
        let naming: Vec<&String> =
            needed.iter().filter(|(_, names)| names.contains(heavy)).map(|(name, _)| name).collect();
        assert!((1..=MOST_NAMING).contains(&naming.len()), "{heavy} is named by {naming:?}");
        for name in FOR_OTHERS.iter().filter(|_| heavy != "rust-hdf5") {
            assert!(!cone(name, &needed).contains(heavy), "gs2e-{name} brings {heavy}");
        }
    }
    for (name, other) in NEVER {
        assert!(!cone(name, &needed).contains(&format!("gs2e-{other}")), "gs2e-{name} needs gs2e-{other}");
    }
}

#[test]
fn the_engine_is_in_layers() {
    let sources = crate_sources();
    let of = |module: &str, path: &str| {
        path == format!("crates/build/src/{module}.rs")
            || path.starts_with(&format!("crates/build/src/{module}/"))
    };
    let names = |source: &Source, module: &str| source.code.contains(&format!("crate::{module}::"));
    for (i, module) in ENGINE.iter().enumerate() {
        let own: Vec<&Source> = sources.iter().filter(|source| of(module, &source.path)).collect();
        assert!(!own.is_empty(), "there is no module {module}");
        let upward = own.iter().flat_map(|source| {
            let later = ENGINE[i + 1..].iter().filter(|later| names(source, later));
            later.map(|later| format!("{} names {later}", source.path)).collect::<Vec<_>>()
        });
        assert_eq!(upward.collect::<Vec<_>>(), [""; 0]);
    }
}

#[test]
fn dependencies_are_read_from_manifests() {
    let text = "[package]\nname = \"a\"\n\n[dependencies]\n# Why.\na.workspace = true\nb = { workspace = true }\n\n\
                [dev-dependencies]\nc.workspace = true\n";
    assert_eq!(dependencies(text), ["a", "b"].map(str::to_owned).into());
    let needed = BTreeMap::from([
        ("x".to_owned(), BTreeSet::from(["gs2e-y".to_owned()])),
        ("y".to_owned(), BTreeSet::from(["wgpu".to_owned()])),
    ]);
    assert_eq!(cone("x", &needed), ["gs2e-y", "wgpu"].map(str::to_owned).into());
}
