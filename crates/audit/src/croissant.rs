//! Checks that `croissant.json` has the required fields, and that its statements about files,
//! columns and terms hold. Its reader `mlcroissant` accepts most of these faults.

mod records;

use super::{AuditFault, FaultCode, TrustedTree};
use gs2e_release::croissant::{
    CONFORMS_TO, NAME, REQUIRED, RESPONSIBLE, ROOT, SYNTHETIC, content_size, glob_matches, licence_address,
};
use gs2e_release::index::table::IndexTable;
use gs2e_release::manifest;
use gs2e_release::manifest::ReleaseManifest;
use gs2e_release::scene::SceneRecord;
use serde_json::Value;
use std::collections::BTreeSet;

/// The parts of a release that the file is compared with.
#[derive(Debug)]
pub(super) struct CroissantSubject<'a> {
    pub(super) tree: &'a TrustedTree<'a>,
    pub(super) manifest: &'a ReleaseManifest,
    /// The index, where it could be read.
    pub(super) index: Option<&'a IndexTable>,
    /// The scenes that could be read.
    pub(super) scenes: &'a [SceneRecord],
}

fn croissant_fault(code: FaultCode, message: impl Into<String>) -> AuditFault {
    AuditFault::of_file(code, NAME, message)
}

/// The id of a node, or the one that a reference holds.
fn node_id(node: &Value) -> &str {
    node["@id"].as_str().unwrap_or_default()
}

/// The nodes of a list. A single node counts as a list of one.
fn node_list(value: &Value) -> &[Value] {
    match value {
        Value::Array(values) => values,
        Value::Null => &[],
        other => std::slice::from_ref(other),
    }
}

pub(super) fn audit_croissant(subject: &CroissantSubject<'_>) -> Vec<AuditFault> {
    if !subject.tree.has(NAME) {
        return vec![croissant_fault(
            FaultCode::Missing,
            "every release has this file; it is missing or damaged",
        )];
    }
    let mut faults = Vec::new();
    let Some(file) = super::claims::parse_claims::<Value>(subject.tree, NAME, &mut faults) else {
        return faults;
    };
    faults.extend(field_faults(&file));
    faults.extend(claim_faults(&file, subject.manifest));
    faults.extend(id_faults(&file));
    for node in node_list(&file["distribution"]) {
        match node["@type"].as_str() {
            // The root is a folder; its `sha256` is a placeholder that the format demands.
            Some("cr:FileObject") if node_id(node) == ROOT => {}
            Some("cr:FileObject") => faults.extend(object_faults(node, subject)),
            Some("cr:FileSet") => faults.extend(set_faults(node, &file, subject)),
            kind => faults.push(croissant_fault(
                FaultCode::CroissantField,
                format!("`{}` is a {kind:?}", node_id(node)),
            )),
        }
    }
    faults.extend(records::audit_records(&file, subject));
    faults
}

/// Returns faults for required fields that are absent and for fields outside the vocabulary.
fn field_faults(file: &Value) -> Vec<AuditFault> {
    let is_empty = |value: &Value| match value {
        Value::Null => true,
        Value::String(text) => text.trim().is_empty(),
        Value::Array(values) => values.is_empty(),
        Value::Object(fields) => fields.is_empty(),
        Value::Bool(_) | Value::Number(_) => false,
    };
    let lacking = REQUIRED.into_iter().filter(|name| is_empty(&file[*name]));
    let mut faults: Vec<AuditFault> =
        lacking.map(|name| croissant_fault(FaultCode::CroissantField, format!("it has no {name}"))).collect();
    for (name, wanted) in
        [("@type", Value::from("sc:Dataset")), ("conformsTo", CONFORMS_TO.into()), (SYNTHETIC, true.into())]
    {
        if file[name] != wanted {
            let message = format!("its {name} is {}, wanted {wanted}", file[name]);
            faults.push(croissant_fault(FaultCode::CroissantField, message));
        }
    }
    let keys = file.as_object().into_iter().flat_map(|fields| fields.keys());
    let unknown = keys.filter(|key| key.starts_with("rai:") && !RESPONSIBLE.contains(&key.as_str()));
    faults.extend(
        unknown.map(|key| {
            croissant_fault(FaultCode::CroissantUnknown, format!("it has the unknown field {key}"))
        }),
    );
    faults
}

/// Compares the fields that repeat the manifest.
fn claim_faults(file: &Value, manifest: &ReleaseManifest) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let wanted = licence_address(&manifest.licence);
    let found = &file["license"];
    // An absent field is reported with the required ones.
    if !found.is_null() && *found != wanted.as_str() {
        let message = format!("its license is {found}, the release is under {wanted:?}");
        faults.push(croissant_fault(FaultCode::CroissantLicence, message));
    }
    for (name, wanted) in [("name", &manifest.name), ("version", &manifest.version)] {
        if !file[name].is_null() && file[name] != wanted.as_str() {
            let message = format!("its {name} is {}, {} says {wanted:?}", file[name], manifest::NAME);
            faults.push(croissant_fault(FaultCode::ClaimsDisagree, message));
        }
    }
    faults
}

/// Checks that no two nodes have one id.
fn id_faults(file: &Value) -> Vec<AuditFault> {
    let sets = node_list(&file["recordSet"]);
    let fields = sets.iter().flat_map(|set| node_list(&set["field"]));
    let nodes = node_list(&file["distribution"]).iter().chain(sets).chain(fields);
    let mut seen = BTreeSet::new();
    let again = nodes.map(node_id).filter(|id| !seen.insert(*id));
    again
        .map(|id| croissant_fault(FaultCode::CroissantReference, format!("two nodes have the id {id:?}")))
        .collect()
}

/// Checks that a single file exists and is as described.
fn object_faults(node: &Value, subject: &CroissantSubject<'_>) -> Vec<AuditFault> {
    let name = node_id(node);
    let Some(stated) = node["sha256"].as_str() else {
        return vec![croissant_fault(FaultCode::CroissantField, format!("{name} has no sha256"))];
    };
    let path = node["contentUrl"].as_str().unwrap_or_default();
    let Some(sha256) = subject.tree.intact.get(path) else {
        return vec![croissant_fault(
            FaultCode::CroissantSum,
            format!("{name} is `{path}`, which is missing or damaged"),
        )];
    };
    let mut faults = Vec::new();
    if stated != *sha256 {
        let message = format!("the sha256 of {path} is {stated}, the file's is {sha256}");
        faults.push(croissant_fault(FaultCode::CroissantSum, message));
    }
    let bytes = std::fs::metadata(subject.tree.path_of(path)).map_or(0, |file| file.len());
    if node["contentSize"] != content_size(bytes).as_str() {
        let message =
            format!("the size of {path} is {}, the file's is {}", node["contentSize"], content_size(bytes));
        faults.push(croissant_fault(FaultCode::CroissantSum, message));
    }
    faults
}

/// Checks that a pattern matches some files, and that they lie in a described container.
fn set_faults(node: &Value, file: &Value, subject: &CroissantSubject<'_>) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let container = node_id(&node["containedIn"]);
    if !node_list(&file["distribution"]).iter().any(|other| node_id(other) == container) {
        let message = format!("{} is contained in {container:?}, which is not defined", node_id(node));
        faults.push(croissant_fault(FaultCode::CroissantReference, message));
    }
    for pattern in node_list(&node["includes"]).iter().map(|pattern| pattern.as_str().unwrap_or_default()) {
        // Its list reports a file that is not whole, so a listed path is enough here.
        if !subject.manifest.paths().any(|path| glob_matches(pattern, path)) {
            faults.push(croissant_fault(
                FaultCode::CroissantFiles,
                format!("no file matches `{pattern}` of {}", node_id(node)),
            ));
        }
    }
    if node_list(&node["includes"]).is_empty() {
        faults
            .push(croissant_fault(FaultCode::CroissantFiles, format!("{} includes nothing", node_id(node))));
    }
    faults
}
