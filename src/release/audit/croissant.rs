//! `croissant.json`: whether it has what it must, and whether what it says of files, columns and terms is so. Its reader
//! `mlcroissant` lets most of this pass.

mod records;

use super::{Code, Fault, Tree};
use crate::release::croissant::{
    CONFORMS_TO, NAME, REQUIRED, RESPONSIBLE, ROOT, SYNTHETIC, licence, matches, size,
};
use crate::release::index::table::Table;
use crate::release::manifest::{self, Manifest};
use crate::release::scene::SceneFile;
use serde_json::Value;
use std::collections::BTreeSet;

/// What the file is held against.
#[derive(Debug)]
pub(super) struct Subject<'a> {
    pub(super) tree: &'a Tree<'a>,
    pub(super) manifest: &'a Manifest,
    /// The index, where it could be read.
    pub(super) index: Option<&'a Table>,
    /// The scenes that could be read.
    pub(super) scenes: &'a [SceneFile],
}

fn fault(code: Code, message: impl Into<String>) -> Fault {
    Fault::of_file(code, NAME, message)
}

/// The id of a node, or the one that a reference holds.
fn id(node: &Value) -> &str {
    node["@id"].as_str().unwrap_or_default()
}

/// A list, also where a single node stands for it.
fn list(value: &Value) -> &[Value] {
    match value {
        Value::Array(values) => values,
        Value::Null => &[],
        other => std::slice::from_ref(other),
    }
}

pub(super) fn audit(subject: &Subject<'_>) -> Vec<Fault> {
    if !subject.tree.has(NAME) {
        return vec![fault(Code::Missing, "a release has one, and it is not there, or not whole")];
    }
    let mut faults = Vec::new();
    let Some(file) = super::claims::parse::<Value>(subject.tree, NAME, &mut faults) else { return faults };
    faults.extend(fields(&file));
    faults.extend(claims(&file, subject.manifest));
    faults.extend(ids(&file));
    for node in list(&file["distribution"]) {
        match node["@type"].as_str() {
            Some("cr:FileObject") if id(node) == ROOT => {}
            Some("cr:FileObject") => faults.extend(object(node, subject)),
            Some("cr:FileSet") => faults.extend(set(node, &file, subject)),
            kind => faults.push(fault(Code::CroissantField, format!("`{}` is a {kind:?}", id(node)))),
        }
    }
    faults.extend(records::audit(&file, subject));
    faults
}

/// What must be there, and what is none of the vocabulary.
fn fields(file: &Value) -> Vec<Fault> {
    let is_empty = |value: &Value| match value {
        Value::Null => true,
        Value::String(text) => text.trim().is_empty(),
        Value::Array(values) => values.is_empty(),
        Value::Object(fields) => fields.is_empty(),
        Value::Bool(_) | Value::Number(_) => false,
    };
    let lacking = REQUIRED.into_iter().filter(|name| is_empty(&file[*name]));
    let mut faults: Vec<Fault> =
        lacking.map(|name| fault(Code::CroissantField, format!("it has no {name}"))).collect();
    for (name, wanted) in
        [("@type", Value::from("sc:Dataset")), ("conformsTo", CONFORMS_TO.into()), (SYNTHETIC, true.into())]
    {
        if file[name] != wanted {
            let message = format!("its {name} is {}, wanted {wanted}", file[name]);
            faults.push(fault(Code::CroissantField, message));
        }
    }
    let keys = file.as_object().into_iter().flat_map(|fields| fields.keys());
    let unknown = keys.filter(|key| key.starts_with("rai:") && !RESPONSIBLE.contains(&key.as_str()));
    faults.extend(unknown.map(|key| fault(Code::CroissantUnknown, format!("it has a field {key}"))));
    faults
}

/// What the manifest says too.
fn claims(file: &Value, manifest: &Manifest) -> Vec<Fault> {
    let mut faults = Vec::new();
    let wanted = licence(&manifest.licence);
    let found = &file["license"];
    if !found.is_null() && *found != wanted.as_str() {
        let message = format!("its license is {found}, the release is under {wanted:?}");
        faults.push(fault(Code::CroissantLicence, message));
    }
    for (name, wanted) in [("name", &manifest.name), ("version", &manifest.version)] {
        if !file[name].is_null() && file[name] != wanted.as_str() {
            let message = format!("its {name} is {}, {} says {wanted:?}", file[name], manifest::NAME);
            faults.push(fault(Code::ClaimsDisagree, message));
        }
    }
    faults
}

/// No two nodes have one id.
fn ids(file: &Value) -> Vec<Fault> {
    let sets = list(&file["recordSet"]);
    let fields = sets.iter().flat_map(|set| list(&set["field"]));
    let nodes = list(&file["distribution"]).iter().chain(sets).chain(fields);
    let mut seen = BTreeSet::new();
    let again = nodes.map(id).filter(|id| !seen.insert(*id));
    again.map(|id| fault(Code::CroissantReference, format!("two nodes have the id {id:?}"))).collect()
}

/// A file by itself: it is there, and it is what is said of it.
fn object(node: &Value, subject: &Subject<'_>) -> Vec<Fault> {
    let name = id(node);
    let Some(stated) = node["sha256"].as_str() else {
        return vec![fault(Code::CroissantField, format!("{name} has no sha256"))];
    };
    let path = node["contentUrl"].as_str().unwrap_or_default();
    let Some(sha256) = subject.tree.intact.get(path) else {
        return vec![fault(
            Code::CroissantSum,
            format!("{name} is `{path}`, which is not there, or not whole"),
        )];
    };
    let mut faults = Vec::new();
    if stated != *sha256 {
        let message = format!("the sha256 of {path} is {stated}, the file's is {sha256}");
        faults.push(fault(Code::CroissantSum, message));
    }
    let bytes = std::fs::metadata(subject.tree.path_of(path)).map_or(0, |file| file.len());
    if node["contentSize"] != size(bytes).as_str() {
        let message = format!("the size of {path} is {}, the file's is {}", node["contentSize"], size(bytes));
        faults.push(fault(Code::CroissantSum, message));
    }
    faults
}

/// Files by a pattern: there are some, and they lie in what is described.
fn set(node: &Value, file: &Value, subject: &Subject<'_>) -> Vec<Fault> {
    let mut faults = Vec::new();
    let container = id(&node["containedIn"]);
    if !list(&file["distribution"]).iter().any(|other| id(other) == container) {
        let message = format!("{} is contained in {container:?}, which is nothing here", id(node));
        faults.push(fault(Code::CroissantReference, message));
    }
    for pattern in list(&node["includes"]).iter().map(|pattern| pattern.as_str().unwrap_or_default()) {
        // A file that is listed and not whole is told by what lists it.
        if !subject.manifest.paths().any(|path| matches(pattern, path)) {
            faults.push(fault(Code::CroissantFiles, format!("no file is of `{pattern}` of {}", id(node))));
        }
    }
    if list(&node["includes"]).is_empty() {
        faults.push(fault(Code::CroissantFiles, format!("{} includes nothing", id(node))));
    }
    faults
}
