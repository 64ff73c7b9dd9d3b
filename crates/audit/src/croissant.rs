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

/// The file, and the parts of a release that it is compared with.
struct CroissantAudit<'a> {
    file: &'a Value,
    tree: &'a TrustedTree<'a>,
    manifest: &'a ReleaseManifest,
    /// The index, where it could be read.
    index: Option<&'a IndexTable>,
    faults: Vec<AuditFault>,
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

/// Compares the file with the release. `scenes` are those that could be read.
pub(super) fn audit_croissant(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    index: Option<&IndexTable>,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    let Some(file) = super::claims::parse_claims::<Value>(tree, NAME, &mut faults) else { return faults };
    let mut audit = CroissantAudit { file: &file, tree, manifest, index, faults };
    audit.judge_fields();
    audit.judge_ids();
    audit.judge_distribution();
    audit.judge_records(scenes);
    audit.faults
}

impl<'a> CroissantAudit<'a> {
    fn report(&mut self, code: FaultCode, message: String) {
        self.faults.push(AuditFault::of_file(code, NAME, message));
    }

    fn distribution(&self) -> &'a [Value] {
        node_list(&self.file["distribution"])
    }

    fn record_sets(&self) -> &'a [Value] {
        node_list(&self.file["recordSet"])
    }

    /// Reports required fields that are absent, fields outside the vocabulary, and fields that contradict the
    /// manifest.
    fn judge_fields(&mut self) {
        let is_empty = |value: &Value| match value {
            Value::Null => true,
            Value::String(text) => text.trim().is_empty(),
            Value::Array(values) => values.is_empty(),
            Value::Object(fields) => fields.is_empty(),
            Value::Bool(_) | Value::Number(_) => false,
        };
        let file = self.file;
        for name in REQUIRED.into_iter().filter(|name| is_empty(&file[*name])) {
            self.report(FaultCode::CroissantField, format!("it has no {name}"));
        }
        let fixed =
            [("@type", "sc:Dataset".into()), ("conformsTo", CONFORMS_TO.into()), (SYNTHETIC, true.into())];
        for (name, wanted) in
            fixed.into_iter().filter(|(name, wanted): &(&str, Value)| file[*name] != *wanted)
        {
            self.report(FaultCode::CroissantField, format!("its {name} is {}, wanted {wanted}", file[name]));
        }
        let keys = file.as_object().into_iter().flat_map(|fields| fields.keys());
        for key in keys.filter(|key| key.starts_with("rai:") && !RESPONSIBLE.contains(&key.as_str())) {
            self.report(FaultCode::CroissantUnknown, format!("it has the unknown field {key}"));
        }
        let ReleaseManifest { name, version, licence, .. } = self.manifest;
        for (code, key, wanted) in [
            (FaultCode::CroissantLicence, "license", &licence_address(licence)),
            (FaultCode::ClaimsDisagree, "name", name),
            (FaultCode::ClaimsDisagree, "version", version),
        ] {
            // An absent field is reported with the required ones.
            if !file[key].is_null() && file[key] != wanted.as_str() {
                self.report(code, format!("its {key} is {}, {} says {wanted:?}", file[key], manifest::NAME));
            }
        }
    }

    /// Checks that no two nodes have one id.
    fn judge_ids(&mut self) {
        let fields = self.record_sets().iter().flat_map(|set| node_list(&set["field"]));
        let nodes = self.distribution().iter().chain(self.record_sets()).chain(fields);
        let mut seen = BTreeSet::new();
        for id in nodes.map(node_id).filter(|id| !seen.insert(*id)) {
            self.report(FaultCode::CroissantReference, format!("two nodes have the id {id:?}"));
        }
    }

    fn judge_distribution(&mut self) {
        for node in self.distribution() {
            match node["@type"].as_str() {
                // The root is a folder; its `sha256` is a placeholder that the format demands.
                Some("cr:FileObject") if node_id(node) == ROOT => {}
                Some("cr:FileObject") => self.judge_object(node),
                Some("cr:FileSet") => self.judge_set(node),
                kind => self.report(FaultCode::CroissantField, format!("`{}` is a {kind:?}", node_id(node))),
            }
        }
    }

    /// Checks that a single file exists and is as described.
    fn judge_object(&mut self, node: &Value) {
        let name = node_id(node);
        let Some(stated) = node["sha256"].as_str() else {
            return self.report(FaultCode::CroissantField, format!("{name} has no sha256"));
        };
        let path = node["contentUrl"].as_str().unwrap_or_default();
        let Some(sha256) = self.tree.intact.get(path) else {
            return self
                .report(FaultCode::CroissantSum, format!("{name} is `{path}`, which is missing or damaged"));
        };
        if stated != *sha256 {
            self.report(
                FaultCode::CroissantSum,
                format!("the sha256 of {path} is {stated}, the file's is {sha256}"),
            );
        }
        let size = content_size(std::fs::metadata(self.tree.path_of(path)).map_or(0, |file| file.len()));
        let stated = &node["contentSize"];
        if *stated != size.as_str() {
            self.report(
                FaultCode::CroissantSum,
                format!("the size of {path} is {stated}, the file's is {size}"),
            );
        }
    }

    /// Checks that a pattern matches some files, and that they lie in a described container.
    fn judge_set(&mut self, node: &Value) {
        let (name, container) = (node_id(node), node_id(&node["containedIn"]));
        if self.distribution().iter().all(|other| node_id(other) != container) {
            let message = format!("{name} is contained in {container:?}, which is not defined");
            self.report(FaultCode::CroissantReference, message);
        }
        let patterns = node_list(&node["includes"]);
        for pattern in patterns.iter().map(|pattern| pattern.as_str().unwrap_or_default()) {
            // Its list reports a file that is not whole, so a listed path is enough here.
            if !self.manifest.paths().any(|path| glob_matches(pattern, path)) {
                self.report(FaultCode::CroissantFiles, format!("no file matches `{pattern}` of {name}"));
            }
        }
        if patterns.is_empty() {
            self.report(FaultCode::CroissantFiles, format!("{name} includes nothing"));
        }
    }
}
