//! Record sets of `croissant.json`. Each field comes from a column of the index or from a place in
//! every `scene.json`. The source must exist and hold the stated type.

use super::{CroissantSubject, croissant_fault, node_id, node_list};
use crate::{AuditFault, FaultCode};
use gs2e_release::croissant::{SPLITS, data_type};
use gs2e_release::index;
use serde_json::Value;

pub(super) fn audit_records(file: &Value, subject: &CroissantSubject<'_>) -> Vec<AuditFault> {
    let scenes: Vec<Value> = subject.scenes.iter().map(|scene| serde_json::json!(scene)).collect();
    let mut faults = Vec::new();
    for set in node_list(&file["recordSet"]) {
        let fields = node_list(&set["field"]);
        if fields.is_empty() {
            faults.push(croissant_fault(
                FaultCode::CroissantField,
                format!("the record set {} has no fields", node_id(set)),
            ));
        }
        for key in node_list(&set["key"]).iter().map(node_id) {
            if !fields.iter().any(|field| node_id(field) == key) {
                let message =
                    format!("the key of {} is {key:?}, which is not one of its fields", node_id(set));
                faults.push(croissant_fault(FaultCode::CroissantReference, message));
            }
        }
        if set["data"].is_array() {
            faults.extend(fields.iter().filter_map(|field| audit_written(field, set)));
        } else {
            faults.extend(fields.iter().filter_map(|field| audit_field(field, file, subject, &scenes)));
        }
        faults.extend(fields.iter().filter_map(|field| audit_reference(field, file)));
    }
    faults.extend(split_fault(file, subject));
    faults
}

/// Checks a field of records that are written out: each record has it, as a text.
fn audit_written(field: &Value, set: &Value) -> Option<AuditFault> {
    let lacking = node_list(&set["data"]).iter().find(|record| !record[node_id(field)].is_string());
    lacking.map(|record| {
        croissant_fault(
            FaultCode::CroissantColumn,
            format!("{} is missing or not a text in {record}", node_id(field)),
        )
    })
}

/// Checks that the field that another one refers to exists.
fn audit_reference(field: &Value, file: &Value) -> Option<AuditFault> {
    let wanted = field["references"]["field"]["@id"].as_str()?;
    let mut fields = node_list(&file["recordSet"]).iter().flat_map(|set| node_list(&set["field"]));
    let found = fields.any(|field| node_id(field) == wanted);
    let message = || format!("{} refers to {wanted:?}, which is not defined", node_id(field));
    (!found).then(|| croissant_fault(FaultCode::CroissantReference, message()))
}

/// Checks that the splits are those of the manifest.
fn split_fault(file: &Value, subject: &CroissantSubject<'_>) -> Option<AuditFault> {
    let set = node_list(&file["recordSet"]).iter().find(|set| node_id(set) == SPLITS);
    let field = format!("{SPLITS}/name");
    let found = set.iter().flat_map(|set| node_list(&set["data"]));
    let found: Vec<&str> = found.map(|record| record[&field].as_str().unwrap_or_default()).collect();
    let wanted = subject.manifest.splits.iter().flat_map(|splits| splits.shares.keys());
    let wanted: Vec<&str> = wanted.map(String::as_str).collect();
    let message = || format!("its splits are {found:?}, manifest.json has {wanted:?}");
    (found != wanted).then(|| croissant_fault(FaultCode::ClaimsDisagree, message()))
}

fn audit_field(
    field: &Value,
    file: &Value,
    subject: &CroissantSubject<'_>,
    scenes: &[Value],
) -> Option<AuditFault> {
    let source = &field["source"];
    // A field has one of the two. With both, the joined id would match no node.
    let origin = [&source["fileObject"], &source["fileSet"]].map(node_id).concat();
    if origin.is_empty() || !node_list(&file["distribution"]).iter().any(|node| node_id(node) == origin) {
        let message = format!("{} is taken from {origin:?}, which is not defined", node_id(field));
        return Some(croissant_fault(FaultCode::CroissantReference, message));
    }
    let stated = field["dataType"].as_str().unwrap_or_default();
    let extract = &source["extract"];
    let problem = match (extract["column"].as_str(), extract["jsonPath"].as_str()) {
        (Some(column), None) if origin == index::NAME => of_column(column, stated, subject),
        (None, Some(path)) => scenes.iter().find_map(|scene| of_path(path, stated, scene)),
        _ => Some("has no known source".to_owned()),
    };
    problem
        .map(|problem| croissant_fault(FaultCode::CroissantColumn, format!("{} {problem}", node_id(field))))
}

/// Describes the fault of a field that comes from a column of the index. Returns `None` if there is
/// no index, which is a fault already.
fn of_column(column: &str, stated: &str, subject: &CroissantSubject<'_>) -> Option<String> {
    let (_, kind) = match subject.index?.columns.iter().find(|(name, _)| name == column) {
        Some(found) => found,
        None => return Some(format!("is the column {column:?}, which is not in {}", index::NAME)),
    };
    let found = kind.map_or("of unknown type", data_type);
    (found != stated).then(|| format!("is {stated}, the column {column} is {found}"))
}

/// Describes the fault of a field that comes from a place in a `scene.json`.
fn of_path(path: &str, stated: &str, scene: &Value) -> Option<String> {
    // The paths that this program writes have plain names only, so a JSON pointer can follow them.
    let pointer = path.strip_prefix('$').unwrap_or(path).replace('.', "/");
    let found = match scene.pointer(&pointer) {
        None => {
            return Some(format!("is taken from {path}, which is not in the scene.json of {}", scene["id"]));
        }
        Some(found) => found,
    };
    let fits = match stated {
        "sc:Text" => found.is_string(),
        "sc:Integer" => found.is_i64() || found.is_u64(),
        "sc:Float" => found.is_number(),
        "sc:Boolean" => found.is_boolean(),
        _ => false,
    };
    (!fits).then(|| format!("is {stated}, but {found} in the scene.json of {}", scene["id"]))
}
