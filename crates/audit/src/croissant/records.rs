//! Record sets of `croissant.json`. Each field comes from a column of the index or from a place in
//! every `scene.json`. The source must exist and hold the stated type.

use super::{CroissantAudit, node_id, node_list};
use crate::FaultCode;
use gs2e_release::croissant::{SPLITS, data_type};
use gs2e_release::index;
use gs2e_release::scene::SceneRecord;
use serde_json::Value;

impl CroissantAudit<'_> {
    pub(super) fn judge_records(&mut self, scenes: &[SceneRecord]) {
        let scenes: Vec<Value> = scenes.iter().map(|scene| serde_json::json!(scene)).collect();
        for set in self.record_sets() {
            let fields = node_list(&set["field"]);
            if fields.is_empty() {
                self.report(
                    FaultCode::CroissantField,
                    format!("the record set {} has no fields", node_id(set)),
                );
            }
            for key in node_list(&set["key"]).iter().map(node_id) {
                if fields.iter().all(|field| node_id(field) != key) {
                    let message =
                        format!("the key of {} is {key:?}, which is not one of its fields", node_id(set));
                    self.report(FaultCode::CroissantReference, message);
                }
            }
            for field in fields {
                if set["data"].is_array() {
                    self.judge_written(field, set);
                } else {
                    self.judge_field(field, &scenes);
                }
                self.judge_reference(field);
            }
        }
        self.judge_splits();
    }

    /// Checks a field of records that are written out: each record has it, as a text.
    fn judge_written(&mut self, field: &Value, set: &Value) {
        let id = node_id(field);
        if let Some(record) = node_list(&set["data"]).iter().find(|record| !record[id].is_string()) {
            self.report(FaultCode::CroissantColumn, format!("{id} is missing or not a text in {record}"));
        }
    }

    /// Checks that the field that another one refers to exists.
    fn judge_reference(&mut self, field: &Value) {
        let Some(wanted) = field["references"]["field"]["@id"].as_str() else { return };
        let mut fields = self.record_sets().iter().flat_map(|set| node_list(&set["field"]));
        if fields.all(|field| node_id(field) != wanted) {
            let message = format!("{} refers to {wanted:?}, which is not defined", node_id(field));
            self.report(FaultCode::CroissantReference, message);
        }
    }

    /// Checks that the splits are those of the manifest.
    fn judge_splits(&mut self) {
        let set = self.record_sets().iter().find(|set| node_id(set) == SPLITS);
        let field = format!("{SPLITS}/name");
        let found = set.iter().flat_map(|set| node_list(&set["data"]));
        let found: Vec<&str> = found.map(|record| record[&field].as_str().unwrap_or_default()).collect();
        let wanted = self.manifest.splits.iter().flat_map(|splits| splits.shares.keys());
        let wanted: Vec<&str> = wanted.map(String::as_str).collect();
        if found != wanted {
            let message = format!("its splits are {found:?}, manifest.json has {wanted:?}");
            self.report(FaultCode::ClaimsDisagree, message);
        }
    }

    fn judge_field(&mut self, field: &Value, scenes: &[Value]) {
        let (name, source) = (node_id(field), &field["source"]);
        // A field has one of the two. With both, the joined id would match no node.
        let origin = [&source["fileObject"], &source["fileSet"]].map(node_id).concat();
        if origin.is_empty() || self.distribution().iter().all(|node| node_id(node) != origin) {
            let message = format!("{name} is taken from {origin:?}, which is not defined");
            return self.report(FaultCode::CroissantReference, message);
        }
        let stated = field["dataType"].as_str().unwrap_or_default();
        let extract = &source["extract"];
        let problem = match (extract["column"].as_str(), extract["jsonPath"].as_str()) {
            (Some(column), None) if origin == index::NAME => self.column_problem(column, stated),
            (None, Some(path)) => scenes.iter().find_map(|scene| path_problem(path, stated, scene)),
            _ => Some("has no known source".to_owned()),
        };
        if let Some(problem) = problem {
            self.report(FaultCode::CroissantColumn, format!("{name} {problem}"));
        }
    }

    /// Describes the fault of a field that comes from a column of the index. Returns `None` if there is
    /// no index, which is a fault already.
    fn column_problem(&self, column: &str, stated: &str) -> Option<String> {
        let Some((_, kind)) = self.index?.columns.iter().find(|(name, _)| name == column) else {
            return Some(format!("is the column {column:?}, which is not in {}", index::NAME));
        };
        let found = kind.map_or("of unknown type", data_type);
        (found != stated).then(|| format!("is {stated}, the column {column} is {found}"))
    }
}

/// Describes the fault of a field that comes from a place in a `scene.json`.
fn path_problem(path: &str, stated: &str, scene: &Value) -> Option<String> {
    // The paths that this program writes have plain names only, so a JSON pointer can follow them.
    let pointer = path.strip_prefix('$').unwrap_or(path).replace('.', "/");
    let Some(found) = scene.pointer(&pointer) else {
        return Some(format!("is taken from {path}, which is not in the scene.json of {}", scene["id"]));
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
